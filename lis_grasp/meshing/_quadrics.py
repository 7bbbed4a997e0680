"""Vertex placement by quadratic error functions of the crossings' tangent planes.

Method of Ju, Losasso, Schaefer and Warren 2002 (after Garland and Heckbert
1997), solved round the mean of the crossings with small eigenvalues dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.meshing._grid import Grid
from lis_grasp.meshing._hermite import Crossings
from lis_grasp.records import subset_of
from lis_grasp.typing import FloatArray, IndexArray

# Eigenvalues of a quadric below this fraction of the largest are noise, not an edge: with as many
# crossings on both sides, an edge that turns by less than 16 deg (tan^2 of half the angle).
_RANK_TOLERANCE = 0.02

# Planes meet in a point if they miss it by less than this (root mean square, in cells).
_MEETING = 0.05

# The same for the planes of neighbouring cells together, whose vertex then moves to their corner.
_CORNER_MEETING = 0.02

# How far from its cell a vertex may be if the planes meet there, in cells.
_REACH = 1.0

# Sweeps of coordinate descent for vertices that are clamped to boxes.
_SWEEPS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Quadrics:
    """Sums of squared distances to planes, sum (n . (x - p))^2 = x' Q x - 2 t' x + r.

    Lengths are in cells.
    """

    counts: FloatArray  # (V,) number of planes
    matrices: FloatArray  # (V, 3, 3) Q
    targets: FloatArray  # (V, 3) t
    rests: FloatArray  # (V,) r

    def about(self, centers: FloatArray) -> Quadrics:
        """Return the same quadrics as functions of the step from centers, shape (V, 3)."""
        images = np.einsum("vij,vj->vi", self.matrices, centers)
        rests = self.rests + np.einsum("vi,vi->v", centers, images - 2.0 * self.targets)
        return Quadrics(self.counts, self.matrices, self.targets - images, rests)

    def misfits(self, points: FloatArray) -> FloatArray:
        """Return the mean squared distance from points (V, 3) to the planes, shape (V,)."""
        return self.about(points).rests / self.counts

    def minima(self) -> tuple[FloatArray, IndexArray]:
        """Return the minimum of least norm of each, (V, 3), and the rank of each, (V,)."""
        scales, directions = np.linalg.eigh(self.matrices)  # ascending
        kept = (scales > _RANK_TOLERANCE * scales[:, -1:]) & (scales > 0.0)
        along = np.einsum("vik,vi->vk", directions, self.targets)
        along = np.where(kept, along, 0.0) / np.where(kept, scales, 1.0)
        return np.einsum("vik,vk->vi", directions, along), kept.sum(axis=1)

    def minima_in_boxes(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return minima with low <= x <= high, each shape (V, 3), by coordinate descent."""
        # A small pull to the origin decides in directions that the planes leave open.
        pull = _RANK_TOLERANCE * np.trace(self.matrices, axis1=1, axis2=2)
        pull = np.maximum(pull, np.finfo(float).tiny)
        matrices = self.matrices + pull[:, None, None] * np.eye(3)
        x = np.zeros_like(self.targets)
        for _ in range(_SWEEPS):
            for k in range(3):
                others = np.einsum("vj,vj->v", matrices[:, k], x) - matrices[:, k, k] * x[:, k]
                best = (self.targets[:, k] - others) / matrices[:, k, k]
                x[:, k] = np.clip(best, low[:, k], high[:, k])
        return x


def place_vertices(
    cells: IndexArray, corners: IndexArray, crossings: Crossings, grid: Grid
) -> FloatArray:
    """Return the vertex of each sheet, shape (V, 3) [m].

    The vertex minimises the sum of squared distances to the tangent planes of the sheet's
    crossings; in directions that the planes leave open it stays at the crossings' mean. It is
    clamped to its cell, unless the planes meet in a point beside it: an edge of the object that
    leaves a cell through the middle of a side is known to this cell alone. (Always clamped, a
    rotated cube loses fifty times more of its edges and its triangles fold over.)

    `cells` (V,) are the sheets' cells, `corners` (E, 4) the sheets round each crossing, in turn.
    """
    quadrics, means = _gather(len(cells), corners, crossings, grid)
    about_means = quadrics.about(means)
    steps, ranks = about_means.minima()
    meet = quadrics.misfits(means + steps) <= _MEETING**2
    slack = np.where(meet, _REACH, 0.0)[:, None]
    lowest = grid.coordinates(cells)
    low, high = lowest - slack - means, lowest + 1.0 + slack - means
    out = np.flatnonzero(((steps < low) | (steps > high)).any(axis=1))
    steps[out] = subset_of(about_means, out).minima_in_boxes(low[out], high[out])
    vertices = means + steps
    _restore_corners(vertices, np.flatnonzero(ranks >= 2), quadrics, corners)
    return np.asarray(grid.origin + grid.cell * vertices)


def _gather(
    count: int, corners: IndexArray, crossings: Crossings, grid: Grid
) -> tuple[Quadrics, FloatArray]:
    """Return sheets' quadrics, from the grid's origin, and the means of their crossings, (V, 3)."""
    sheets = corners.reshape(-1)
    points = (crossings.points - grid.origin) / grid.cell
    normals = crossings.normals
    heights = np.einsum("ek,ek->e", normals, points)
    counts = np.bincount(sheets, minlength=count).astype(np.float64)

    def gather(per_crossing: FloatArray) -> FloatArray:
        weights = np.repeat(per_crossing, 4)
        return np.bincount(sheets, weights, minlength=count).astype(np.float64)

    matrices = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(i + 1):
            matrices[:, i, j] = matrices[:, j, i] = gather(normals[:, i] * normals[:, j])
    targets = np.stack([gather(n * heights) for n in normals.T], axis=1)
    means = np.stack([gather(x) for x in points.T], axis=1) / counts[:, None]
    return Quadrics(counts, matrices, targets, gather(heights**2)), means


def _restore_corners(
    vertices: FloatArray, candidates: IndexArray, quadrics: Quadrics, corners: IndexArray
) -> None:
    """Move vertices on edges to corners of the object that no single cell shows, in place.

    If the planes of a vertex and of its neighbours together meet in one point, there is a corner;
    the vertex moves there if no neighbour is nearer. All is in cells from the grid's origin:
    vertices (V, 3), candidates (C,) on edges and in corners, quads `corners` (E, 4).
    """
    place = np.full(len(vertices), -1)
    place[candidates] = np.arange(len(candidates))
    sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    # Each edge of the mesh is the side of two quads: neighbours count twice, the vertex once.
    owners, others = np.concatenate([sides, sides[:, ::-1]]).T
    owners, others = place[owners], others[place[owners] >= 0]
    owners = owners[owners >= 0]
    rings = _sums(quadrics, candidates, owners, others).about(vertices[candidates])
    steps, ranks = rings.minima()
    peaks = vertices[candidates] + steps
    distances = np.linalg.norm(steps, axis=1)
    rivals = np.full(len(candidates), np.inf)
    np.minimum.at(rivals, owners, np.linalg.norm(vertices[others] - peaks[owners], axis=1))
    moved = (ranks == 3) & (rings.misfits(steps) <= _CORNER_MEETING**2)
    moved &= (distances < rivals) & (distances < _REACH)
    vertices[candidates[moved]] = peaks[moved]


def _sums(
    quadrics: Quadrics, candidates: IndexArray, owners: IndexArray, others: IndexArray
) -> Quadrics:
    """Return the sum of each candidate's quadric and the quadrics of the others that it owns."""
    sums = subset_of(quadrics, candidates)
    for name in ("counts", "matrices", "targets", "rests"):
        np.add.at(getattr(sums, name), owners, getattr(quadrics, name)[others])
    return sums
