"""Tactile exploration: choose the next touch, make it, estimate the surface, repeat."""

from lis_grasp._moved import module_names
from lis_grasp.exploration.loop import explore, explore_steps
from lis_grasp.exploration.observations import Landmark, Observation
from lis_grasp.exploration.perception import TactilePerception, advance, begin, begin_again
from lis_grasp.exploration.policy import POLICIES, Policy, RegionPolicy, TargetPolicy
from lis_grasp.exploration.pose_tracking import PoseTracker
from lis_grasp.exploration.probe import (
    HandPose,
    HomingProber,
    MovingProber,
    Probe,
    ProbeOutcome,
    Prober,
    ProbeStatus,
    SimulatedProber,
)
from lis_grasp.exploration.probe_motions import GENTLE_SPEED
from lis_grasp.exploration.region import DEFAULT_REGION, Region
from lis_grasp.exploration.states import Exploration, ExplorationState, NextProbe
from lis_grasp.exploration.stopping import (
    StopRule,
    StopRuleWithMemory,
    stop_after,
    stop_when_certain,
    stop_when_covered,
    stop_when_graspable,
)
from lis_grasp.exploration.strategy import MOST_BLOCKED, ExplorationStrategy, choose
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.touch_log import LoggedProbe, TouchLog, load_observations, load_outcomes
from lis_grasp.exploration.workspace import STEP_FRACTION, ObstacleModel, Workspace

__all__ = [
    "DEFAULT_REGION",
    "GENTLE_SPEED",
    "MOST_BLOCKED",
    "POLICIES",
    "STEP_FRACTION",
    "Exploration",
    "ExplorationState",
    "ExplorationStrategy",
    "HandPose",
    "HomingProber",
    "Landmark",
    "LoggedProbe",
    "MovingProber",
    "NextProbe",
    "Observation",
    "ObstacleModel",
    "Policy",
    "PoseTracker",
    "Probe",
    "ProbeOutcome",
    "ProbeStatus",
    "Prober",
    "Region",
    "RegionPolicy",
    "SimulatedProber",
    "StopRule",
    "StopRuleWithMemory",
    "TactilePerception",
    "TactileSensor",
    "TargetPolicy",
    "TouchLog",
    "Workspace",
    "advance",
    "begin",
    "begin_again",
    "choose",
    "explore",
    "explore_steps",
    "load_observations",
    "load_outcomes",
    "stop_after",
    "stop_when_certain",
    "stop_when_covered",
    "stop_when_graspable",
]

__getattr__, __dir__ = module_names(__name__, __all__)
