"""Exact distances from points to a triangle mesh, many at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray, IndexArray

# Triangles are cut until no side is longer than three times that of this many equal ones: a few
# large ones would otherwise be candidates everywhere.
_PIECES = 5000

# Point-triangle pairs held at once.
_CHUNK = 1_000_000


def distances_to_mesh(points: FloatArray, mesh: trimesh.Trimesh) -> tuple[FloatArray, IndexArray]:
    """Return the distance of each point to the nearest point of a mesh, and the triangle it is on.

    Exact but for rounding, 1e-8 of a triangle's size. The distance to the triangle whose centre is
    nearest bounds the answer; measured is every triangle that could be nearer, that is, whose
    centre is no farther than the bound and the largest triangle's radius.

    Parameters
    ----------
    points
        Shape (P, 3) [m].
    mesh
        With at least one triangle.

    Returns
    -------
    distances
        Shape (P,) [m], at least 0.
    faces
        Shape (P,), a triangle of `mesh.faces` at that distance.
    """
    if not len(points):
        return np.empty(0), np.empty(0, dtype=np.intp)
    pieces, owners = _cut_to_size(np.array(mesh.triangles), 3.0 * np.sqrt(mesh.area / _PIECES))
    centers = pieces.mean(axis=1)
    largest = np.linalg.norm(pieces - centers[:, None], axis=2).max()
    tree = cKDTree(centers)
    nearest = np.asarray(tree.query(points)[1], dtype=np.intp)
    reach = (_distances(points, pieces[nearest]) + largest) * (1.0 + 1e-12)
    scalars = _Scalars(pieces)
    for chunk in _chunks(tree.query_ball_point(points, reach, return_length=True)):
        near = tree.query_ball_point(points[chunk], reach[chunk])
        counts = np.array([len(candidates) for candidates in near])
        candidates = np.concatenate([np.array(c, dtype=np.intp) for c in near])
        squares = scalars.squared_distances(np.repeat(points[chunk], counts, axis=0), candidates)
        starts = np.cumsum(counts) - counts
        least = np.minimum.reduceat(squares, starts)
        row = np.repeat(np.arange(len(counts)), counts)
        winners = np.flatnonzero(squares == least[row])
        _, first = np.unique(row[winners], return_index=True)
        nearest[chunk] = candidates[winners[first]]
    return _distances(points, pieces[nearest]), owners[nearest]


def _chunks(counts: IndexArray) -> Iterator[slice]:
    """Cut points into runs of at most `_CHUNK` candidates each, at least one point a run."""
    passed = np.cumsum(counts)
    start = 0
    while start < len(counts):
        before = passed[start] - counts[start]
        stop = max(start + 1, int(np.searchsorted(passed, before + _CHUNK, side="right")))
        yield slice(start, stop)
        start = stop


def _cut_to_size(triangles: FloatArray, size: float) -> tuple[FloatArray, IndexArray]:
    """Halve triangles at their longest side until none is longer; return pieces and owners."""
    owners = np.arange(len(triangles))
    done: list[tuple[FloatArray, IndexArray]] = []
    while len(triangles):
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # k to k + 1
        long = sides.max(axis=1) > size
        done.append((triangles[~long], owners[~long]))
        first = sides[long].argmax(axis=1)
        row = np.arange(len(first))
        a, b, c = (triangles[long][row, (first + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles, owners = np.concatenate(halves), np.tile(owners[long], 2)
    return np.concatenate([t for t, _ in done]), np.concatenate([o for _, o in done])


class _Scalars:
    """Squared distances of many point-triangle pairs from a handful of scalars each (Eberly 1999).

    With p - a = o and the point of the triangle a + s u + t v, the square is
    o.o - 2 s o.u - 2 t o.v + s^2 u.u + 2 s t u.v + t^2 v.v. Fit to tell which triangle is nearest;
    near zero the sum cancels to sqrt(rounding) of a triangle's size.
    """

    def __init__(self, triangles: FloatArray) -> None:
        self.a = triangles[:, 0]
        self.u, self.v = triangles[:, 1] - self.a, triangles[:, 2] - self.a
        uu, uv, vv = (_dot(x, y) for x, y in ((self.u, self.u), (self.u, self.v), (self.v, self.v)))
        self.products = np.stack([uu, uv, vv, uu * vv - uv**2])  # (4, F)

    def squared_distances(self, points: FloatArray, chosen: IndexArray) -> FloatArray:
        """Return the squared distance of each point (P, 3) to its chosen triangle (P,)."""
        o = points - self.a[chosen]
        oo, ou, ov = _dot(o, o), _dot(o, self.u[chosen]), _dot(o, self.v[chosen])
        uu, uv, vv, determinant = self.products[:, chosen]

        def square(s: FloatArray, t: FloatArray) -> FloatArray:
            return oo + s * (s * uu - 2.0 * ou) + t * (t * vv - 2.0 * ov + 2.0 * s * uv)

        zero = np.zeros_like(oo)
        least = square(_unit(ou, uu), zero)
        np.minimum(least, square(zero, _unit(ov, vv)), out=least)
        # From b to c: s = 1 - w, t = w.
        w = _unit(ov - ou + uu - uv, uu - 2.0 * uv + vv)
        np.minimum(least, square(1.0 - w, w), out=least)
        s, t = ou * vv - ov * uv, ov * uu - ou * uv
        over = np.flatnonzero((s > 0.0) & (t > 0.0) & (s + t < determinant))
        inner = oo[over] - (s[over] * ou[over] + t[over] * ov[over]) / determinant[over]
        least[over] = np.minimum(least[over], inner)
        return least


def _unit(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Return the quotient held to [0, 1]; 0 for a side of no length."""
    return np.clip(numerator / np.where(denominator > 0.0, denominator, np.inf), 0.0, 1.0)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    products: FloatArray = np.einsum("pk,pk->p", first, second)
    return products


def _distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the distance of each point (P, 3) to its triangle (P, 3, 3), to rounding."""
    distances = np.full(len(points), np.inf)
    sides = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(sides[:, 0], sides[:, 1])
    lengths = np.linalg.norm(normals, axis=1)
    above = lengths > 0.0
    for k in range(3):
        side, offset = sides[:, k], points - triangles[:, k]
        along = _unit(_dot(side, offset), _dot(side, side))
        np.minimum(distances, np.linalg.norm(offset - along[:, None] * side, axis=1), out=distances)
        above &= _dot(np.cross(side, offset), normals) >= 0.0
    # Over its inside, a triangle is as far away as its plane.
    heights = np.abs(_dot(points - triangles[:, 0], normals))[above] / lengths[above]
    distances[above] = np.minimum(distances[above], heights)
    return distances
