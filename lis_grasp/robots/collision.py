"""Collision checks of a hand with an object, its support, obstacles and itself (python-fcl)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import fcl
import numpy as np
import trimesh
from trimesh.collision import mesh_to_BVH

from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.robots.body_pairs import fcl_shape, hull_points
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.mesh_distance import InsideTest
from lis_grasp.typing import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class NearestLink:
    """The link of a hand that is nearest to an object."""

    link: str
    distance: float  # between both [m], 0 or less where they touch
    point: FloatArray  # (3,) [m], in O: the object's nearest point
    face: int  # triangle of the object's mesh that the point is on
    body: str | None = None  # the body beside the object, if the link is nearest to that


class HandCollisionChecker:
    """Checks a hand's links for collisions, and finds the link nearest to the object.

    Bodies are built once and moved. A triangle mesh is a shell to FCL, so a body wholly inside the
    object is found by the winding number of one of its points.

    Parameters
    ----------
    hand
        The hand.
    mesh
        Closed triangle mesh of the object in O [m]; None for the hand, support and obstacles alone.
    support_height
        Height of the supporting plane in O [m]; None without one.
    clearance
        Least distance of the hand from the support [m].
    obstacles
        Mesh in O of what no link may touch [m]; None without any. It may be open: only its closed
        parts have an inside.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh | None = None,
        *,
        support_height: float | None = None,
        clearance: float = 0.002,
        obstacles: trimesh.Trimesh | None = None,
    ) -> None:
        self._hand = hand
        self._object = None if mesh is None else _Solid(mesh, [mesh])
        self._obstacles = None
        if obstacles is not None:  # they may be open
            closed = obstacles.split(only_watertight=True, repair=False)
            self._obstacles = _Solid(obstacles, closed)
        self._floor = None if support_height is None else support_height + clearance
        shapes = [fcl_shape(geometry) for geometry in hand.link_geometries]
        self._bodies = [fcl.CollisionObject(shape, fcl.Transform()) for shape in shapes]
        self._outlines = [hull_points(g) for g in hand.link_geometries]
        # A point of each body in its frame, (G, 3): a vertex, or the middle of a simple shape.
        self._points = np.array(
            [g.mesh.vertices[0] if g.kind == "mesh" else np.zeros(3) for g in hand.link_geometries]
        )
        self._manager = fcl.DynamicAABBTreeCollisionManager()
        self._manager.registerObjects(self._bodies)
        self._manager.setup()
        tips = hand.fingertip_links
        self._is_tip = [geometry.link in tips for geometry in hand.link_geometries]
        self._inner = fcl.DynamicAABBTreeCollisionManager()
        self._inner.registerObjects(
            [body for body, is_tip in zip(self._bodies, self._is_tip, strict=True) if not is_tip]
        )
        self._inner.setup()
        # A contact names the two shapes that meet, by identity.
        self._shapes = shapes
        self._index = {id(shape): i for i, shape in enumerate(shapes)}
        self._pads = hand.pad_links

    def first_collisions(
        self,
        paths: FloatArray,
        q: FloatArray,
        *,
        pads_may_touch: bool = False,
        tips_lower: float = 0.0,
    ) -> list[str | None]:
        """Return the first collision on each of N paths, None if there is none.

        It is ``"support"``, ``"obstacle"``, ``"object"`` or ``"self"``.

        `paths` (N, W, 4, 4) are poses of the palm in O, `q` (N, J) joint positions. With
        `pads_may_touch` the links that carry pads may touch the object, and nothing else.
        Fingertips may be closer to the support than the clearance, by `tips_lower` [m].
        """
        poses = self.poses_in_hand(q)  # (N, G, 4, 4)
        # (N, W)
        heights = self.lowest(paths[:, :, None] @ poses[:, None], tips_lower=tips_lower)
        return [
            self._first_collision(*each, pads_may_touch=pads_may_touch)
            for each in zip(paths, heights, poses, strict=True)
        ]

    def hit_obstacle(self, paths: FloatArray, q: FloatArray) -> BoolArray:
        """Return which of N paths (N, W, 4, 4) hit an obstacle at joint positions (N, J), (N,)."""
        if self._obstacles is None:
            return np.zeros(len(paths), dtype=bool)
        hits = []
        for path, poses in zip(paths, self.poses_in_hand(q), strict=True):
            self._pose(poses)
            hits.append(any(self._meets(self._obstacles, X, poses) for X in path))
        return np.array(hits, dtype=bool)

    def clearances(self, X_OH: FloatArray, q: FloatArray) -> FloatArray:
        """Return how far links other than fingertips are off the object's surface [m], or 0.

        Shape (N,), of N postures: (N, 4, 4) and (N, J).
        """
        poses = X_OH[:, None] @ self.poses_in_hand(q)  # (N, G, 4, 4)
        return np.array([self._clearance(posture) for posture in poses])

    def poses_in_hand(self, q: FloatArray) -> FloatArray:
        """Return the poses X_HG (..., G, 4, 4) of all bodies at joint positions q, (..., J)."""
        links = self._hand.forward_kinematics(np.eye(4), q)
        return np.stack([links[g.link] @ g.X_LG for g in self._hand.link_geometries], axis=-3)

    def place(self, X_OH: FloatArray, poses: FloatArray) -> bool:
        """Place the hand for `nearest`, and return whether it meets the object's surface.

        A hand wholly inside the object does not meet its surface. `poses` (G, 4, 4) are those of
        `poses_in_hand`; `X_OH` (4, 4) is the pose of the palm in O.
        """
        assert self._object is not None
        self._pose(X_OH @ poses)
        return self._meets_surface(self._object)

    def distance(self, moved: FloatArray) -> float:
        """Return the distance of `nearest` [m], without its link."""
        return float(self._nearest(moved).min_distance)

    def nearest(self, moved: FloatArray) -> NearestLink:
        """Return the link nearest to the object after moving the placed hand by (3,) [m] in O."""
        result = self._nearest(moved)
        assert self._object is not None
        triangles = self._object.mesh.triangles
        first = result.o1 is self._object.model
        body = self._index[id(result.o2 if first else result.o1)]
        face = int(result.b1 if first else result.b2)
        if self._hand.link_geometries[body].kind == "sphere":
            # FCL gives the nearest points of spheres in other frames.
            near = self._bodies[body].getTranslation()
        else:
            near = np.asarray(result.nearest_points[0 if first else 1])
        point = trimesh.triangles.closest_point(triangles[face][None], (near + moved)[None])[0]
        link = self._hand.link_geometries[body].link
        return NearestLink(link, float(result.min_distance), point, face)

    def _nearest(self, moved: FloatArray) -> fcl.DistanceResult:
        assert self._object is not None
        other = self._object.body
        other.setTranslation(-moved)  # equivalent, with one body to move
        try:
            data = fcl.DistanceData(request=fcl.DistanceRequest(enable_nearest_points=True))
            self._manager.distance(other, data, fcl.defaultDistanceCallback)
        finally:
            other.setTranslation(np.zeros(3))
        return data.result

    def _pose(self, poses: FloatArray) -> None:
        for body, X_OG in zip(self._bodies, poses, strict=True):
            body.setTransform(fcl.Transform(X_OG[:3, :3], X_OG[:3, 3]))
        self._manager.update()

    def lowest(self, poses: FloatArray, *, tips_lower: float = 0.0) -> FloatArray:
        """Return the height of the hand's lowest point [m], bodies at poses X_OG (..., G, 4, 4).

        Points of fingertips count as higher by `tips_lower` [m].
        """
        heights = [
            (X[..., 2, :3] @ points.T).min(axis=-1) + X[..., 2, 3] - thickness + tips_lower * is_tip
            for (points, thickness), X, is_tip in zip(
                self._outlines, np.moveaxis(poses, -3, 0), self._is_tip, strict=True
            )
        ]
        return np.asarray(np.min(heights, axis=0))

    def _first_collision(
        self, path: FloatArray, heights: FloatArray, in_hand: FloatArray, *, pads_may_touch: bool
    ) -> str | None:
        self._pose(in_hand)
        for w, (X, height) in enumerate(zip(path, heights, strict=True)):
            if self._floor is not None and height < self._floor:
                return "support"
            if self._meets(self._obstacles, X, in_hand):
                return "obstacle"
            if self._meets(self._object, X, in_hand, pads_may_touch=pads_may_touch):
                return "object"
            if w == 0 and self._self_collisions():
                return "self"
        return None

    def _clearance(self, poses: FloatArray) -> float:
        assert self._object is not None
        self._pose(poses)
        self._inner.update()
        data = fcl.DistanceData()
        self._inner.distance(self._object.body, data, fcl.defaultDistanceCallback)
        # Without such links it is the largest number; a metre is as good.
        return min(max(float(data.result.min_distance), 0.0), 1.0)

    def _meets(
        self,
        other: _Solid | None,
        X_OH: FloatArray,
        in_hand: FloatArray,
        *,
        pads_may_touch: bool = False,
    ) -> bool:
        """Return whether the hand at a pose meets a body, if any; its bodies are posed in H."""
        if other is None:
            return False
        X_HO = inverse_pose(X_OH)  # one body to move, instead of all links
        other.body.setTransform(fcl.Transform(X_HO[:3, :3], X_HO[:3, 3]))
        try:
            if self._meets_surface(other, pads_may_touch=pads_may_touch):
                return True
        finally:
            other.body.setTransform(fcl.Transform())
        inside = apply_pose(in_hand, self._points[:, None])[:, 0]
        return other.contains_any(apply_pose(X_OH, inside))

    def _meets_surface(self, other: _Solid, *, pads_may_touch: bool = False) -> bool:
        data = fcl.CollisionData()
        self._manager.collide(other.body, data, fcl.defaultCollisionCallback)
        if not data.result.is_collision or not pads_may_touch:
            return bool(data.result.is_collision)
        return any(
            fcl.collide(body, other.body, fcl.CollisionRequest(), fcl.CollisionResult())
            for body, geometry in zip(self._bodies, self._hand.link_geometries, strict=True)
            if geometry.link not in self._pads
        )

    def self_collisions(self, q: FloatArray) -> set[tuple[str, str]]:
        """Return the pairs of links that collide at joint positions q, (J,), each pair sorted.

        Pairs that may touch (`Hand.self_collision_exclusions`) are left out.
        """
        self._pose(self.poses_in_hand(q))
        return self._self_collisions()

    def _self_collisions(self) -> set[tuple[str, str]]:
        data = fcl.CollisionData(
            request=fcl.CollisionRequest(num_max_contacts=100_000, enable_contact=True)
        )
        self._manager.collide(data, fcl.defaultCollisionCallback)
        geometries, pairs = self._hand.link_geometries, set()
        for contact in data.result.contacts:
            first = geometries[self._index[id(contact.o1)]].link
            second = geometries[self._index[id(contact.o2)]].link
            if first != second:
                pairs.add((min(first, second), max(first, second)))
        return pairs - self._hand.self_collision_exclusions


class _Solid:
    """A mesh that the hand may meet, its body, and the insides of its closed parts."""

    def __init__(self, mesh: trimesh.Trimesh, closed: Iterable[trimesh.Trimesh]) -> None:
        self.mesh, self.model = mesh, mesh_to_BVH(mesh)
        self.body = fcl.CollisionObject(self.model, fcl.Transform())
        self._insides = [InsideTest(part) for part in closed]

    def contains_any(self, points: FloatArray) -> bool:
        """Return whether any of the points (P, 3) [m] is inside a closed part."""
        return any(inside.any_inside(points) for inside in self._insides)
