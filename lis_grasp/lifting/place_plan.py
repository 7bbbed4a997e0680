"""Records of placing a held object: the planned pose, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lis_grasp.geometry import angle_between, apply_pose, relative_rotation
from lis_grasp.records import FrozenArrays, Record
from lis_grasp.typing import FloatArray

PlaceReason = Literal[
    "placed",  # The object stands within `LARGEST_MOVE` and `LARGEST_ANGLE` of its planned pose.
    "fallen",  # It leans by more than `LARGEST_ANGLE` from the planned pose: it fell or rolled.
    "turned",  # It stands, but turned about the vertical by more than `LARGEST_ANGLE`.
    "moved",  # It stands, but farther than `LARGEST_MOVE` from the planned pose.
    "collided",  # A body beside it was pushed with more than `LARGEST_FORCE_BESIDE`.
    "not_reached",  # The hand did not arrive above the place.
    "not_released",  # The opened hand that had retreated still touched it.
    "lost",  # It left the hand on the way.
    "not_held",  # The lift failed, so that nothing was placed.
    "no_place",  # No free place was found for the object and the hand that holds it.
    "diverged",  # The simulation failed.
]

LARGEST_MOVE, LARGEST_ANGLE = 0.005, float(np.deg2rad(5.0))
"""Largest errors of a placed object: of its centre of mass [m], and of its rotation [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacePlan(FrozenArrays, Record):
    """Where a held object is to stand, planned on its estimate.

    Poses are motions of the object in the frame E of the contacts: a point p of the estimate, as it
    stood before the lift, goes to ``motion @ p``.
    """

    motion: FloatArray  #: (4, 4), to the planned pose
    carry: float  #: rise of the wrist above the grasp and above the goal on the way [m]
    band: float = 0.0  #: below the planned height, within which contact is expected [m]
    #: probability that the object stays in the planned pose, on the surfaces that the estimate
    #: allows; 1 for the pose in which it stood before
    stands: float = 1.0
    #: planned distance of the estimate from each wall of a corner [m], by the wall's name
    gaps: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class PlaceOutcome(Record):
    """What became of a placed object, judged on the true one."""

    reason: PlaceReason
    plan: PlacePlan | None = None  #: None if there was none
    moved: float | None = None  #: distance of its centre of mass from the plan [m]
    turned: float | None = None  #: angle of its rotation from the plan [rad]
    leaning: float | None = None  #: angle of its vertical from the plan [rad]
    #: height of the wrist above the planned one when contact was felt [m]; None if it was not
    felt: float | None = None

    @property
    def placed(self) -> bool:
        """Whether it stands as planned."""
        return self.reason == "placed"


def errors_of_place(
    X_WO: FloatArray, planned: FloatArray, p_OC: FloatArray
) -> tuple[float, float, float]:
    """Return how far an object moved [m], turned and leans [rad] from its planned pose (4, 4).

    Its centre of mass is at `p_OC` (3,) in O.
    """
    moved = float(np.linalg.norm(apply_pose(X_WO, p_OC) - apply_pose(planned, p_OC)))
    R = relative_rotation(planned, X_WO)
    turned = float(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))
    # The vertical in the object's frame, as planned and as it is.
    leaning = float(angle_between(planned[2, :3], X_WO[2, :3]))
    return moved, turned, leaning


def reason_of_place(moved: float, turned: float, leaning: float) -> PlaceReason:
    """Return what the errors of `errors_of_place` [m, rad] say of an object that was let go."""
    if leaning > LARGEST_ANGLE:
        return "fallen"
    if turned > LARGEST_ANGLE:
        return "turned"
    return "moved" if moved > LARGEST_MOVE else "placed"
