"""Collision checks of an arm with its hand: itself, table, obstacles, the object's estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import fcl
import numpy as np
import numpy.typing as npt
import trimesh
from trimesh.collision import mesh_to_BVH

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.body_pairs import BodyPairs, balls_around, outline, pairs_of_bodies
from lis_grasp.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from lis_grasp.arms.station import Station

Obstacle = Literal["table", "obstacle", "object", "self"]

ARM_CLEARANCE = 0.01
"""Least distance of the arm's links from the table and from obstacles [m]."""
HAND_CLEARANCE = 0.0003
"""The same of the hand's links [m], which grasps of low objects need."""

# Largest displacement of a vertex, in margins: enough for the corner of a box (1.7). More would
# grow spikes on a rough mesh.
_LONGEST_MITRE = 2.0
# Cosine to the faces' normals from which a vertex lies on no edge.
_FLAT = 0.99


class StationChecker:
    """Checks postures of an arm with a hand for collisions.

    Many postures are checked at once by balls that cover the links; what they do not show to be
    free is checked by FCL. Checked are the arm's links with each other, with the hand, with the
    table, its obstacles and the object, and the hand with these too; not the hand with itself.
    The object is a closed mesh in W [m], true or estimated, enlarged by a margin [m] that the hand
    also keeps from the table. With `arm_only` the hand may touch both, as at a grasp.
    """

    def __init__(
        self,
        station: Station,
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
        self._clear_of_object = np.concatenate([np.ones(self._of_arm, dtype=bool), of_hand])
        self._clearance = np.where(
            np.arange(len(bodies)) < self._of_arm,
            max(ARM_CLEARANCE, margin),
            HAND_CLEARANCE + margin,
        )
        self._outlines = [outline(g) for g in bodies]
        self._object = None if mesh is None else _Enlarged(mesh, margin)
        table = station.table
        obstacles = None if table is None else table.obstacles
        self._obstacles = None if obstacles is None else _Enlarged(obstacles, 0.0)

    def free(self, q: FloatArray, q_hand: FloatArray) -> BoolArray:
        """Return which postures of the arm, (N, J), collide with nothing, shape (N,).

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
        """Return the longest way of a point of arm or hand along postures (N, J) [m].

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
        """Return which bodies are not surely off table, object and obstacles, (N, G, 3)."""
        balls, radii = self._pairs.body, self._pairs.radii
        low = np.zeros(centers.shape[:2], dtype=bool)
        table = self._station.table
        if table is not None:
            low = centers[..., 2] < table.height + radii + self._clearance[balls]
            aside = np.abs(centers[..., :2] - table.center) > table.half_width + radii[:, None]
            low &= ~aside.any(axis=-1) & self._above_table[balls]
        close = np.zeros_like(low)
        if self._object is not None:
            close = self._object.distances_at_least(centers) < radii
            close &= self._clear_of_object[balls]
        beside = np.zeros_like(low)
        if self._obstacles is not None:
            beside = self._obstacles.distances_at_least(centers) < radii + self._clearance[balls]
            beside &= self._above_table[balls]
        starts = np.searchsorted(balls, np.arange(len(self._names)))
        kinds = (low, close, beside)
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
        if self._object is not None:
            for body in np.flatnonzero(near[:, 1]):
                if self._pairs.touches(int(body), self._object.model):
                    return "object", self._names[body]
        if self._obstacles is not None:
            for body in np.flatnonzero(near[:, 2]):
                apart = self._pairs.distance_to(int(body), self._obstacles.model)
                if apart < self._clearance[body]:
                    return "obstacle", self._names[body]
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


class _Enlarged:
    """An obstacle's mesh, enlarged so that its faces move outwards by a margin [m].

    At cones and sharp wedges they move less, because vertices move by at most two margins.
    """

    def __init__(self, mesh: trimesh.Trimesh, margin: float) -> None:
        grown = mesh
        if margin:
            vertices = mesh.vertices + margin * _displacements(mesh)
            grown = trimesh.Trimesh(vertices, mesh.faces, process=False)
        self._low, self._high = np.asarray(grown.bounds)
        self._shape = mesh_to_BVH(grown)
        self.model = fcl.CollisionObject(self._shape, fcl.Transform())

    def distances_at_least(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (..., 3) from the bounding box, 0 inside, (...) [m]."""
        outside = np.maximum(np.maximum(self._low - points, points - self._high), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=-1))


def _displacements(mesh: trimesh.Trimesh) -> FloatArray:
    """Return displacements of the vertices, (V, 3), that move each face by 1 along its normal."""
    displacements = np.array(mesh.vertex_normals)
    cosines = np.einsum("fk,fvk->fv", mesh.face_normals, displacements[mesh.faces])
    least = np.ones(len(displacements))
    np.minimum.at(least, mesh.faces, cosines)
    for vertex in np.flatnonzero(least < _FLAT):
        faces = mesh.vertex_faces[vertex]
        normals = mesh.face_normals[faces[faces >= 0]]
        normals = normals[normals.any(axis=1)]  # a face without area has none
        moved = np.linalg.lstsq(normals, np.ones(len(normals)))[0]
        displacements[vertex] = moved * min(1.0, _LONGEST_MITRE / np.linalg.norm(moved))
    return displacements


def _pairs(station: Station) -> npt.NDArray[np.intp]:
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
