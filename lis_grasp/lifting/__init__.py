"""Lift of an object: setup, options, phases, outcome, for any simulator; no Drake."""

from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import LiftSetup

__all__ = ["LiftOptions", "LiftOutcome", "LiftSetup"]
