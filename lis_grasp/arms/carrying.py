"""Ways of the palm that an arm can carry a held object along."""

from __future__ import annotations

import numpy as np

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.mounted_hand import MountedHand
from lis_grasp.arms.reach import JUMP
from lis_grasp.typing import FloatArray


class CarryingArm:
    """An arm at joint positions q (J,), whose hand holds an object with its joints at (K,).

    It follows ways of the palm within its joint limits, on one branch, while its links keep off
    themselves, the table and the bodies beside. What the hand, and the object in it, keep off is
    checked without the arm.
    """

    def __init__(self, station: MountedHand, q: FloatArray, q_hand: FloatArray) -> None:
        self._station, self._q, self._q_hand = station, q, q_hand
        self._checker = StationChecker(station, arm_only=True)

    def follows(self, X_WH: FloatArray) -> bool:
        """Return whether the arm can take the palm from where it is along poses (N, 4, 4)."""
        return self._along(X_WH) is not None

    def after(self, X_WH: FloatArray) -> CarryingArm | None:
        """Return the arm at the end of a way of the palm (N, 4, 4); None if it cannot follow."""
        q = self._along(X_WH)
        return None if q is None else CarryingArm(self._station, q[-1], self._q_hand)

    def _along(self, X_WH: FloatArray) -> FloatArray | None:
        """Return joint positions (N, J) along a free way; None if there are none."""
        q, way = self._q, []
        for X in X_WH:
            (q_next,), (solved,) = self._station.follow(q[None], X[None])
            if not solved or np.abs(q_next - q).max() > JUMP:
                return None
            way.append(q_next)
            q = q_next
        positions = np.array(way)
        return positions if self._checker.free(positions, self._q_hand).all() else None
