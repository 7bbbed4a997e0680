"""Collisions of a hand, and of the object that it carries, with the bodies beside the object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import fcl
import numpy as np
import trimesh

from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.grasping.lift_path import LIFT_STEP, LiftPath
from lis_grasp.grasping.surface_uncertainty import PALM_ERROR
from lis_grasp.robots.body_pairs import balls_around, fcl_shape
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import LinkGeometry
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings


class Hit(NamedTuple):
    """A collision: the reason of rejection, and the name of the body that would be hit."""

    reason: str
    body: str


class BodyClearance:
    """Finds the bodies that a hand, or the object in it, would hit.

    Balls that cover the links show at once which links cannot touch which bodies; only the others
    are checked one by one.

    Parameters
    ----------
    hand
        The hand.
    mesh
        The object as known, in O [m].
    surroundings
        The bodies beside it, in O.
    support_height
        Height of the object's support in O [m], which a carried object must not hit; None without.
    margin
        Least distance from the bodies [m], such as the error of their places. The hand keeps
        `PALM_ERROR` more.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        surroundings: Surroundings,
        *,
        support_height: float | None = None,
        margin: float = 0.0,
    ) -> None:
        self._hand = hand
        self._bodies = [_Body(body) for body in surroundings]
        self._margin = margin
        self._links = _Group(hand.link_geometries)
        self._object = _Group([LinkGeometry("object", np.eye(4), "mesh", (), mesh)])
        self._object.place(np.eye(4)[None])
        self._hull = np.asarray(mesh.convex_hull.vertices)
        # An estimate may reach below its support: that is its error, and not carried into anything.
        lowest = float(mesh.bounds[0, 2])
        self._floor = None if support_height is None else min(support_height, lowest)

    def hit_by_hand(self, path: FloatArray, q: FloatArray) -> str | None:
        """Return the body that a hand with joints q (J,) hits on a path (W, 4, 4) of its palm."""
        links = self._hand.forward_kinematics(np.eye(4), q)
        poses = np.array([links[g.link] @ g.X_LG for g in self._hand.link_geometries])
        self._links.place(poses)
        for body in self._bodies:
            inside = body.contains_any(apply_pose(path[0], poses[:, :3, 3]))
            if inside or body.meets(self._links, path, self._margin + PALM_ERROR):
                return body.name
        return None

    def hit_by_object(self, X_OH: FloatArray, palms: FloatArray) -> str | None:
        """Return the body that an object hits in a palm that moves from (4, 4) to (W, 4, 4)."""
        moved = palms @ inverse_pose(X_OH)
        if self._floor is not None:
            lowest = moved[:, 2, :3] @ self._hull.T + moved[:, 2, 3:]
            if lowest.min() < self._floor:
                return "table"
        for body in self._bodies:
            if body.meets(self._object, moved, self._margin):
                return body.name
        return None

    def first_free_lift(
        self,
        lifts: Sequence[LiftPath],
        X_OH: FloatArray,
        *,
        q: FloatArray,
        opened: FloatArray,
        back: FloatArray,
    ) -> LiftPath | Hit:
        """Return the first lift without a collision, or else the first collision of the first lift.

        Checked are the hand with joints q (J,), what it carries, and the opened hand (J,) that lets
        go: it retreats by `back` (3,) [m] at the lift's height, and then goes down.
        """
        hits = []
        for lift in lifts:
            hit = self._hit_on_lift(lift, X_OH, q=q, opened=opened, back=back)
            if hit is None:
                return lift
            hits.append(hit)
        return hits[0]

    def _hit_on_lift(
        self,
        lift: LiftPath,
        X_OH: FloatArray,
        *,
        q: FloatArray,
        opened: FloatArray,
        back: FloatArray,
    ) -> Hit | None:
        palms = lift.palms(self._hand, X_OH)
        if body := self.hit_by_hand(palms, q):
            return Hit("lift_hits_obstacle", body)
        if body := self.hit_by_object(X_OH, palms):
            return Hit("carried_hits_obstacle", body)
        up = LiftPath.straight(lift.height).displacements[:, :3, 3]
        steps = np.linspace(0.0, 1.0, int(np.ceil(np.linalg.norm(back) / LIFT_STEP)) + 1)
        ways = np.concatenate([up[-1] + steps[:, None] * back, back + up])
        retreat = np.repeat(X_OH[None], len(ways), axis=0)
        retreat[:, :3, 3] += ways
        if body := self.hit_by_hand(retreat, opened):
            return Hit("retreat_hits_obstacle", body)
        return None


class _Group:
    """Rigid bodies that move together, with balls that cover each of them."""

    def __init__(self, geometries: Sequence[LinkGeometry]) -> None:
        self.objects = [fcl.CollisionObject(fcl_shape(g), fcl.Transform()) for g in geometries]
        covers = [balls_around(geometry) for geometry in geometries]
        self._counts = [len(radii) for _, radii in covers]
        self.starts = np.concatenate([[0], np.cumsum(self._counts)[:-1]]).astype(np.intp)
        self._centers_G = np.concatenate([centers for centers, _ in covers])
        self.radii = np.concatenate([radii for _, radii in covers])

    def place(self, poses: FloatArray) -> None:
        """Place the bodies at poses (G, 4, 4) in the frame of the group."""
        for placed, X in zip(self.objects, poses, strict=True):
            placed.setTransform(fcl.Transform(X[:3, :3], X[:3, 3]))
        X = np.repeat(poses, self._counts, axis=0)
        self.centers = apply_pose(X, self._centers_G[:, None])[:, 0]  # (M, 3)
        self.middle = self.centers.mean(axis=0)
        self.radius = float((np.linalg.norm(self.centers - self.middle, axis=1) + self.radii).max())


class _Body:
    """A body beside the object, for collision checks."""

    def __init__(self, body: Body) -> None:
        self.name, self._body = body.name, body
        self._shapes = [_Shape(g, body.X_EB @ g.X_LG) for g in body.geometries]
        self._is_mesh = any(g.kind == "mesh" for g in body.geometries)

    def contains_any(self, points: FloatArray) -> bool:
        """Return whether any of the points (P, 3) is inside a closed mesh, which is a shell."""
        return self._is_mesh and bool((self._body.distances(points) < 0.0).any())

    def meets(self, group: _Group, path: FloatArray, margin: float) -> bool:
        """Return whether a group is within a margin [m] of it at one of its poses (W, 4, 4)."""
        return any(shape.meets(group, path, margin) for shape in self._shapes)


class _Shape:
    """A shape of a body beside the object, at a pose (4, 4) in O."""

    def __init__(self, geometry: LinkGeometry, X_OG: FloatArray) -> None:
        self._object = fcl.CollisionObject(fcl_shape(geometry), fcl.Transform())
        self._X_GO = inverse_pose(X_OG)
        self._low, self._high = np.asarray(geometry.mesh.bounds)

    def meets(self, group: _Group, path: FloatArray, margin: float) -> bool:
        """Return whether a group is within a margin [m] of it at one of its poses (W, 4, 4)."""
        X = self._X_GO @ path  # of the group in G
        near = np.flatnonzero(self._apart(apply_pose(X, group.middle)) < group.radius + margin)
        for w in near:
            close = self._apart(apply_pose(X[w], group.centers)) < group.radii + margin
            links = np.flatnonzero(np.logical_or.reduceat(close, group.starts))
            if len(links):
                X_inverse = inverse_pose(X[w])
                self._object.setTransform(fcl.Transform(X_inverse[:3, :3], X_inverse[:3, 3]))
            if any(self._is_near(group.objects[link], margin) for link in links):
                return True
        return False

    def _is_near(self, link: fcl.CollisionObject, margin: float) -> bool:
        if fcl.collide(link, self._object, fcl.CollisionRequest(), fcl.CollisionResult()):
            return True
        if margin == 0.0:
            return False
        distance = fcl.distance(link, self._object, fcl.DistanceRequest(), fcl.DistanceResult())
        return bool(distance < margin)

    def _apart(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (..., 3) in G from the shape's bounding box."""
        outside = np.maximum(np.maximum(self._low - points, points - self._high), 0.0)
        return np.asarray(np.linalg.norm(outside, axis=-1))
