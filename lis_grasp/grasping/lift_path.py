"""Path of the palm in a lift, whose way must be free of the bodies beside the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.grasping.grasps import LIFT
from lis_grasp.records import FrozenArrays
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

LIFT_STEP = 0.01
"""Largest distance between checked poses of a straight lift [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LiftPath(FrozenArrays):
    """A lift by a height, with the displacements that it passes through.

    Examples
    --------
    >>> LiftPath.straight(0.1).displacements.shape
    (10, 4, 4)
    """

    height: float  #: rise of the palm where it lets go of an object that it lost [m]
    #: (K, 4, 4), of the hand's base link: rotations about its origin, and translations, along the
    #: axes of O
    displacements: FloatArray

    @classmethod
    def straight(cls, height: float) -> LiftPath:
        """Return a lift straight up by a height [m]."""
        steps = int(np.ceil(height / LIFT_STEP - 1e-9))
        displacements = np.repeat(np.eye(4)[None], steps, axis=0)
        displacements[:, 2, 3] = np.linspace(0.0, height, steps + 1)[1:]
        return cls(height, displacements)

    def palms(self, hand: Hand, X_OH: FloatArray) -> FloatArray:
        """Return the poses of the palm (K, 4, 4) from its pose (4, 4) at the grasp."""
        p_OB = apply_pose(X_OH, inverse_pose(hand.X_LH)[:3, 3])
        palms = self.displacements @ X_OH
        # The rotations are about the base link, not about O.
        palms[:, :3, 3] += p_OB - self.displacements[:, :3, :3] @ p_OB
        return np.asarray(palms)


STRAIGHT_LIFTS = (LiftPath.straight(LIFT),)
"""The usual lift without a shake."""
