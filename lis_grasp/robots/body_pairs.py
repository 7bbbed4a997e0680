"""Collisions between pairs of bodies: many postures at once by balls, then exactly (python-fcl)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

import fcl
import numpy as np
from trimesh.collision import mesh_to_BVH

from lis_grasp.geometry import apply_pose
from lis_grasp.robots.robot_model import LinkGeometry, RobotModel
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Largest number of balls that cover one body, and the radius at which they are small enough [m]:
# more are closer to the body, and slower.
_MOST_BALLS, _SMALL = 12, 0.025


class BodyPairs:
    """Bodies of links, and the pairs of them that must not touch.

    G bodies, P pairs, N postures. Balls that cover the bodies show at once which pairs cannot touch
    in many postures; only the others are checked one by one.

    Parameters
    ----------
    geometries
        The G bodies.
    pairs
        Indices of the pairs, shape (P, 2).
    """

    def __init__(self, geometries: Sequence[LinkGeometry], pairs: IndexArray) -> None:
        self.geometries, self.pairs = tuple(geometries), pairs
        self._objects = [fcl.CollisionObject(fcl_shape(g), fcl.Transform()) for g in geometries]
        covers = [balls_around(geometry) for geometry in geometries]
        self.body = np.repeat(np.arange(len(covers)), [len(radii) for _, radii in covers])
        self._centers = np.concatenate([np.zeros((0, 3)), *(c for c, _ in covers)])  # (B, 3) in G
        self.radii = np.concatenate([np.zeros(0), *(r for _, r in covers)])  # (B,)
        self._balls = [np.flatnonzero(self.body == body) for body in range(len(covers))]
        # One ball about each body, for the first of two passes.
        self._around = np.array(
            [
                np.linalg.norm(c - c.mean(axis=0), axis=1).max(initial=0.0) + r.max()
                for c, r in covers
            ]
        )
        self._starts = np.array([balls[0] for balls in self._balls], dtype=np.intp)
        self._counts = np.array([len(balls) for balls in self._balls])

    def ball_centers(self, poses: FloatArray) -> FloatArray:
        """Return the centres of the balls, (N, B, 3) [m], at poses of the bodies (N, G, 4, 4)."""
        X = poses[:, self.body]
        return np.asarray(apply_pose(X, self._centers[:, None])[..., 0, :])

    def may_touch(self, centers: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which pairs are not surely apart by a margin [m], (N, P), for `ball_centers`."""
        if not len(self.pairs):
            return np.zeros((len(centers), 0), dtype=bool)
        middles = np.add.reduceat(centers, self._starts, axis=1) / self._counts[:, None]
        first, second = self.pairs.T
        reach = self._around[first] + self._around[second] + margin
        near = _closer(middles[:, first], middles[:, second], reach)
        for pair in np.flatnonzero(near.any(axis=0)):
            postures = np.flatnonzero(near[:, pair])
            mine, other = (self._balls[body] for body in self.pairs[pair])
            reach = self.radii[mine][:, None] + self.radii[other] + margin
            here = centers[postures]
            close = _closer(here[:, mine][:, :, None], here[:, other][:, None], reach)
            near[postures, pair] = close.any(axis=(1, 2))
        return near

    def place(self, poses: FloatArray, bodies: Iterable[int] | None = None) -> None:
        """Place bodies, by default all, at poses (G, 4, 4) for `touching` and distances."""
        for body in range(len(poses)) if bodies is None else bodies:
            X = poses[body]
            self._objects[body].setTransform(fcl.Transform(X[:3, :3], X[:3, 3]))

    def touching(self, candidates: IndexArray) -> Iterator[int]:
        """Yield the pairs, of these indices, that touch where the bodies are placed."""
        request = fcl.CollisionRequest()
        for pair in candidates:
            i, j = self.pairs[pair]
            if fcl.collide(self._objects[i], self._objects[j], request, fcl.CollisionResult()):
                yield int(pair)

    def distance(self, pair: int) -> float:
        """Return the distance of a pair as the bodies are placed [m]; 0 or less if they touch."""
        first, second = self.pairs[pair]
        return self.distance_to(first, self._objects[second])

    def distance_to(self, body: int, obstacle: fcl.CollisionObject) -> float:
        """Return the distance of a body, as it is placed, from an obstacle [m]."""
        result = fcl.DistanceResult()
        return float(fcl.distance(self._objects[body], obstacle, fcl.DistanceRequest(), result))


def _closer(a: FloatArray, b: FloatArray, reach: FloatArray) -> BoolArray:
    """Return which points (..., 3) are closer than a reach (...) [m]."""
    apart = a - b
    return np.asarray(np.einsum("...k,...k->...", apart, apart) < reach**2)


def balls_around(geometry: LinkGeometry) -> tuple[FloatArray, FloatArray]:
    """Return centres (B, 3) in G and radii (B,) [m] of balls that cover a body."""
    if geometry.kind == "sphere":
        return np.zeros((1, 3)), np.array(geometry.dimensions)
    low, high = np.asarray(geometry.mesh.bounds)
    sides = high - low
    # Cut the bounding box into about cubic cells, each covered by one ball.
    cells = np.ones(3, dtype=int)
    while 0.5 * np.linalg.norm(sides / cells) > _SMALL:
        finer = cells + (np.arange(3) == np.argmax(sides / cells))
        if np.prod(finer) > _MOST_BALLS:
            break
        cells = finer
    steps = [low[k] + (np.arange(cells[k]) + 0.5) * sides[k] / cells[k] for k in range(3)]
    centers = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    radius = 0.5 * float(np.linalg.norm(sides / cells))
    return centers, np.full(len(centers), radius)


def pairs_of_bodies(model: RobotModel, exclusions: frozenset[tuple[str, str]]) -> IndexArray:
    """Return the indices of the bodies that must not touch each other, (P, 2)."""
    pairs = [
        (i, j)
        for (i, a), (j, b) in combinations(enumerate(model.link_geometries), 2)
        if a.link != b.link and (min(a.link, b.link), max(a.link, b.link)) not in exclusions
    ]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def fcl_shape(geometry: LinkGeometry) -> fcl.CollisionGeometry:
    """Return FCL's shape of a link's body."""
    if geometry.kind == "mesh":
        return mesh_to_BVH(geometry.mesh)
    return getattr(fcl, geometry.kind.capitalize())(*geometry.dimensions)


def hull_points(geometry: LinkGeometry) -> tuple[FloatArray, float]:
    """Return points and a radius: balls of that radius about the points cover the body's hull."""
    if geometry.kind == "sphere":
        return np.zeros((1, 3)), geometry.dimensions[0]
    if geometry.kind == "capsule":
        radius, length = geometry.dimensions
        return np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]]), radius
    return np.asarray(geometry.mesh.vertices), 0.0
