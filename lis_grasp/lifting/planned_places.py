"""Places for a held object: free of known bodies, for the hand too, beside or against walls."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.arms.carrying import CarryingArm
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.grasping.body_clearance import BodyClearance
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.lift_path import LIFT_STEP
from lis_grasp.grasping.surface_uncertainty import PALM_ERROR, allowed_meshes
from lis_grasp.lifting.place_plan import LARGEST_ANGLE, PlacePlan
from lis_grasp.lifting.placing import placed_wrist
from lis_grasp.robots.body_pairs import hull_points
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.resting import rest_from, resting_poses
from lis_grasp.typing import FloatArray
from lis_grasp.world import Table

# Distances of a new place from the old one [m], and the number of directions and turns tried.
_ASIDE, _DIRECTIONS, _TURNS = (0.1, 0.15, 0.2, 0.3, 0.4), 8, 4
# Standard deviations of an estimate's extent that make its band.
_DEVIATIONS = 2.0
# Height up to which a table cuts an estimate [m], and depth in which contact is expected [m].
_CUT, _DEPTH = 0.001, 0.005
# Resting poses within this angle are one [rad]; least probability of one, and of its staying in a
# number of surfaces that the estimate allows; largest pitch of the wrist [rad].
_SAME_POSE, _LEAST_PROBABILITY, _LEAST_STAYS = float(np.deg2rad(10.0)), 0.05, 0.8
_SAMPLES, _STEEPEST = 20, float(np.deg2rad(80.0))
# Turn between two checked poses of the way [rad].
_TURN_STEP = 0.1
# Steps and limit of the gap to a wall that hand and object need [m].
_GAP_STEP, _LARGEST_GAP = 0.002, 0.15
# Heights of the way above that of the lift [m], tried in this order.
_HIGHER = (0.0, 0.1, 0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """Two upright walls at right angles.

    `vertex` (3,) is the corner on the table [m], in E; `away` (2, 3) are the walls' unit normals
    into the room, level and at right angles; `names` those of the walls' bodies.
    """

    vertex: FloatArray
    away: FloatArray
    names: tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """A pose in which a held object can stand."""

    turn: FloatArray  #: (4, 4), motion from the pose in which it stood before, onto the table
    stands: float  #: probability that it stays in it, on the surfaces that the estimate allows

    @classmethod
    def as_before(cls) -> Stand:
        """Return the pose in which it was seen standing."""
        return cls(np.eye(4), stands=1.0)


def stands_of(
    mesh: trimesh.Trimesh, support_height: float, *, rng: np.random.Generator
) -> Iterator[Stand]:
    """Yield the poses in which an estimated object can stand, the surest first.

    The first is the one in which it was seen standing. The others are resting poses of the mesh
    that are likely if it is dropped; they stand if they stay within 5 degrees on the surfaces that
    the estimate allows.
    """
    yield Stand.as_before()
    poses = [
        pose
        for pose in resting_poses(mesh, merged=_SAME_POSE)
        if pose.probability > _LEAST_PROBABILITY and pose.rotation[2, 2] < np.cos(_SAME_POSE)
    ]
    downs = [-pose.rotation[2] for pose in poses]
    stays = np.zeros(len(poses))
    for allowed in allowed_meshes(mesh, _SAMPLES, rng=rng):
        stays += [rest_from(allowed, down) @ down > np.cos(LARGEST_ANGLE) for down in downs]
    for k in np.argsort(-stays, kind="stable"):
        turn = make_pose(poses[k].rotation)
        turned, middle = apply_pose(turn, mesh.vertices), mesh.bounds.mean(axis=0)
        turn[:2, 3] = middle[:2] - 0.5 * (turned.min(axis=0) + turned.max(axis=0))[:2]
        turn[2, 3] = support_height - turned[:, 2].min()
        if stays[k] > _LEAST_STAYS * _SAMPLES:
            yield Stand(turn, float(stays[k]) / _SAMPLES)


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class PlaceSearch:
    """What a place is planned with: a hand that holds an estimated object, and known bodies.

    Everything is in the frame E of the contacts, in which the object stood before the lift.
    """

    hand: Hand
    grasp: Grasp
    mesh: trimesh.Trimesh  #: the estimate [m], with its uncertainty
    table: Table  #: which it stands on, and the known bodies
    lift_height: float  #: rise of the wrist after which it carries the object [m]
    standoff: float  #: length of the retreat [m]
    margin: float = 0.0  #: error of the bodies' places [m]
    #: the arm as it holds the object, lifted; None for a free hand
    arm: CarryingArm | None = None

    def on_table(self, stand: Stand) -> PlacePlan | None:
        """Return the nearest free place aside for a pose; None if there is none."""
        for motion in _aside(self._middle):
            plan = self._free(motion @ stand.turn)
            if plan is not None:
                return replace(plan, stands=stand.stands)
        return None

    def in_corner(self, corner: Corner, stand: Stand) -> PlacePlan | None:
        """Return the place nearest to both walls of a corner; None if there is none."""
        turns = self._flush_turns(corner, stand)
        plans = [self._against(corner, turn @ stand.turn) for turn in turns]
        found = [plan for plan in plans if plan is not None]
        best = min(found, key=lambda plan: sum(plan.gaps.values()), default=None)
        return None if best is None else replace(best, stands=stand.stands)

    @cached_property
    def clearance(self) -> BodyClearance:
        """Collisions of the hand, and of the object, with the bodies."""
        margin = self.margin + _DEVIATIONS * PALM_ERROR
        return BodyClearance(self.hand, self.mesh, self.table.surroundings, margin=margin)

    @cached_property
    def _middle(self) -> FloatArray:
        middle = self.mesh.bounds.mean(axis=0)
        return np.array([middle[0], middle[1], self.table.height])

    def _flush_turns(self, corner: Corner, stand: Stand) -> Iterator[FloatArray]:
        """Yield turns (4, 4) that bring the smallest rectangle around the object to the walls."""
        hull = apply_pose(stand.turn, self.mesh.convex_hull.vertices)[:, :2]
        to_rectangle, _ = trimesh.bounds.oriented_bounds_2D(hull)
        angle = np.arctan2(to_rectangle[1, 0], to_rectangle[0, 0])
        wall = np.arctan2(corner.away[0, 1], corner.away[0, 0])
        for quarter in range(_TURNS):
            yaw = wall + angle + 0.5 * np.pi * quarter
            yield turned_about(self._middle, float(np.arctan2(np.sin(yaw), np.cos(yaw))))

    def _against(self, corner: Corner, turn: FloatArray) -> PlacePlan | None:
        """Return the place of a turned object with the least free gaps to the walls, if any."""
        band = np.array([self.band_toward(turn[:3, :3].T @ -normal) for normal in corner.away])
        gaps = band + self.margin + _DEVIATIONS * PALM_ERROR
        points = apply_pose(turn, self.mesh.vertices)
        while gaps.max() < _LARGEST_GAP:
            motion = turn.copy()
            for normal, gap in zip(corner.away, gaps, strict=True):
                motion[:3, 3] += (gap - ((points - corner.vertex) @ normal).min()) * normal
            plan = self._free(motion)
            if plan is not None:
                return replace(plan, gaps=dict(zip(corner.names, gaps.tolist(), strict=True)))
            hit = self._hit(motion, self.lift_height + _HIGHER[-1])
            if hit not in corner.names:
                return None
            gaps[corner.names.index(hit)] += _GAP_STEP
        return None

    def _free(self, motion: FloatArray) -> PlacePlan | None:
        for higher in _HIGHER:
            carry = self.lift_height + higher
            if self._hit(motion, carry) is None:
                return self._plan(motion, carry)
        return None

    def _plan(self, motion: FloatArray, carry: float) -> PlacePlan:
        down = -motion[2, :3]
        # As it stood before, the estimate's lowest point is known: the table was there.
        band = self.band_toward(down) if self._leans(motion) else 0.0
        return PlacePlan(motion, carry, _DEPTH + band)

    def band_toward(self, direction: FloatArray) -> float:
        """Return how much farther the object may reach along a direction (3,) than estimated [m].

        By two standard deviations along the normals; 0 for an exact mesh.
        """
        vertices, known = self.mesh.vertices, self.mesh.vertex_attributes.get("uncertainty")
        if known is None:
            return 0.0
        outward = np.asarray(self.mesh.vertex_normals) @ direction
        along = vertices @ direction
        allowed = along + _DEVIATIONS * np.asarray(known) * outward
        # Where the table cut the estimate, its deviation is that of what is below.
        sound = vertices[:, 2] > self.table.height + _CUT
        return float(max(allowed[sound].max(initial=-np.inf) - along.max(), 0.0))

    def _hit(self, motion: FloatArray, carry: float) -> str | None:
        """Return a body that the hand, or what it holds, hits on the way to a place, or back."""
        X_OH, q = self.grasp.X_OH, self.grasp.joint_positions
        if self._leans(motion):
            if abs(np.arcsin(motion[2, 0])) > _STEEPEST:
                return "wrist"
            for posture in (q, self.grasp.pregrasp_positions):
                if self._lowest_of_hand(motion @ X_OH, posture) < self.table.height:
                    return "table"
        way, back = self._palms(motion, carry), self._retreat(motion)
        if len(self.table.surroundings):
            hit = (
                self.clearance.hit_by_hand(way, q)
                or self.clearance.hit_by_object(X_OH, way)
                or self.clearance.hit_by_hand(back, self.grasp.pregrasp_positions)
            )
            if hit is not None:
                return hit
        there = np.concatenate([way[::-1], back])
        return None if self.arm is None or self.arm.follows(there) else "arm"

    def _retreat(self, motion: FloatArray) -> FloatArray:
        """Return poses (S, 4, 4) of the palm from the place away from the object."""
        steps = 1 + round(self.standoff / LIFT_STEP)
        back = np.repeat((motion @ self.grasp.X_OH)[None], steps, axis=0)
        away = -self.standoff * (motion[:3, :3] @ self.grasp.approach_O)
        back[:, :3, 3] += np.linspace(0.0, 1.0, steps)[:, None] * away
        return np.asarray(back)

    def _leans(self, motion: FloatArray) -> bool:
        """Return whether a place turns the hand in the vertical, so that it may hit the table."""
        return bool(motion[2, 2] < np.cos(_SAME_POSE))

    def _lowest_of_hand(self, X_WH: FloatArray, q: FloatArray) -> float:
        """Return the height of the lowest point of a hand with joints q (J,) [m]."""
        links, lowest = self.hand.forward_kinematics(X_WH, q), np.inf
        for geometry in self.hand.link_geometries:
            points, radius = hull_points(geometry)
            at = apply_pose(links[geometry.link] @ geometry.X_LG, points)
            lowest = min(lowest, float(at[:, 2].min()) - radius)
        return lowest

    def _palms(self, motion: FloatArray, carry: float) -> FloatArray:
        """Return poses (W, 4, 4) of the palm from the place, where it ends, back to the lift."""
        X_WB = self.grasp.X_OH @ inverse_pose(self.hand.X_LH)
        goal, up = placed_wrist(X_WB, X_WB, motion), np.zeros(6)
        up[2] = carry
        corners = [goal, goal + up, up]
        way: list[FloatArray] = []
        for start, end in pairwise(corners):
            far, turn = np.linalg.norm(end[:3] - start[:3]), np.abs(end[3:] - start[3:]).max()
            steps = int(np.ceil(max(far / LIFT_STEP, turn / _TURN_STEP))) + 1
            way += list(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start))
        displacements = np.array(way)
        turns = Rotation.from_euler("xyz", displacements[:, 3:]).as_matrix()
        X = make_pose(turns @ X_WB[:3, :3], displacements[:, :3] + X_WB[:3, 3])
        return np.asarray(X @ self.hand.X_LH)


def turned_about(point: FloatArray, yaw: float) -> FloatArray:
    """Return the motion (4, 4) that turns about the vertical through a point (3,) by yaw [rad]."""
    R = Rotation.from_euler("z", yaw).as_matrix()
    return make_pose(R, point - R @ point)


def _aside(middle: FloatArray) -> Iterator[FloatArray]:
    """Yield motions (4, 4) to places aside, the nearest and least turned first."""
    for yaw in np.array([0.0, 0.5, -0.5, 1.0]) * np.pi:
        for distance in _ASIDE:
            for angle in np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS):
                motion = turned_about(middle, yaw)
                motion[:2, 3] += distance * np.array([np.cos(angle), np.sin(angle)])
                yield motion
