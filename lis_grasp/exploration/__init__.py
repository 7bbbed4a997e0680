"""Exploration: what to touch next, given what was touched before."""

from lis_grasp.exploration.explore import Exploration, explore
from lis_grasp.exploration.frontier import STEP_FRACTION, FrontierPolicy
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.probe import Probe, ProbeOutcome, Prober, ProbeStatus
from lis_grasp.exploration.tactile_sensor import SensingProber, TactileSensor

__all__ = [
    "STEP_FRACTION",
    "Exploration",
    "FrontierPolicy",
    "Policy",
    "Probe",
    "ProbeOutcome",
    "ProbeStatus",
    "Prober",
    "SensingProber",
    "TactileSensor",
    "explore",
]
