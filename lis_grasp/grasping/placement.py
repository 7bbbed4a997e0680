"""Bring a hand to contact sets: reach them, and keep what collides neither there nor before."""

from __future__ import annotations

from collections import Counter

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.grasping.assessment import PlacedHands
from lis_grasp.grasping.contact_search import ContactSets
from lis_grasp.grasping.inverse_kinematics import PadTargets, reach
from lis_grasp.hands.collision import HandCollisionChecker
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.pose_filter import HandPoseFilter
from lis_grasp.typing import FloatArray

_MAX_POSITION_ERROR = 0.0015  # [m] of a pad from its contact
_MAX_AXIS_ERROR = 0.02  # [rad] of a contact beyond its pad's border
_OPENING = 0.02  # [m] that each pad backs off its contact before closing
_STANDOFF, _APPROACH_STEPS = 0.12, 8  # [m] along which the approach must be free


class HandPlacer:
    """Places a hand at contact sets, on one object.

    Palm and joints follow from the contacts by inverse kinematics; a filter and then FCL judge
    every link at the grasp, with the pads backed off, and along the approach.

    Parameters
    ----------
    hand
        The hand.
    mesh
        Closed surface in O [m].
    support_height
        Height of the plane that the object stands on in O [m]; None where there is none.
    """

    def __init__(self, hand: Hand, mesh: trimesh.Trimesh, *, support_height: float | None) -> None:
        self._hand = hand
        self._checker = HandCollisionChecker(hand, mesh, support_height=support_height)
        self._filter = HandPoseFilter(hand, mesh)
        self.rejected: Counter[str] = Counter()
        """How many contact sets were given up, by reason."""

    def place(
        self, sets: ContactSets, X_OH: FloatArray, q: FloatArray
    ) -> tuple[npt.NDArray[np.intp], PlacedHands]:
        """Return which of B contact sets are reached and free of collision, and the hands there.

        Parameters
        ----------
        sets
            The contacts.
        X_OH, q
            Shape (B, 4, 4) and (B, J): where to start reaching, which is also what is preferred.
        """
        targets = PadTargets(sets.points, sets.normals, sets.used)
        postures = reach(self._hand, targets, X_OH, q)
        near = postures.position_error <= _MAX_POSITION_ERROR
        facing = postures.axis_error <= _MAX_AXIS_ERROR
        self.rejected["out_of_reach"] += int((~near).sum())
        self.rejected["pad_does_not_face_the_surface"] += int((near & ~facing).sum())
        kept = np.flatnonzero(near & facing)
        kept = kept[self._free_at_grasp(postures.X_OH[kept], postures.q[kept])]
        sets, postures = sets.subset(kept), postures.subset(kept)
        away = PadTargets(sets.points + _OPENING * sets.normals, sets.normals, sets.used)
        opened = reach(self._hand, away, postures.X_OH, postures.q, palm_fixed=True).q
        free = np.flatnonzero(self._free_before(postures.X_OH, opened))
        return kept[free], PlacedHands(sets.subset(free), postures.subset(free), opened[free])

    def _free_at_grasp(self, X_OH: FloatArray, q: FloatArray) -> npt.NDArray[np.bool_]:
        free: npt.NDArray[np.bool_] = ~self._filter.collides(X_OH, q, pads_may_touch=True)
        self.rejected["grasp_hits_object"] += int((~free).sum())
        for b in np.flatnonzero(free):
            hit = self._checker.first_collision(X_OH[b], q[b], pads_may_touch=True)
            if hit is not None:
                self.rejected[f"grasp_hits_{hit}"] += 1
                free[b] = False
        return free

    def _free_before(self, X_OH: FloatArray, opened: FloatArray) -> npt.NDArray[np.bool_]:
        free: npt.NDArray[np.bool_] = ~self._filter.collides(X_OH, opened)
        self.rejected["approach_hits_object"] += int((~free).sum())
        back = np.linspace(0.0, _STANDOFF, _APPROACH_STEPS)
        for b in np.flatnonzero(free):
            way = np.tile(X_OH[b], (len(back), 1, 1))
            way[:, :3, 3] -= back[:, None] * (X_OH[b, :3, :3] @ self._hand.approach_H)
            hit = self._checker.first_collision_on_the_way(way, opened[b])
            if hit is not None:
                self.rejected[f"approach_hits_{hit}"] += 1
                free[b] = False
        return free
