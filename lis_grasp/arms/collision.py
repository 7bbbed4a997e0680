"""Collision checks of an arm with its hand: itself, table, obstacles, the object's estimate."""

from __future__ import annotations

from typing import Literal

import fcl
import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.collision import mesh_to_BVH

from lis_grasp.arms.mounted_hand import MountedHand
from lis_grasp.geometry import apply_pose
from lis_grasp.robots.body_pairs import BodyPairs, balls_around, hull_points, pairs_of_bodies
from lis_grasp.typing import BoolArray, FloatArray

Obstacle = Literal["table", "obstacle", "object", "self"]

ARM_CLEARANCE = 0.01
"""Least distance of the arm's links from the table and from obstacles [m]."""
HAND_CLEARANCE = 0.0003
"""The same of the hand's links [m], which grasps of low objects need."""


class StationChecker:
    """Checks postures of an arm with a hand for collisions.

    Many postures are checked at once by balls that cover the links; FCL checks the postures that
    the balls do not show to be free. The arm's links are checked with each other, with the hand,
    with the table, its obstacles and the object; the hand with the last three too, but not with
    itself. The object is a closed mesh in W [m], true or estimated. Arm and hand keep off it by a
    margin [m], the hand off the table too. With `arm_only` the hand may touch both, as at a grasp.
    """

    def __init__(
        self,
        station: MountedHand,
        mesh: trimesh.Trimesh | None = None,
        *,
        margin: float = 0.0,
        arm_only: bool = False,
    ) -> None:
        self._station = station
        arm, hand = station.arm, station.hand
        self._of_arm = len(arm.link_geometries)
        bodies = [*arm.link_geometries, *hand.link_geometries]
        self._names = [g.link for g in bodies]
        self._pairs = BodyPairs(bodies, _pairs(station))
        moving = np.array([g.link not in arm.fixed_links for g in arm.link_geometries], dtype=bool)
        of_hand = np.full(len(hand.link_geometries), not arm_only)
        self._above_table = np.concatenate([moving, of_hand])
        self._clearance = np.where(
            np.arange(len(bodies)) < self._of_arm,
            max(ARM_CLEARANCE, margin),
            HAND_CLEARANCE + margin,
        )
        self._outlines = [hull_points(g) for g in bodies]
        self._obstacles: list[_Obstacle] = []
        if mesh is not None:
            kept_off = np.concatenate([np.ones(self._of_arm, dtype=bool), of_hand])
            margins = np.full(len(bodies), margin)
            self._obstacles.append(_Obstacle("object", mesh, kept_off, margins))
        beside = None if station.table is None else station.table.surroundings.mesh
        if beside is not None:
            self._obstacles.append(
                _Obstacle("obstacle", beside, self._above_table, self._clearance)
            )

    def free(self, q: FloatArray, q_hand: FloatArray) -> BoolArray:
        """Return which postures of the arm, (N, J), are free of collisions, shape (N,).

        `q_hand` (K,) or (N, K) are the hand's joint positions.
        """
        poses = self._poses(q, q_hand)
        centers = self._pairs.ball_centers(poses)
        near = self._near(centers)
        pairs = self._pairs.may_touch(centers)
        unclear = np.flatnonzero(near.any(axis=(1, 2)) | pairs.any(axis=1))
        free = np.ones(len(poses), dtype=bool)
        for n in unclear:
            free[n] = self._hit(poses[n], near[n], pairs[n]) is None
        return free

    def first_hit(self, q: FloatArray, q_hand: FloatArray) -> tuple[Obstacle, str] | None:
        """Return what a posture (J,) with the hand at (K,) collides with, and the link that does.

        None if it is free.
        """
        poses = self._poses(q[None], q_hand)
        centers = self._pairs.ball_centers(poses)
        return self._hit(poses[0], self._near(centers)[0], self._pairs.may_touch(centers)[0])

    def travel(self, q: FloatArray, q_hand: FloatArray) -> float:
        """Return the longest path of any point of arm or hand along postures (N, J) [m].

        It is measured from posture to posture.
        """
        centers = self._pairs.ball_centers(self._poses(q, q_hand))  # (N, B, 3)
        steps = np.linalg.norm(np.diff(centers, axis=0), axis=2)
        return float(steps.max(axis=1).sum())

    def arm_points(self, q: FloatArray) -> FloatArray:
        """Return points all along the moving links of the arm at postures (N, J), (P, 3) [m]."""
        station = self._station
        links = station.arm.forward_kinematics(station.X_WA, q)
        fixed = station.arm.fixed_links
        points = []
        for geometry in station.arm.link_geometries:
            if geometry.link not in fixed:
                X_WG = links[geometry.link] @ geometry.X_LG
                centers = balls_around(geometry)[0]
                points.append(apply_pose(X_WG, centers))
        return np.concatenate(points, axis=1).reshape(-1, 3)

    def _poses(self, q: FloatArray, q_hand: FloatArray) -> FloatArray:
        """Return the poses of all bodies in W, (N, G, 4, 4)."""
        station = self._station
        links = station.arm.forward_kinematics(station.X_WA, q)
        of_arm = [links[g.link] @ g.X_LG for g in station.arm.link_geometries]
        X_WH = station.palm_poses(q)
        in_hand = station.hand.forward_kinematics(np.eye(4), q_hand)
        of_hand = [X_WH @ (in_hand[g.link] @ g.X_LG) for g in station.hand.link_geometries]
        return np.stack([*of_arm, *of_hand], axis=1)

    def _near(self, centers: FloatArray) -> BoolArray:
        """Return which bodies are not surely off the table and O obstacles, (N, G, 1 + O)."""
        balls, radii = self._pairs.body, self._pairs.radii
        low = np.zeros(centers.shape[:2], dtype=bool)
        table = self._station.table
        if table is not None:
            low = centers[..., 2] < table.height + radii + self._clearance[balls]
            aside = np.abs(centers[..., :2] - table.center) > table.half_width + radii[:, None]
            low &= ~aside.any(axis=-1) & self._above_table[balls]
        kinds = [low]
        for obstacle in self._obstacles:
            close = obstacle.distances_at_least(centers) < radii + obstacle.margins[balls]
            kinds.append(close & obstacle.kept_off[balls])
        starts = np.searchsorted(balls, np.arange(len(self._names)))
        return np.stack([np.logical_or.reduceat(k, starts, axis=1) for k in kinds], axis=-1)

    def _hit(
        self, poses: FloatArray, near: BoolArray, pairs: BoolArray
    ) -> tuple[Obstacle, str] | None:
        for body in np.flatnonzero(near[:, 0]):
            if self._lowest(int(body), poses[body]) < self._clearance[body] + self._height:
                return "table", self._names[body]
        candidates = np.flatnonzero(pairs)
        of_pairs = self._pairs.pairs[candidates].ravel()
        placed = np.flatnonzero(near[:, 1:].any(axis=1))
        self._pairs.place(poses, {*placed.tolist(), *of_pairs.tolist()})
        for number, obstacle in enumerate(self._obstacles, start=1):
            for body in np.flatnonzero(near[:, number]):
                apart = self._pairs.distance_to(int(body), obstacle.model)
                if apart <= obstacle.margins[body]:
                    return obstacle.kind, self._names[body]
        pair = next(self._pairs.touching(candidates), None)
        return None if pair is None else ("self", self._names[self._pairs.pairs[pair][1]])

    @property
    def _height(self) -> float:
        table = self._station.table
        return -np.inf if table is None else table.height

    def _lowest(self, body: int, X_WG: FloatArray) -> float:
        """Return the height of a body's lowest point over the table's top [m]; inf beside it."""
        points, radius = self._outlines[body]
        placed = apply_pose(X_WG, points)
        table = self._station.table
        assert table is not None
        inside = (np.abs(placed[:, :2] - table.center) <= table.half_width + radius).all(axis=1)
        return float(placed[inside, 2].min(initial=np.inf)) - radius


class _Obstacle:
    """A mesh, and which bodies are to keep off it, (G,), by which distances (G,) [m]."""

    def __init__(
        self, kind: Obstacle, mesh: trimesh.Trimesh, kept_off: BoolArray, margins: FloatArray
    ) -> None:
        self.kind, self.kept_off, self.margins = kind, kept_off, margins
        self._low, self._high = np.asarray(mesh.bounds)
        self.model = fcl.CollisionObject(mesh_to_BVH(mesh), fcl.Transform())

    def distances_at_least(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (..., 3) from the bounding box, 0 inside, (...) [m]."""
        outside = np.maximum(np.maximum(self._low - points, points - self._high), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=-1))


def _pairs(station: MountedHand) -> npt.NDArray[np.intp]:
    """Return the pairs of bodies of arm and hand that must not touch, (P, 2)."""
    arm, hand = station.arm, station.hand
    order, last = arm.joints_before, arm.joints_before[arm.flange]
    own = arm.link_geometries
    # The mount keeps the hand off the link that it is mounted on.
    between = [
        (i, len(own) + j)
        for i, a in enumerate(own)
        for j in range(len(hand.link_geometries))
        if order[a.link] < last
    ]
    pairs = pairs_of_bodies(arm, arm.self_collision_exclusions)
    return np.vstack([pairs, np.array(between, dtype=np.intp).reshape(-1, 2)])
