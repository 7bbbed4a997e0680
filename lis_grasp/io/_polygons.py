"""Triangulation of the polygons of mesh files, concave ones too."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import manifold3d
import numpy as np

from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.io.limits import ReadError
from lis_grasp.typing import FloatArray, IntArray

# Areas below this fraction of a polygon's are rounding.
_ROUNDING = 1e-6


def triangulate(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> list[IntArray]:
    """Return the triangles (K, 3) of each polygon, as numbers of its corners.

    A polygon whose fan about its first corner covers it gets that fan, as quads and convex ones do;
    others are cut in their plane, which keeps the outline and the area. Fewer than three corners
    give no triangles. Raises ValueError for a vertex that is missing, or an outline that crosses
    itself.
    """
    lengths = defaultdict(list)
    for number, polygon in enumerate(polygons):
        lengths[len(polygon)].append(number)
    triangles: list[IntArray] = [np.empty((0, 3), np.int64)] * len(polygons)
    for length, numbers in lengths.items():
        if length < 3:
            continue
        indices = np.array([polygons[n] for n in numbers], dtype=np.int64)  # (P, length)
        if indices.min() < 0 or indices.max() >= len(vertices):
            raise ReadError("a face names a vertex that it lacks")
        steps = np.arange(1, length - 1)
        fan = np.column_stack([np.zeros_like(steps), steps, steps + 1])
        corners = vertices[indices]
        spokes = corners[:, 1:] - corners[:, :1]  # (P, length - 1, 3)
        parts = np.cross(spokes[:, :-1], spokes[:, 1:])  # (P, length - 2, 3), twice the areas
        total = parts.sum(axis=1)  # Newell's normal
        areas = np.linalg.norm(total, axis=1)
        along = np.einsum("pki,pi->pk", parts, total)
        sizes = np.linalg.norm(parts, axis=2).sum(axis=1)
        covered = (along >= -_ROUNDING * areas[:, None] ** 2).all(axis=1)
        covered |= ~(areas > _ROUNDING * sizes)  # no plane
        for row, number in enumerate(numbers):
            triangles[number] = fan if covered[row] else _cut(corners[row], total[row])
    return triangles


def _cut(corners: FloatArray, normal: FloatArray) -> IntArray:
    """Return the triangles of a polygon (N, 3) in the plane of its Newell normal."""
    # (N, 2), counterclockwise
    flat = (corners - corners[0]) @ tangent_frame(unit(normal)).T
    scale = np.ptp(flat, axis=0).max()
    triangles = np.asarray(manifold3d.triangulate([flat / scale]), dtype=np.int64).reshape(-1, 3)
    sides = np.diff(flat[triangles], axis=1)  # (K, 2, 2)
    covered = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum()
    if not abs(covered - np.linalg.norm(normal)) <= 1e3 * _ROUNDING * covered:
        raise ReadError(
            f"the outline of a face with {len(corners)} corners crosses itself, so that no"
            " triangles cover it"
        )
    return triangles


def as_triangles(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> IntArray:
    """Return all polygons as triangles (F, 3) of vertices; errors as of `triangulate`."""
    cut = triangulate(vertices, polygons)
    faces = [np.asarray(p)[t] for p, t in zip(polygons, cut, strict=True) if len(t)]
    return np.concatenate(faces).astype(np.int64) if faces else np.empty((0, 3), np.int64)
