"""Collisions between pairs of bodies: many postures at once by balls, then exactly (python-fcl)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import fcl
import numpy as np

from lis_grasp.hands.collision import fcl_shape
from lis_grasp.hands.hand_parts import LinkGeometry
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Largest number of balls that cover one body; more are closer to it and slower.
_MOST_BALLS = 12


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
        balls = [np.flatnonzero(self.body == body) for body in range(len(covers))]
        products = [np.stack(np.meshgrid(balls[i], balls[j]), -1).reshape(-1, 2) for i, j in pairs]
        self._ball_pairs = np.concatenate([np.zeros((0, 2), dtype=np.intp), *products])
        self._reach = self.radii[self._ball_pairs].sum(axis=1)
        sizes = [len(product) for product in products]
        self._starts = np.cumsum([0, *sizes[:-1]])

    def ball_centers(self, poses: FloatArray) -> FloatArray:
        """Return the centres of the balls, (N, B, 3) [m], at poses of the bodies (N, G, 4, 4)."""
        X = poses[:, self.body]
        return np.asarray((X[..., :3, :3] @ self._centers[:, :, None])[..., 0] + X[..., :3, 3])

    def may_touch(self, centers: FloatArray, *, margin: float = 0.0) -> BoolArray:
        """Return which pairs are not surely apart by a margin [m], (N, P), for `ball_centers`."""
        if not len(self.pairs):
            return np.zeros((len(centers), 0), dtype=bool)
        first, second = self._ball_pairs.T
        apart = centers[:, first] - centers[:, second]
        near = np.einsum("npk,npk->np", apart, apart) < (self._reach + margin) ** 2
        return np.asarray(np.logical_or.reduceat(near, self._starts, axis=1))

    def place(self, poses: FloatArray) -> None:
        """Place the bodies at poses (G, 4, 4) for `touching` and `object_of`."""
        for body, X in zip(self._objects, poses, strict=True):
            body.setTransform(fcl.Transform(X[:3, :3], X[:3, 3]))

    def touching(self, candidates: IndexArray) -> Iterator[int]:
        """Yield those of the pairs with these indices that touch as the bodies are placed."""
        request = fcl.CollisionRequest()
        for pair in candidates:
            i, j = self.pairs[pair]
            if fcl.collide(self._objects[i], self._objects[j], request, fcl.CollisionResult()):
                yield int(pair)

    def distance(self, pair: int) -> float:
        """Return the distance of a pair as the bodies are placed [m]; 0 or less if they touch."""
        i, j = self.pairs[pair]
        result = fcl.DistanceResult()
        return float(
            fcl.distance(self._objects[i], self._objects[j], fcl.DistanceRequest(), result)
        )

    def touches(self, body: int, obstacle: fcl.CollisionObject) -> bool:
        """Return whether a body touches an obstacle, as it is placed."""
        return bool(
            fcl.collide(
                self._objects[body], obstacle, fcl.CollisionRequest(), fcl.CollisionResult()
            )
        )


def balls_around(geometry: LinkGeometry) -> tuple[FloatArray, FloatArray]:
    """Return centres (B, 3) in G and radii (B,) [m] of balls that cover a body."""
    if geometry.kind == "sphere":
        return np.zeros((1, 3)), np.array(geometry.dimensions)
    low, high = np.asarray(geometry.mesh.bounds)
    sides = high - low
    # Cut the bounding box into about cubic cells, each covered by one ball.
    cells = np.ones(3, dtype=int)
    while np.prod(cells + (np.arange(3) == np.argmax(sides / cells))) <= _MOST_BALLS:
        longest = int(np.argmax(sides / cells))
        cells[longest] += 1
    steps = [low[k] + (np.arange(cells[k]) + 0.5) * sides[k] / cells[k] for k in range(3)]
    centers = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    radius = 0.5 * float(np.linalg.norm(sides / cells))
    return centers, np.full(len(centers), radius)
