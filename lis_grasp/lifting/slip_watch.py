"""Slip of an object over the pads of a hand, as tactile slip sensors measure it."""

from __future__ import annotations

import numpy as np

from lis_grasp.lifting.lift_control import FingerControl
from lis_grasp.lifting.lifting_scene import LiftingScene
from lis_grasp.typing import FloatArray

# Slip after which the watch reports again [m]: half the pitch of usual taxels.
_STEP = 0.001


class SlipWatch:
    """Measures how far the object's surface has moved over the touching pads since the start."""

    def __init__(self, scene: LiftingScene, control: FingerControl) -> None:
        self._scene, self._control = scene, control
        self._start = self._points_in_object()
        self._reported = 0.0

    @property
    def total(self) -> float:
        """Largest slip of a pad since the start [m]."""
        now = self._points_in_object()
        moved = [np.linalg.norm(now[f] - self._start[f]) for f in now if f in self._start]
        return float(max(moved, default=0.0))

    def has_slipped(self) -> bool:
        """Return whether the object has slipped by another millimetre since the last report."""
        total = self.total
        if total < self._reported + _STEP:
            return False
        self._reported = total
        return True

    def _points_in_object(self) -> dict[str, FloatArray]:
        """Return the contact point (3,) of each touching finger's link in the object's frame."""
        X_WO = self._scene.X_WO
        return {
            finger: X_WO[:3, :3].T @ (point - X_WO[:3, 3])
            for finger, point in self._control.pad_points().items()
        }
