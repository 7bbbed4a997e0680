"""Inverse kinematics and collision filtering of grasp candidates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from lis_grasp.geometry import apply_pose, rotate
from lis_grasp.grasping.body_clearance import BodyClearance, Hit
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.grasps import STANDOFF, Grasp, GraspSearch, Reach
from lis_grasp.grasping.inverse_kinematics import solve_ik
from lis_grasp.grasping.lift_path import STRAIGHT_LIFTS, LiftPath
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import SEATING, Hand
from lis_grasp.robots.robot_model import Pad
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp.world import ALONE, Surroundings

_MAX_POSITION_ERROR = 0.0015  # [m] of a pad from its contact
_MAX_AXIS_ERROR = 0.02  # [rad] of a contact beyond its pad's border
# Least height of planned fingertips above the support, on which they may slide [m], and of planned
# contacts of jaws, which would stick to it and are bent aside.
_TIP_CLEARANCE, _LOWEST_JAW_CONTACT = 0.00005, 0.0006
_CLEARANCE, _SPARE = 0.0004, 0.0003  # [m] of other links from the support; more for a first guess
_ARM_CLEARANCE = 0.001  # [m] the same of a hand on an arm, which sags by up to 1 mm
# An opened hand on an arm is free to go on by this [m]: the palm keeps off the object.
_ARM_ERROR = 0.002
_OPENING = 0.02  # [m] of each pad from its contact before the hand closes
_OFF_JAW = 0.003  # [m] off a fixed jaw's contact, where no link may touch
_APPROACH_STEPS = 8  # poses that are checked
_FACE_DEPTH = 0.001  # [m]: parts of a link this near to the plane of its pad belong to the pad
_BORDER = 0.0005  # [m] of a flat pad at the fingertip without contacts
_STEEP = 0.2  # least descent of the approach per metre at which the palm rises by going back


def lowest_contact(hand: Hand) -> float:
    """Return the least height of planned contacts above the support [m]."""
    return _TIP_CLEARANCE if hand.slides_on_table else _LOWEST_JAW_CONTACT


class CandidateFilter:
    """Solves the inverse kinematics of contact sets and rejects those that collide.

    FCL checks every link at the grasp, at the opened posture and along the approach. `rejected`
    counts the rejected contact sets by reason:

    - ``out_of_reach``: a pad stays too far from its contact;
    - ``pad_does_not_face_the_surface``: a contact is outside its pad;
    - ``grasp_hits_object``, ``_support``, ``_obstacle``, ``_self``: a collision at the grasp;
    - ``approach_hits_object``, ``_support``, ``_obstacle``, ``_self``: a collision opened or on the
      approach;
    - ``lift_hits_obstacle``, ``carried_hits_obstacle``, ``retreat_hits_obstacle``: a collision of
      the hand, of the object in it, or of the hand that lets go, in each of the `lifts`;
    - with a `reach`, the reasons of its check.

    `hit_bodies` counts the bodies of the `surroundings`, the obstacles, that these would hit, or
    pass by within a `margin` [m]. For the other arguments see `HandCollisionChecker`. `reach` is
    the reach of the arm that carries the hand.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        *,
        support_height: float | None,
        reach: Reach | None = None,
        surroundings: Surroundings = ALONE,
        lifts: Sequence[LiftPath] = STRAIGHT_LIFTS,
        margin: float = 0.0,
    ) -> None:
        self._reach_check = None if reach is None else reach.reach_check(mesh)
        self._hand = hand
        clearance, beyond = (_CLEARANCE, 0.0) if reach is None else (_ARM_CLEARANCE, _ARM_ERROR)
        self._tips_lower = {"grasp": 0.0, "approach": 0.0}
        self._floor = -np.inf if support_height is None else support_height
        if hand.slides_on_table:
            # Fingertips feel the support: an arm that goes too far stops there.
            self._tips_lower = {"grasp": clearance, "approach": clearance + beyond}
            self._floor += _TIP_CLEARANCE
        else:
            self._floor += clearance + _SPARE + beyond
        self._checker = HandCollisionChecker(
            hand, mesh, support_height=support_height, clearance=clearance
        )
        self._bodies: BodyClearance | None = None
        if len(surroundings):
            self._bodies = BodyClearance(
                hand, mesh, surroundings, support_height=support_height, margin=margin
            )
        self._lifts = lifts
        self._is_fixed = np.isin(hand.fingers, hand.fixed_fingers)  # (F,)
        self._seating = SEATING if hand.seated_fingers else 0.0
        self._opening = np.where(self._is_fixed, 0.0, 1.0 + self._is_fixed.any())[:, None]
        self._offsets = fingertip_offsets(hand)
        self.rejected: Counter[str] = Counter()
        self.hit_bodies: Counter[str] = Counter()

    def solve_and_filter(self, batch: GraspBatch) -> tuple[IndexArray, GraspBatch]:
        """Return the indices of the contact sets that are accepted, and their grasps.

        The postures of the batch are the initial guess of the inverse kinematics.
        """
        batch = solve_ik(self._hand, self._to_fingertips(batch))
        assert batch.position_error is not None
        assert batch.axis_error is not None
        near = batch.position_error <= _MAX_POSITION_ERROR
        facing = batch.axis_error <= _MAX_AXIS_ERROR
        self.rejected["out_of_reach"] += int((~near).sum())
        self.rejected["pad_does_not_face_the_surface"] += int((near & ~facing).sum())
        kept = np.flatnonzero(near & facing)
        X_OH, q = batch.X_OH[kept], batch.q[kept]
        kept = kept[self._free("grasp", q, X_OH[:, None], pads_may_touch=True)]
        if self._is_fixed.any():
            kept = kept[self._with_free_jaws(batch.subset(kept))]
        kept = kept[self._off_bodies("grasp", batch.q[kept], batch.X_OH[kept, None])]
        batch = batch.subset(kept)
        away = replace(batch, points=batch.points + _OPENING * self._opening * batch.normals)
        return self._with_free_ways(kept, batch, solve_ik(self._hand, away, palm_fixed=True).q)

    def search(
        self, grasps: Sequence[Grasp], rejected: Counter[str], candidates: int
    ) -> GraspSearch:
        """Return the result of a search; what this filter rejected is added to the counts."""
        counts = rejected + self.rejected
        return GraspSearch(
            tuple(grasps),
            {reason: n for reason, n in sorted(counts.items()) if n},
            candidates,
            dict(sorted(self.hit_bodies.items())),
        )

    def filter_cups(self, batch: GraspBatch) -> tuple[IndexArray, GraspBatch]:
        """Return the same of grasps by a suction cup: posed as they are, without an opening."""
        paths = batch.X_OH[:, None]
        kept = np.flatnonzero(self._free("grasp", batch.q, paths, pads_may_touch=True))
        kept = kept[self._off_bodies("grasp", batch.q[kept], paths[kept])]
        batch = batch.subset(kept)
        return self._with_free_ways(kept, batch, batch.q)

    def _with_free_ways(
        self, kept: IndexArray, batch: GraspBatch, opened: FloatArray
    ) -> tuple[IndexArray, GraspBatch]:
        """Return the grasps, of indices `kept`, that can be approached, lifted and let go."""
        paths = self._approaches(batch.X_OH)
        free = np.flatnonzero(self._free("approach", opened, paths))
        free = free[self._off_bodies("approach", opened[free], paths[free])]
        free = free[self._with_free_lifts(batch.subset(free), opened[free])]
        free = free[self._within_reach(batch.subset(free), opened[free])]
        batch = batch.subset(free)
        clearance = self._checker.clearances(batch.X_OH, batch.q)
        return kept[free], replace(batch, opened=opened[free], clearance=clearance)

    def _to_fingertips(self, batch: GraspBatch) -> GraspBatch:
        """Return the contact sets with offsets from the centres of flat pads to the fingertips.

        Pads are tall, so that with contacts at their centres fingertips would be in the support
        where an object is low. The palm goes back along its approach until the hand clears the
        support, or until the contacts are at the fingertips.
        """
        longest = float(np.linalg.norm(self._offsets, axis=1).min())
        if not np.isfinite(self._floor) or longest <= 0.0:
            return batch
        X_OH, used = batch.X_OH.copy(), batch.used[..., None]
        off = np.where(used, batch.points - self._hand.pad_centers(X_OH, batch.q), 0.0)
        X_OH[:, :3, 3] += off.sum(axis=1) / used.sum(axis=1)  # pads at their centres
        approach = rotate(X_OH, self._hand.approach_H)
        poses = X_OH[:, None] @ self._checker.poses_in_hand(batch.q)
        low = self._floor - self._checker.lowest(poses)
        back = np.clip(low / np.maximum(-approach[:, 2], _STEEP), 0.0, longest)
        X_OH[:, :3, 3] -= back[:, None] * approach
        offsets = (back / longest)[:, None, None] * self._offsets
        return replace(batch, X_OH=X_OH, offsets=offsets)

    def _within_reach(self, batch: GraspBatch, opened: FloatArray) -> BoolArray:
        """Return which grasps are within reach, (B,)."""
        if self._reach_check is None or not len(batch):
            return np.ones(len(batch), dtype=bool)
        reasons = self._reach_check(batch.X_OH, opened, batch.q)
        self.rejected += Counter(reason for reason in reasons if reason is not None)
        return np.array([reason is None for reason in reasons], dtype=bool)

    def _approaches(self, X_OH: FloatArray) -> FloatArray:
        """Return palm poses along the approach to each pose (B, 4, 4), shape (B, W, 4, 4).

        The end of the approach of a fixed jaw or a cup is left out: there it may touch.
        """
        back = np.linspace(self._seating, STANDOFF, _APPROACH_STEPS)
        if self._reach_check is not None and not self._seating:
            back = np.append(-_ARM_ERROR, back)
        return _paths(X_OH, -back[:, None] * rotate(X_OH, self._hand.approach_H)[:, None])

    def _with_free_jaws(self, batch: GraspBatch) -> BoolArray:
        """Return which grasps are free a little off their contacts, (B,), with a fixed jaw.

        A fixed jaw is one link with the palm, and a jaw that turns may meet the object far from its
        pad: no link may touch there.
        """
        moved = replace(batch, points=batch.points + _OFF_JAW * self._opening * batch.normals)
        q, X_OH = solve_ik(self._hand, moved, palm_fixed=True).q, batch.X_OH.copy()
        X_OH[:, :3, 3] += _OFF_JAW * batch.normals[:, self._is_fixed].sum(axis=1)
        return self._free("grasp", q, X_OH[:, None])

    def _free(
        self, stage: str, q: FloatArray, paths: FloatArray, *, pads_may_touch: bool = False
    ) -> BoolArray:
        """Return which postures do not collide on paths (B, W, 4, 4), shape (B,)."""
        hits = self._checker.first_collisions(
            paths, q, pads_may_touch=pads_may_touch, tips_lower=self._tips_lower[stage]
        )
        self.rejected += Counter(f"{stage}_hits_{hit}" for hit in hits if hit is not None)
        return np.array([hit is None for hit in hits], dtype=bool)

    def _off_bodies(self, stage: str, q: FloatArray, paths: FloatArray) -> BoolArray:
        """Return which postures hit no body on paths (B, W, 4, 4), shape (B,)."""
        free = np.ones(len(paths), dtype=bool)
        for k, path in enumerate(paths if self._bodies is not None else ()):
            assert self._bodies is not None
            if body := self._bodies.hit_by_hand(path, q[k]):
                free[k] = False
                self._reject(Hit(f"{stage}_hits_obstacle", body))
        return free

    def _with_free_lifts(self, batch: GraspBatch, opened: FloatArray) -> BoolArray:
        """Return which grasps have a lift in which nothing hits a body, (B,)."""
        free = np.ones(len(batch), dtype=bool)
        if self._bodies is None:
            return free
        back = -STANDOFF * rotate(batch.X_OH, self._hand.approach_H)
        for k, X_OH in enumerate(batch.X_OH):
            lift = self._bodies.first_free_lift(
                self._lifts, X_OH, q=batch.q[k], opened=opened[k], back=back[k]
            )
            if isinstance(lift, Hit):
                free[k] = False
                self._reject(lift)
        return free

    def _reject(self, hit: Hit) -> None:
        self.rejected[hit.reason] += 1
        self.hit_bodies[hit.body] += 1


def _paths(X_OH: FloatArray, moved: FloatArray) -> FloatArray:
    """Return poses (B, 4, 4) moved by (W, 3) or (B, W, 3) [m], shape (B, W, 4, 4)."""
    paths = np.repeat(X_OH[:, None], moved.shape[-2], axis=1)
    paths[..., :3, 3] += moved
    return paths


def fingertip_offsets(hand: Hand) -> FloatArray:
    """Return the way from each pad's centre to the end of its flat face, shape (F, 3) [m].

    In the frame of the pad's link, along the hand's approach as far as the link's collision bodies
    reach in the plane of the pad. Zero for rounded pads, which touch in any direction anyway.
    """
    posture = next(iter(hand.pregrasps.values()))
    links = hand.forward_kinematics(np.eye(4), posture)
    return np.array([_to_fingertip(hand, pad, links[pad.link][:3, :3]) for pad in hand.pads])


def _to_fingertip(hand: Hand, pad: Pad, R_HL: FloatArray) -> FloatArray:
    ahead = R_HL.T @ hand.approach_H
    ahead = ahead - (ahead @ pad.axis_L) * pad.axis_L
    length = float(np.linalg.norm(ahead))
    if pad.radius > 0.0 or length < 1e-6:
        return np.zeros(3)
    ahead /= length
    points = [
        apply_pose(geometry.X_LG, geometry.mesh.vertices) - pad.center_L
        for geometry in hand.link_geometries
        if geometry.link == pad.link
    ]
    relative = np.vstack([np.zeros((1, 3)), *points])
    on_face = np.abs(relative @ pad.axis_L) < _FACE_DEPTH
    return max(float((relative[on_face] @ ahead).max()) - _BORDER, 0.0) * ahead
