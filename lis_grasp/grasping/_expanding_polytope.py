"""Largest inscribed balls of convex bodies in six dimensions (expanding polytope algorithm)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from lis_grasp.records import subset_of
from lis_grasp.typing import FloatArray, IndexArray

# Directions (b, 6) and their bodies (b,) -> each body's farthest point (b, 6) along its direction.
Farthest = Callable[[FloatArray, IndexArray], FloatArray]

LEAST_RADIUS = 1e-4
"""Radius of the simplex that every polytope starts from; smaller balls may be missed."""
_CORNERS = 7
# Bodies that are worked on together, and slots for facets that each has at first.
_TOGETHER, _SLOTS = 40, 128
# Facets of polytopes that are finished are dropped when this fraction is left.
_DENSE = 0.7
_MOST_POINTS = 249 - _CORNERS
# Wrenches of one contact are coplanar: vertices move by this much, so that no facet is degenerate.
_JOGGLE = 1e-6
# Sums of these numbers identify sets of vertices of the polytopes that are worked on together.
_VERTEX_KEYS, _OWNER_KEYS = np.random.default_rng(0).integers(2**63, size=(2, 256), dtype=np.uint64)


@dataclass(slots=True)
class _Facets:
    """Facets of B simplicial polytopes about the origin, each in one of F slots; others are empty.

    A facet is in the plane ``v x = 1``. All planes through a ridge, which two facets share, are
    ``v' + t (v - v')``: so the facet of a ridge and a new vertex follows from those two. Column j
    of `neighbours` is the facet across the ridge without the j-th vertex. In an empty slot v is 0:
    its plane is infinitely far, so that it is never the nearest one, and no point is beyond it.
    """

    vertices: IndexArray  # (B, F, 6): numbers of the vertices
    neighbours: IndexArray  # (B, F, 6): slots
    planes: FloatArray  # (B, F, 6): v
    sizes: FloatArray  # (B, F): |v|^2
    used: IndexArray  # (B,): slots from here on have never been used

    @classmethod
    def simplices(cls, count: int) -> _Facets:
        """Return the facets that every one of the polytopes starts with."""
        # Facet i has all corners but the i-th, which is opposite to it.
        corners = np.array([[j for j in range(_CORNERS) if j != i] for i in range(_CORNERS)])
        planes = np.linalg.solve(_simplex()[corners], np.ones((_CORNERS, 6, 1)))[..., 0]
        facets = cls(
            np.zeros((count, _SLOTS, 6), dtype=np.intp),
            np.zeros((count, _SLOTS, 6), dtype=np.intp),
            np.zeros((count, _SLOTS, 6)),
            np.zeros((count, _SLOTS)),
            np.full(count, _CORNERS),
        )
        facets.vertices[:, :_CORNERS] = facets.neighbours[:, :_CORNERS] = corners
        facets.planes[:, :_CORNERS], facets.sizes[:, :_CORNERS] = planes, (planes**2).sum(axis=1)
        return facets

    def grow(self, apexes: FloatArray, number: int) -> None:
        """Add vertex `number` at (B, 6) to each polytope: a cone replaces the facets that it sees.

        Nothing is beyond any facet at the origin, so polytopes with an apex there stay as they are.
        """
        filled = int(self.used.max())
        beyond = (self.planes[:, :filled] @ apexes[:, :, None])[..., 0]  # (B, F)
        seen = beyond > 1.0
        row, slot = np.nonzero(seen)
        around = self.neighbours[row, slot]
        # The rim of the hole: ridges between a facet that is seen and one that is not.
        facet, place = np.nonzero(~seen[row[:, None], around])
        owner, old, other = row[facet], slot[facet], around[facet, place]
        inner, outer = beyond[owner, other], beyond[owner, old]
        fraction = ((1.0 - inner) / (outer - inner))[:, None]  # from 0 to 1
        planes = (1.0 - fraction) * self.planes[owner, other] + fraction * self.planes[owner, old]
        vertices, back = self.vertices[owner, old], self.neighbours[owner, other] == old[:, None]
        self.planes[row, slot], self.sizes[row, slot] = 0.0, 0.0
        free = self._free_slots(row, slot, owner)
        neighbours = _join(owner, vertices, place, free)
        neighbours[np.arange(len(facet)), place] = other
        vertices[np.arange(len(facet)), place] = number
        self.neighbours[owner, other, back.argmax(axis=1)] = free
        self.vertices[owner, free], self.neighbours[owner, free] = vertices, neighbours
        self.planes[owner, free] = planes
        self.sizes[owner, free] = np.einsum("nk,nk->n", planes, planes)

    def subset(self, index: IndexArray) -> _Facets:
        return subset_of(self, index)

    def _free_slots(self, row: IndexArray, slot: IndexArray, owner: IndexArray) -> IndexArray:
        """Return a slot for each new facet: those just emptied at (row, slot), then unused ones."""
        count = len(self.used)
        emptied, new = np.bincount(row, minlength=count), np.bincount(owner, minlength=count)
        rank = np.arange(len(owner)) - (np.cumsum(new) - new)[owner]
        again = rank < emptied[owner]
        free = self.used[owner] + rank - emptied[owner]
        free[again] = slot[((np.cumsum(emptied) - emptied)[owner] + rank)[again]]
        self.used += np.maximum(new - emptied, 0)
        missing = int(self.used.max()) - self.sizes.shape[1]
        if missing > 0:
            self._extend(max(missing, self.sizes.shape[1] // 2))
        return free

    def _extend(self, slots: int) -> None:
        for name in ("vertices", "neighbours", "planes", "sizes"):
            old = getattr(self, name)
            new = np.zeros((len(old), slots, *old.shape[2:]), dtype=old.dtype)
            setattr(self, name, np.concatenate([old, new], axis=1))


def inscribed_ball_radii(farthest: Farthest, count: int, *, tolerance: float = 1e-6) -> FloatArray:
    """Return the radii of the largest balls about the origin inside convex bodies.

    The expanding polytope algorithm (van den Bergen 2001) starts from a tiny simplex. It takes the
    facet nearest to the origin and the body's farthest point along the facet's normal. That point
    either confirms the facet, or becomes a vertex. Only facets near the origin are made, so that it
    is faster than a whole hull (Zheng 2013).

    `farthest` is the support function of `count` bodies, called with unit directions. Radii (B,)
    may be too small by the fraction `tolerance` and 3e-6; below `LEAST_RADIUS` they may be 0.

    References
    ----------
    G. van den Bergen, "Proximity queries and penetration depth computation on 3D game objects",
    GDC 2001. Y. Zheng, "An efficient algorithm for a grasp quality measure", T-RO 29(2), 2013.
    """
    radii = np.zeros(count)
    for start in range(0, count, _TOGETHER):
        bodies = np.arange(start, min(start + _TOGETHER, count))

        def of_these(u: FloatArray, which: IndexArray, bodies: IndexArray = bodies) -> FloatArray:
            return farthest(u, bodies[which])

        radii[bodies] = _expand(of_these, len(bodies), tolerance)
    return radii


def _expand(farthest: Farthest, count: int, tolerance: float) -> FloatArray:
    facets = _Facets.simplices(count)
    bodies = np.arange(count)  # of the rows of `facets`
    grows = np.ones(count, dtype=bool)
    radii = np.zeros(count)
    corners = np.full((_MOST_POINTS, count, 6), np.inf)
    degenerate: list[int] = []
    for step in range(_MOST_POINTS):
        rows = np.flatnonzero(grows)
        these, nearest = bodies[rows], facets.sizes[rows].argmax(axis=1)
        v = facets.planes[rows, nearest]  # (b, 6)
        length = np.linalg.norm(v, axis=1)
        points = farthest(v / length[:, None], these)
        # The body need not contain the simplex: facets on its corners give no radius.
        confirmed = (facets.vertices[rows, nearest] >= _CORNERS).all(axis=1)
        radii[these] = np.where(confirmed, 1.0 / length, 0.0)
        beyond = _beyond(v, points, tolerance)
        # A vertex is never beyond its own polytope, except by rounding at degenerate facets.
        again = (np.abs(corners[:step, these] - points).max(axis=-1) < _JOGGLE).any(axis=0)
        degenerate += these[beyond & again].tolist()
        corners[step, these] = points
        growing = beyond & ~again
        grows[rows[~growing]] = False
        if not growing.any():
            break
        number = _CORNERS + step
        apexes = np.zeros((len(grows), 6))
        joggle = _JOGGLE * np.sin(np.arange(6.0 * number, 6.0 * number + 6) ** 2)
        apexes[rows[growing]] = points[growing] + joggle
        if growing.sum() < _DENSE * len(bodies):
            facets, bodies, apexes = facets.subset(grows), bodies[grows], apexes[grows]
            grows = np.ones(len(bodies), dtype=bool)
        facets.grow(apexes, number)
    for body in sorted(degenerate):
        radii[body] = _expand_hull(farthest, np.intp(body), corners[:, body], tolerance)
    return radii


def _beyond(v: FloatArray, points: FloatArray, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return which points (b, 6) are beyond planes ``v x = 1`` by enough to matter."""
    length = np.linalg.norm(v, axis=1)
    along = (v * points).sum(axis=1)  # in multiples of the plane's distance
    enough = 1.0 + tolerance + 3.0 * _JOGGLE * length
    return np.asarray((along > enough) & (along > LEAST_RADIUS * length))


def _expand_hull(farthest: Farthest, body: np.intp, corners: FloatArray, tolerance: float) -> float:
    """Return the radius of one body by whole hulls, which are slow but robust."""
    points = corners[np.isfinite(corners).all(axis=1)]
    while True:
        hull = ConvexHull(np.vstack([_simplex(), points]), qhull_options="QJ")
        nearest = int(np.argmax(hull.equations[:, -1]))
        distance = -hull.equations[nearest, -1]
        v = hull.equations[nearest, :6] / distance
        point = farthest(v[None] * distance, np.array([body]))
        done = not _beyond(v[None], point, tolerance)[0]
        if done or (np.abs(points - point).max(axis=1) < _JOGGLE).any():
            return float(distance) if (hull.simplices[nearest] >= _CORNERS).all() else 0.0
        points = np.vstack([points, point])


def _simplex() -> FloatArray:
    """Return the corners (7, 6) of a small regular simplex about the origin."""
    corners = np.vstack([np.eye(6), np.full((1, 6), (1.0 - np.sqrt(7.0)) / 6.0)])
    corners -= corners.mean(axis=0)
    # Rotated, so that no wrench along a coordinate axis is in the plane of a ridge.
    rotation, _ = np.linalg.qr(np.sin(np.arange(36.0) ** 2).reshape(6, 6))
    return np.asarray(LEAST_RADIUS * (corners @ rotation) / np.linalg.norm(corners[0]))


def _join(
    owner: IndexArray, vertices: IndexArray, place: IndexArray, slots: IndexArray
) -> IndexArray:
    """Return the neighbours (n, 6) among the facets of cones, one for each ridge of their rims.

    Ridges have the `vertices` (n, 6) but the one in `place` (n,); their facets are in `slots` (n,).
    Two facets of a cone are neighbours if their ridges share four vertices.
    """
    keys = _VERTEX_KEYS[vertices]
    ridges = keys.sum(axis=1) - keys[np.arange(len(place)), place] + _OWNER_KEYS[owner]
    shared = np.arange(6) != place[:, None]
    joints = np.flatnonzero(shared)
    pairs = joints[np.argsort((ridges[:, None] - keys)[shared])].reshape(-1, 2)
    neighbours = np.zeros(vertices.size, dtype=np.intp)
    neighbours[pairs] = slots[pairs[:, ::-1] // 6]
    return neighbours.reshape(vertices.shape)
