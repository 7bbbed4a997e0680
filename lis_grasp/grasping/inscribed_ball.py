"""The largest ball about the origin inside convex bodies: expanding polytopes, many at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from lis_grasp.typing import FloatArray, IndexArray

# For directions (b, 6) and the bodies (b,) that they are for: the point (b, 6) of each body that is
# farthest along its direction.
Farthest = Callable[[FloatArray, IndexArray], FloatArray]

# Radius of the corners of the simplex that every polytope starts from: smaller balls may be missed.
LEAST_RADIUS = 1e-4
_CORNERS = 7
# Bodies that are worked on together: their facets fit into a processor's cache.
_TOGETHER = 40
_MOST_POINTS = 249 - _CORNERS
# How far a point must be beyond a facet to see it, as a share of the facet's distance.
_SEEN = 1e-9
# Wrenches of one contact lie in a plane: vertices are moved by this much along each axis, so that
# no facet is flat in itself.
_JOGGLE = 1e-6


@dataclass(slots=True)
class _Facets:
    """Facets of B simplicial polytopes about the origin, sorted by polytope.

    A facet with its vertices as the rows of M is in the plane ``v x = 1``, ``v = M^-1 (1 ... 1)``.

    Parameters
    ----------
    owner
        Shape (F,): which polytope.
    vertices
        Shape (F, 6): numbers of the vertices.
    inverses
        Shape (F, 6, 6): M^-1; column j is orthogonal to all vertices but the j-th.

    planes
        Shape (F, 6): v.
    """

    owner: IndexArray
    vertices: npt.NDArray[np.int64]
    inverses: FloatArray
    planes: FloatArray

    def subset(self, index: npt.NDArray[np.bool_] | IndexArray) -> _Facets:
        return _Facets(
            self.owner[index], self.vertices[index], self.inverses[index], self.planes[index]
        )


def inner_radii(farthest: Farthest, count: int, *, tolerance: float = 1e-6) -> FloatArray:
    """Return the radii of the largest balls about the origin inside convex bodies of 6 dimensions.

    The expanding polytope algorithm (van den Bergen 2001): a polytope inside the body, at first a
    tiny simplex, is nearest to the origin at one of its facets; the body's farthest point along
    that facet's normal either confirms the facet, or becomes a vertex. Only facets near the origin
    are ever made, which is what makes it faster than a whole hull (Zheng 2013), and the body needs
    no more than a support function: it may be round.

    Parameters
    ----------
    farthest
        Support of the bodies; called with unit directions.
    count
        B, of bodies.
    tolerance
        Share of the radius by which the result may be too small, besides 3e-6.

    Returns
    -------
    FloatArray
        Shape (B,); 0 at times where the ball is smaller than `LEAST_RADIUS`.

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
    muddled = np.zeros(count, dtype=bool)
    for step in range(_MOST_POINTS):
        nearest = _nearest(facets)
        bodies = facets.owner[nearest]
        v = facets.planes[nearest]  # (b, 6)
        length = np.linalg.norm(v, axis=1)
        points = farthest(v / length[:, None], bodies)
        # A facet on a corner of the simplex says nothing about a body that does not contain it.
        proven = (facets.vertices[nearest] >= _CORNERS).all(axis=1)
        radii[bodies] = np.where(proven, 1.0 / length, 0.0)
        beyond = _beyond(v, points, tolerance)
        # Nothing is beyond a polytope that it is a corner of: facets that are nearly flat in
        # themselves have misled about which of them a corner sees.
        again = (np.abs(corners[:step, bodies] - points).max(axis=-1) < _JOGGLE).any(axis=0)
        muddled[bodies[beyond & again]] = True
        corners[step, bodies] = points
        growing = np.zeros(count, dtype=bool)
        growing[bodies[beyond & ~again]] = True
        if not growing.any():
            break
        number = _CORNERS + step
        apexes = np.zeros((count, 6))
        apexes[bodies] = points + _JOGGLE * np.sin(np.arange(6.0 * number, 6.0 * number + 6) ** 2)
        facets = _grow(facets.subset(growing[facets.owner]), apexes, number)
        muddled[facets.owner[~np.isfinite(facets.planes).all(axis=1)]] = True
        facets = facets.subset(~muddled[facets.owner])
        if not len(facets.owner):
            break
    for body in np.flatnonzero(muddled):
        radii[body] = _expand_hull(farthest, body, corners[:, body], tolerance)
    return radii


def _beyond(v: FloatArray, points: FloatArray, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return which points (b, 6) are beyond planes ``v x = 1`` by enough to matter."""
    length = np.linalg.norm(v, axis=1)
    reach = (v * points).sum(axis=1)  # over the plane's distance
    enough = 1.0 + tolerance + 3.0 * _JOGGLE * length
    return np.asarray((reach > enough) & (reach > LEAST_RADIUS * length))


def _expand_hull(farthest: Farthest, body: np.intp, corners: FloatArray, tolerance: float) -> float:
    """Return the radius of one body: the same by whole hulls, which are slow and never muddled."""
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
    # Turned, so that no wrench of a grasp with axes of its own lies in the plane of a ridge.
    turn, _ = np.linalg.qr(np.sin(np.arange(36.0) ** 2).reshape(6, 6))
    return np.asarray(LEAST_RADIUS * (corners @ turn) / np.linalg.norm(corners[0]))


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
    """Add a vertex to each polytope: the facets that it sees give way to a cone over their rim."""
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
    """Return the ridges on the rim of each polytope's facets: the facet, and the vertex left out.

    A ridge is five of a facet's vertices; it is on the rim if no other facet shares it.
    """
    order = np.argsort(facets.vertices, axis=1)
    ordered = np.take_along_axis(facets.vertices, order, axis=1)  # (F, 6)
    digits = 256 ** np.arange(5)
    lower, upper = ordered[:, :-1] * digits, ordered[:, 1:] * digits
    # Without the j-th vertex: those before it keep their digit, those after move down by one.
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
