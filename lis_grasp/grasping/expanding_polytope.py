"""Largest inscribed balls of convex bodies in six dimensions (expanding polytope algorithm)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

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
# A point sees a facet if it is beyond it by more than this fraction of the facet's distance.
_SEEN = 1e-9
# Wrenches of one contact are coplanar: vertices move by this much, so that no facet is degenerate.
_JOGGLE = 1e-6


@dataclass(slots=True)
class _Facets:
    """Facets of B simplicial polytopes about the origin, each in one of F slots; others are empty.

    A facet with its vertices as the rows of M is in the plane ``v x = 1``, ``v = M^-1 (1 ... 1)``.
    Column j of ``M^-1`` is orthogonal to all vertices but the j-th. In an empty slot v is 0: its
    plane is infinitely far, so that it is never the nearest one, and no point is beyond it.
    """

    vertices: npt.NDArray[np.int64]  # (B, F, 6): numbers of the vertices
    inverses: FloatArray  # (B, F, 6, 6): M^-1
    planes: FloatArray  # (B, F, 6): v
    sizes: FloatArray  # (B, F): |v|^2
    used: IndexArray  # (B,): slots from here on have never been used

    @classmethod
    def simplices(cls, count: int) -> _Facets:
        """Return the facets that every one of the polytopes starts with."""
        vertices = np.array(list(combinations(range(_CORNERS), 6)))  # (7, 6)
        inverses = np.linalg.inv(_simplex()[vertices])
        facets = cls(
            np.zeros((count, _SLOTS, 6), dtype=np.int64),
            np.zeros((count, _SLOTS, 6, 6)),
            np.zeros((count, _SLOTS, 6)),
            np.zeros((count, _SLOTS)),
            np.full(count, _CORNERS),
        )
        row, slot = np.indices((count, _CORNERS)).reshape(2, -1)
        facets._put(row, slot, np.tile(vertices, (count, 1)), np.tile(inverses, (count, 1, 1)))
        return facets

    def grow(self, rows: IndexArray, apexes: FloatArray, number: int) -> IndexArray:
        """Add vertex `number` at (b, 6) to polytopes (b,): a cone replaces the facets that it sees.

        Returns the polytopes that became degenerate.
        """
        beyond = (self.planes[rows] @ apexes[:, :, None])[..., 0]  # (b, F)
        some, slot = np.nonzero(beyond > 1.0 + _SEEN)
        row, apex_of = rows[some], np.zeros((len(self.used), 6))
        apex_of[rows] = apexes
        facet, place = _rim(row, self.vertices[row, slot])
        owner, old = row[facet], slot[facet]
        vertices, inverses = self.vertices[owner, old], self.inverses[owner, old]
        vertices[np.arange(len(facet)), place] = number
        inverses = _with_row(inverses, place, apex_of[owner])
        self.planes[row, slot], self.sizes[row, slot] = 0.0, 0.0
        free = self._free_slots(row, slot, owner)
        return np.unique(owner[~self._put(owner, free, vertices, inverses)])

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
        for name in ("vertices", "inverses", "planes", "sizes"):
            old = getattr(self, name)
            new = np.zeros((len(old), slots, *old.shape[2:]), dtype=old.dtype)
            setattr(self, name, np.concatenate([old, new], axis=1))

    def _put(
        self,
        row: IndexArray,
        slot: IndexArray,
        vertices: npt.NDArray[np.int64],
        inverses: FloatArray,
    ) -> npt.NDArray[np.bool_]:
        """Store facets; return which of them are finite."""
        planes = inverses.sum(axis=2)
        self.vertices[row, slot], self.inverses[row, slot] = vertices, inverses
        self.planes[row, slot] = planes
        self.sizes[row, slot] = np.einsum("nk,nk->n", planes, planes)
        return np.asarray(np.isfinite(planes).all(axis=1))


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
    bodies_of = np.arange(count)  # of the rows of `facets`
    rows = np.arange(count)  # of bodies that still grow
    radii = np.zeros(count)
    corners = np.full((_MOST_POINTS, count, 6), np.inf)
    degenerate: list[int] = []
    for step in range(_MOST_POINTS):
        bodies, nearest = bodies_of[rows], facets.sizes[rows].argmax(axis=1)
        v = facets.planes[rows, nearest]  # (b, 6)
        length = np.linalg.norm(v, axis=1)
        points = farthest(v / length[:, None], bodies)
        # The body need not contain the simplex: facets on its corners give no radius.
        confirmed = (facets.vertices[rows, nearest] >= _CORNERS).all(axis=1)
        radii[bodies] = np.where(confirmed, 1.0 / length, 0.0)
        beyond = _beyond(v, points, tolerance)
        # A vertex is never beyond its own polytope, except by rounding at degenerate facets.
        again = (np.abs(corners[:step, bodies] - points).max(axis=-1) < _JOGGLE).any(axis=0)
        degenerate += bodies[beyond & again].tolist()
        corners[step, bodies] = points
        growing = beyond & ~again
        rows, points = rows[growing], points[growing]
        if not len(rows):
            break
        if len(rows) < _DENSE * len(bodies_of):
            facets, bodies_of = facets.subset(rows), bodies_of[rows]
            rows = np.arange(len(rows))
        number = _CORNERS + step
        joggle = _JOGGLE * np.sin(np.arange(6.0 * number, 6.0 * number + 6) ** 2)
        failed = facets.grow(rows, points + joggle, number)
        if len(failed):
            degenerate += bodies_of[failed].tolist()
            rows = np.setdiff1d(rows, failed)
            if not len(rows):
                break
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


def _with_row(inverses: FloatArray, place: IndexArray, apexes: FloatArray) -> FloatArray:
    """Return M^-1 of matrices, (n, 6, 6), whose row `place` becomes the apex (n, 6).

    By Sherman and Morrison's formula.
    """
    rows = np.arange(len(place))
    heights = (apexes[:, None] @ inverses)[:, 0]  # (n, 6)
    pivot = heights[rows, place].copy()
    heights[rows, place] -= 1.0
    column = inverses[rows, :, place]
    with np.errstate(divide="ignore", invalid="ignore"):  # the caller drops what is not finite
        return inverses - column[:, :, None] * (heights / pivot[:, None])[:, None, :]


def _rim(owner: IndexArray, vertices: npt.NDArray[np.int64]) -> tuple[IndexArray, IndexArray]:
    """Return ridges (five vertices) of only one facet: the facet, and the vertex they lack.

    Facets (F, 6) are sorted by `owner` (F,), and so are the ridges.
    """
    order = np.argsort(vertices, axis=1)
    ordered = np.take_along_axis(vertices, order, axis=1)
    digits = 256 ** np.arange(5)
    lower, upper = ordered[:, :-1] * digits, ordered[:, 1:] * digits
    # Keys of ridges without the j-th vertex: later vertices move down by one digit.
    before = np.concatenate([np.zeros((len(ordered), 1), np.int64), lower.cumsum(axis=1)], axis=1)
    after = np.concatenate(
        [upper[:, ::-1].cumsum(axis=1)[:, ::-1], np.zeros((len(ordered), 1), np.int64)], axis=1
    )
    keys = (before + after + 256**5 * owner[:, None]).ravel()  # (6 F,)
    by_key = np.argsort(keys, kind="stable")
    keys = keys[by_key]
    changes = keys[1:] != keys[:-1]
    alone = by_key[np.append(True, changes) & np.append(changes, True)]
    return alone // 6, order[alone // 6, alone % 6]
