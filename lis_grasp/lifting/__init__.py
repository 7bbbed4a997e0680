"""Lift of an object: setup, options, outcome and wrist trajectory; no Drake."""

from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome

__all__ = ["LiftOptions", "LiftOutcome"]
