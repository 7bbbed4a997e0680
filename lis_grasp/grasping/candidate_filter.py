"""Inverse kinematics and collision filtering of grasp candidates."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import trimesh

from lis_grasp.geometry import rotate
from lis_grasp.grasping.contact_sets import ContactSets
from lis_grasp.grasping.inverse_kinematics import Postures, solve_ik
from lis_grasp.grasping.pad_offsets import FingertipContacts
from lis_grasp.grasping.reach import Reach
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.pose_filter import HandPoseFilter
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

_MAX_POSITION_ERROR = 0.0015  # [m] of a pad from its contact
_MAX_AXIS_ERROR = 0.02  # [rad] of a contact beyond its pad's border
_CLEARANCE, _SPARE = 0.0004, 0.0003  # [m] of the hand from the support; more for the initial guess
_ARM_CLEARANCE = 0.001  # [m] the same of a hand on an arm, which sags by up to 1 mm
# An opened hand on an arm is free to go on by this [m]: the palm keeps off the object.
_ARM_ERROR = 0.002
_NEARLY_CLOSED = 0.2  # fraction of the opening at which not even a pad touches the object
_OPENING = 0.02  # [m] of each pad from its contact before the hand closes
_STANDOFF, _APPROACH_STEPS = 0.12, 8  # [m] along which the approach must be free


@dataclass(frozen=True, slots=True, eq=False)
class GraspCandidates:
    """B contact sets with postures of the hand that touch them without collision."""

    contacts: ContactSets
    postures: Postures
    opened: FloatArray  # (B, J): joint positions with every used pad off its contact
    clearance: FloatArray  # (B,): distance of links other than fingertips from the object [m]

    def __len__(self) -> int:
        return len(self.contacts)


class CandidateFilter:
    """Solves the inverse kinematics of contact sets and rejects those that collide.

    A fast filter and then FCL check every link at the grasp, at the opened posture and along the
    approach. `rejected` counts the rejected contact sets by reason:

    - ``out_of_reach``: a pad stays too far from its contact;
    - ``pad_does_not_face_the_surface``: a contact is outside its pad;
    - ``grasp_hits_object``, ``_support``, ``_self``: a collision at the grasp, or slightly opened;
    - ``approach_hits_object``, ``_support``, ``_self``: a collision opened or on the approach;
    - with a `reach`, the reasons of its check.

    Arguments are as of `HandCollisionChecker`. `reach` is that of the arm that carries the hand.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        support_height: float | None,
        reach: Reach | None = None,
    ) -> None:
        self._reach_check = None if reach is None else reach.reach_check(mesh)
        self._hand = hand
        clearance, spare = _CLEARANCE, _SPARE
        if reach is not None:
            clearance, spare = _ARM_CLEARANCE, _SPARE + _ARM_ERROR
        self._checker = HandCollisionChecker(
            hand, mesh, support_height=support_height, clearance=clearance
        )
        self._filter = HandPoseFilter(hand, mesh)
        floor = None if support_height is None else support_height + clearance + spare
        self._fingertips = FingertipContacts(hand, self._checker, floor=floor)
        self.rejected: Counter[str] = Counter()

    def solve_and_filter(
        self, contacts: ContactSets, X_OH: FloatArray, q: FloatArray
    ) -> tuple[IndexArray, GraspCandidates]:
        """Return the indices of the contact sets that are accepted, and their candidates.

        `X_OH` (B, 4, 4) and `q` (B, J) are the initial guess of the inverse kinematics.
        """
        contacts, X_OH = self._fingertips.move(contacts, X_OH, q)
        postures = solve_ik(self._hand, contacts, X_OH, q)
        near = postures.position_error <= _MAX_POSITION_ERROR
        facing = postures.axis_error <= _MAX_AXIS_ERROR
        self.rejected["out_of_reach"] += int((~near).sum())
        self.rejected["pad_does_not_face_the_surface"] += int((near & ~facing).sum())
        kept = np.flatnonzero(near & facing)
        X_OH, q = postures.X_OH[kept], postures.q[kept]
        kept = kept[self._free("grasp", X_OH, q, X_OH[:, None], pads_may_touch=True)]
        contacts, postures = contacts.subset(kept), postures.subset(kept)
        away = replace(contacts, points=contacts.points + _OPENING * contacts.normals)
        opened = solve_ik(self._hand, away, postures.X_OH, postures.q, palm_fixed=True).q
        # Pads may touch the object where they are planned to, not with a side or a back.
        nearly = postures.q + _NEARLY_CLOSED * (opened - postures.q)
        touching = self._checker.touch_object(postures.X_OH, nearly)
        self.rejected["grasp_hits_object"] += int(touching.sum())
        clear = np.flatnonzero(~touching)
        kept, opened = kept[clear], opened[clear]
        contacts, postures = contacts.subset(clear), postures.subset(clear)
        paths = self._approaches(postures.X_OH)
        free = np.flatnonzero(self._free("approach", postures.X_OH, opened, paths))
        free = free[self._within_reach(postures.subset(free), opened[free])]
        contacts, postures = contacts.subset(free), postures.subset(free)
        clearances = self._checker.clearances(postures.X_OH, postures.q)
        return kept[free], GraspCandidates(contacts, postures, opened[free], clearances)

    def _within_reach(self, postures: Postures, opened: FloatArray) -> BoolArray:
        """Return which grasps are within reach, (B,)."""
        if self._reach_check is None or not len(opened):
            return np.ones(len(opened), dtype=bool)
        reasons = self._reach_check(postures.X_OH, opened, postures.q)
        self.rejected += Counter(reason for reason in reasons if reason is not None)
        return np.array([reason is None for reason in reasons], dtype=bool)

    def _approaches(self, X_OH: FloatArray) -> FloatArray:
        """Return palm poses along the approach to each pose (B, 4, 4), shape (B, W, 4, 4)."""
        back = np.linspace(0.0, _STANDOFF, _APPROACH_STEPS)
        if self._reach_check is not None:
            back = np.append(-_ARM_ERROR, back)
        paths = np.repeat(X_OH[:, None], len(back), axis=1)
        paths[:, :, :3, 3] -= back[:, None] * rotate(X_OH, self._hand.approach_H)[:, None]
        return paths

    def _free(
        self,
        stage: str,
        X_OH: FloatArray,
        q: FloatArray,
        paths: FloatArray,
        *,
        pads_may_touch: bool = False,
    ) -> BoolArray:
        """Return which postures collide neither at X_OH nor on paths (B, W, 4, 4), shape (B,)."""
        free = ~self._filter.collides(X_OH, q, pads_may_touch=pads_may_touch)
        self.rejected[f"{stage}_hits_object"] += int((~free).sum())
        rest = np.flatnonzero(free)
        hits = self._checker.first_collisions(paths[rest], q[rest], pads_may_touch=pads_may_touch)
        for b, hit in zip(rest, hits, strict=True):
            if hit is not None:
                self.rejected[f"{stage}_hits_{hit}"] += 1
                free[b] = False
        return free
