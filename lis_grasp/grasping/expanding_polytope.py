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
# Bodies that are worked on together: their facets fit into a processor's cache.
_TOGETHER = 40
_MOST_POINTS = 249 - _CORNERS
# A point sees a facet if it is beyond it by more than this fraction of the facet's distance.
_SEEN = 1e-9
# Wrenches of one contact are coplanar: vertices move by this much, so that no facet is degenerate.
_JOGGLE = 1e-6


@dataclass(slots=True)
class _Facets:
    """Facets of B simplicial polytopes about the origin, sorted by polytope.

    A facet with its vertices as the rows of M is in the plane ``v x = 1``, ``v = M^-1 (1 ... 1)``.
    Column j of ``M^-1`` is orthogonal to all vertices but the j-th.
    """

    owner: IndexArray  # (F,): which polytope
    vertices: npt.NDArray[np.int64]  # (F, 6): numbers of the vertices
    inverses: FloatArray  # (F, 6, 6): M^-1
    planes: FloatArray  # (F, 6): v

    def subset(self, index: npt.NDArray[np.bool_] | IndexArray) -> _Facets:
        return subset_of(self, index)


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
    facets = _simplices(count)
    radii = np.zeros(count)
    corners = np.full((_MOST_POINTS, count, 6), np.inf)
    degenerate = np.zeros(count, dtype=bool)
    for step in range(_MOST_POINTS):
        nearest = _nearest(facets)
        bodies = facets.owner[nearest]
        v = facets.planes[nearest]  # (b, 6)
        length = np.linalg.norm(v, axis=1)
        points = farthest(v / length[:, None], bodies)
        # The body need not contain the simplex: facets on its corners give no radius.
        confirmed = (facets.vertices[nearest] >= _CORNERS).all(axis=1)
        radii[bodies] = np.where(confirmed, 1.0 / length, 0.0)
        beyond = _beyond(v, points, tolerance)
        # A vertex is never beyond its own polytope, except by rounding at degenerate facets.
        again = (np.abs(corners[:step, bodies] - points).max(axis=-1) < _JOGGLE).any(axis=0)
        degenerate[bodies[beyond & again]] = True
        corners[step, bodies] = points
        growing = np.zeros(count, dtype=bool)
        growing[bodies[beyond & ~again]] = True
        if not growing.any():
            break
        number = _CORNERS + step
        apexes = np.zeros((count, 6))
        apexes[bodies] = points + _JOGGLE * np.sin(np.arange(6.0 * number, 6.0 * number + 6) ** 2)
        facets = _grow(facets.subset(growing[facets.owner]), apexes, number)
        degenerate[facets.owner[~np.isfinite(facets.planes).all(axis=1)]] = True
        facets = facets.subset(~degenerate[facets.owner])
        if not len(facets.owner):
            break
    for body in np.flatnonzero(degenerate):
        radii[body] = _expand_hull(farthest, body, corners[:, body], tolerance)
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


def _simplices(count: int) -> _Facets:
    """Return the facets that every one of the polytopes starts with."""
    vertices = np.array(list(combinations(range(_CORNERS), 6)))  # (7, 6)
    inverses = np.linalg.inv(_simplex()[vertices])
    return _Facets(
        np.repeat(np.arange(count), _CORNERS),
        np.tile(vertices, (count, 1)),
        np.tile(inverses, (count, 1, 1)),
        np.tile(inverses.sum(axis=2), (count, 1)),
    )


def _nearest(facets: _Facets) -> IndexArray:
    """Return the facet of each polytope that is nearest to the origin."""
    size = (facets.planes * facets.planes).sum(axis=1)
    starts = np.flatnonzero(np.diff(facets.owner, prepend=-1))
    largest = np.maximum.reduceat(size, starts)
    index = np.flatnonzero(size == np.repeat(largest, np.diff(starts, append=len(size))))
    return index[np.flatnonzero(np.diff(facets.owner[index], prepend=-1))]


def _grow(facets: _Facets, apexes: FloatArray, number: int) -> _Facets:
    """Add a vertex to each polytope: a cone over the rim replaces the facets that it sees."""
    seen = (facets.planes * apexes[facets.owner]).sum(axis=1) > 1.0 + _SEEN
    old = facets.subset(np.flatnonzero(seen))
    facet, place = _rim(old)
    owner, vertices, inverses = old.owner[facet], old.vertices[facet], old.inverses[facet]
    # The row `place` of M becomes the apex: its inverse by Sherman and Morrison's formula.
    heights = (apexes[owner][:, None] @ inverses)[:, 0]  # (n, 6)
    rows = np.arange(len(facet))
    pivot = heights[rows, place].copy()
    heights[rows, place] -= 1.0
    column = inverses[rows, :, place]
    with np.errstate(divide="ignore", invalid="ignore"):  # the caller drops what is not finite
        inverses = inverses - column[:, :, None] * (heights / pivot[:, None])[:, None, :]
    vertices[rows, place] = number
    kept = facets.subset(np.flatnonzero(~seen))
    owners = np.concatenate([kept.owner, owner])
    order = np.argsort(owners, kind="stable")
    return _Facets(
        owners[order],
        np.concatenate([kept.vertices, vertices])[order],
        np.concatenate([kept.inverses, inverses])[order],
        np.concatenate([kept.planes, inverses.sum(axis=2)])[order],
    )


def _rim(facets: _Facets) -> tuple[IndexArray, IndexArray]:
    """Return ridges (five vertices) of only one facet: the facet, and the vertex they lack."""
    order = np.argsort(facets.vertices, axis=1)
    ordered = np.take_along_axis(facets.vertices, order, axis=1)  # (F, 6)
    digits = 256 ** np.arange(5)
    lower, upper = ordered[:, :-1] * digits, ordered[:, 1:] * digits
    # Keys of ridges without the j-th vertex: later vertices move down by one digit.
    before = np.concatenate([np.zeros((len(ordered), 1), np.int64), lower.cumsum(axis=1)], axis=1)
    after = np.concatenate(
        [upper[:, ::-1].cumsum(axis=1)[:, ::-1], np.zeros((len(ordered), 1), np.int64)], axis=1
    )
    keys = (before + after + 256**5 * facets.owner[:, None]).ravel()  # (6 F,)
    by_key = np.argsort(keys, kind="stable")
    keys = keys[by_key]
    changes = keys[1:] != keys[:-1]
    alone = by_key[np.append(True, changes) & np.append(changes, True)]
    return alone // 6, order[alone // 6, alone % 6]
