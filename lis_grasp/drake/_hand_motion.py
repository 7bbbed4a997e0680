"""Motion of a hand over time, and the protocol of its movers to probes and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import PiecewisePolynomial, PiecewisePose

from lis_grasp.exploration.states import NextProbe
from lis_grasp.probing.course import Course
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray

LEVER = 0.1
"""Lever at which a turn of the hand or of a joint counts as a motion [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class HandMotion(Record):
    """A motion of a hand over time, from 0 to a duration."""

    poses: PiecewisePose  # X_WG, of the base link
    joints: PiecewisePolynomial  # (J,) of the hand
    duration: float  # [s]
    arm: PiecewisePolynomial | None = None  # (K,) of the arm
    guarded: float = np.inf  # time from which it may touch [s]
    slow: float = np.inf  # time at which the probe's own motion begins [s]
    at_table: bool = False  # whether it ends at the table, before the probe's target
    course: Course | None = None  # of an arm
    #: (4, 4) each: poses of a free palm from above all known bodies to the approach
    way: tuple[FloatArray, ...] = ()

    def state(self, path: PiecewisePolynomial, time: float) -> FloatArray:
        """Return positions and rates (2 N,) on a path at a time [s]; at rest outside of it."""
        inside = 0.0 <= time < self.duration
        at = min(max(time, 0.0), self.duration)
        q = path.value(at)[:, 0]
        return np.concatenate([q, path.EvalDerivative(at)[:, 0] if inside else 0.0 * q])

    def X_WG(self, time: float) -> RigidTransform:
        """Return the pose of the base link at a time [s]."""
        return self.poses.GetPose(min(max(time, 0.0), self.duration))


class Mover(Protocol):
    """Moves a hand to probes and back."""

    def home(self) -> HandMotion:
        """Return the motion that rests where the exploration begins."""

    def out(self, chosen: NextProbe, before: HandMotion) -> HandMotion | str:
        """Return the motion from the previous one's end to a probe's end, or why there is none."""

    def back(self, motion: HandMotion, time: float) -> HandMotion:
        """Return the motion back from a motion that ended at a time [s]."""
