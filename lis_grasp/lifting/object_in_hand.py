"""Object in the hand of a simulated lift: slip, turn, contacts, clearance."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import apply_inverse, apply_pose, relative_rotation
from lis_grasp.lifting.grip import Grip
from lis_grasp.lifting.outcome import Reason
from lis_grasp.lifting.scene import LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.typing import FloatArray

_LEAST_FORCE = 0.05  # [N] of a link that counts as touching
# Slip after which the watch reports again [m]: half the pitch of usual taxels.
_SLIP_STEP = 0.001


class ObjectInHand:
    """The object of a lift, and how it lies in the hand once `hold` says that the grasp closed."""

    def __init__(self, scene: LiftingScene, setup: LiftSetup) -> None:
        self._scene, self._setup, self._options = scene, setup, setup.options
        self._hull = np.asarray(setup.mesh.convex_hull.vertices)  # the lowest one is a hull vertex
        self._p_OC = np.asarray(setup.mesh.center_mass)
        self._start = self._center()
        # Object's centre of mass (3,) and rotation (3, 3) in the palm, once the grasp has closed.
        self.held: tuple[FloatArray, FloatArray] | None = None

    def hold(self) -> None:
        """Measure slip and turn from now on: the grasp has closed."""
        self.held = self.place(), self._rotation()

    def moved(self) -> float:
        """Return the displacement of the object's centre of mass from the start [m]."""
        return float(np.linalg.norm(self._center() - self._start))

    def place(self) -> FloatArray:
        """Return the object's centre of mass in the palm frame, shape (3,) [m]."""
        return apply_inverse(self._scene.X_WH, self._center())

    def slip_and_turn(self) -> tuple[float, float]:
        """Return `slip` and `turn`."""
        return self.slip(), self.turn()

    def slip(self) -> float:
        """Return the motion of the object's centre of mass in the hand [m]."""
        return 0.0 if self.held is None else float(np.linalg.norm(self.place() - self.held[0]))

    def turn(self) -> float:
        """Return the angle by which the object has turned in the hand [rad]."""
        if self.held is None:
            return 0.0
        return float(Rotation.from_matrix(self.held[1].T @ self._rotation()).magnitude())

    def touching_links(self) -> int:
        """Return how many links of the hand touch the object."""
        return len({c.link for c in self._scene.contacts() if c.strength >= _LEAST_FORCE})

    def is_touched(self) -> bool:
        """Return whether as many links touch the object as hold it."""
        return self.touching_links() >= self._setup.needed_links

    def clearance(self) -> float:
        """Return the distance of the object's lowest point from the table [m]."""
        X_WO = self._scene.X_WO
        bottom = float((self._hull @ X_WO[2, :3]).min() + X_WO[2, 3])
        return bottom - self._setup.support_height

    def has_moved(self) -> bool:
        """Return whether the object has moved or turned too far in the hand."""
        options = self._options
        return self.slip() >= options.largest_slip or self.turn() >= options.largest_turn

    def loss(self, rise: float, lost: Reason) -> Reason | None:
        """Return how a hand that has risen by `rise` [m] lost the object; None if it has not.

        An object that is still carried has "slipped" or "turned"; another one is `lost`.
        """
        if not self._carried(rise):
            return lost
        if not self.has_moved():
            return None
        return "slipped" if self.slip() >= self._options.largest_slip else "turned"

    def _carried(self, rise: float) -> bool:
        """Return whether the object has risen by half as much as the hand, which touches it."""
        rise = min(rise, self._options.lift_height)
        return self.clearance() >= 0.5 * rise and self.is_touched()

    def _center(self) -> FloatArray:
        """Return the object's centre of mass, shape (3,) [m]."""
        return apply_pose(self._scene.X_WO, self._p_OC)

    def _rotation(self) -> FloatArray:
        """Return the object's rotation in the palm frame, shape (3, 3)."""
        return relative_rotation(self._scene.X_WH, self._scene.X_WO)


class SlipWatch:
    """Slip of an object over the pads of a hand, as tactile slip sensors measure it.

    It is how far the object's surface has moved over the touching pads since the start.
    """

    def __init__(self, scene: LiftingScene, control: Grip) -> None:
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
        if total < self._reported + _SLIP_STEP:
            return False
        self._reported = total
        return True

    def _points_in_object(self) -> dict[str, FloatArray]:
        """Return the contact point (3,) of each touching finger's link in the object's frame."""
        X_WO = self._scene.X_WO
        return {
            finger: apply_inverse(X_WO, point)
            for finger, point in self._control.pad_points().items()
        }
