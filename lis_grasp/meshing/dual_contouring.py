"""Dual contouring of Hermite data: one vertex a sheet of the surface in a cell, edges kept sharp.

Ju, Losasso, Schaefer and Warren 2002, "Dual contouring of Hermite data"; made manifold after
Schaefer, Ju and Warren 2007, see `cell_sheets`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.meshing.cell_sheets import corner_configurations, edge_number, sheets_of_cells
from lis_grasp.meshing.grid import Grid
from lis_grasp.meshing.hermite import Crossings

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

# Eigenvalues of the quadric below this part of the largest are noise, not an edge: with equal
# shares of both sides, an edge that turns by less than 16 deg (tan^2 of half the angle).
_RANK_TOLERANCE = 0.02

# Cells round an edge along +a, in turn: cell (u, v) has the edge at its (b, c) = (u, v).
_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))

# Planes meet in a point if they miss it by less than this (root mean square, in cells).
_MEETING = 0.05

# How far from its cell a vertex may be if the planes meet there, in cells.
_REACH = 1.0

# Sweeps of coordinate descent for vertices that are held back.
_SWEEPS = 30

# The two ways to cut a quad.
_DIAGONALS = ([0, 1, 2, 2, 3, 0], [1, 2, 3, 3, 0, 1])

# Weight of a flat diagonal, for where the normal cannot tell.
_FLATNESS = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Sheets:
    """The vertices of the mesh, each a sheet of the surface in a cell.

    Parameters
    ----------
    cells
        Shape (V,), the cell of each.
    corners
        Shape (E, 4), the sheets that meet each crossing, in turn about its axis.
    """

    cells: IndexArray
    corners: IndexArray


def contour(
    inside: npt.NDArray[np.bool_], crossings: Crossings, grid: Grid
) -> tuple[FloatArray, IndexArray]:
    """Return vertices (V, 3) [m] and outward triangles (2 E, 3) of a closed manifold mesh.

    Parameters
    ----------
    inside
        Shape `grid.nodes`.
    crossings
        Every edge of the grid whose ends differ.
    grid
        The grid.
    """
    sheets = _sheets(inside.reshape(-1), crossings, grid)
    vertices = _place_vertices(sheets, crossings, grid)
    corners = sheets.corners.copy()
    # Seen from outside, counterclockwise.
    entering = ~crossings.leaving
    corners[entering] = corners[entering][:, ::-1]
    return vertices, _split_quads(corners, vertices, crossings)


def _sheets(inside: npt.NDArray[np.bool_], crossings: Crossings, grid: Grid) -> Sheets:
    cells = np.empty((len(crossings), 4), dtype=np.intp)
    edges = np.empty((len(crossings), 4), dtype=np.intp)
    strides = np.array(grid.strides)
    for k, (u, v) in enumerate(_AROUND):
        b, c = strides[(crossings.axes + 1) % 3], strides[(crossings.axes + 2) % 3]
        cells[:, k] = crossings.lower - u * b - v * c
        edges[:, k] = 4 * crossings.axes + edge_number(0, u, v)
    active, row = np.unique(cells, return_inverse=True)
    row = row.reshape(cells.shape)
    config = corner_configurations(inside, active, grid)
    names = sheets_of_cells(config, active, grid)[row, edges]  # (E, 4)
    sheets, corners = np.unique(12 * row + names, return_inverse=True)
    return Sheets(active[sheets // 12], corners.reshape(cells.shape))


def _place_vertices(sheets: Sheets, crossings: Crossings, grid: Grid) -> FloatArray:
    """Return the vertex of each sheet, shape (V, 3) [m].

    The vertex minimises the sum of squared distances to the tangent planes of the sheet's
    crossings; in directions in which the planes say next to nothing it stays at the crossings'
    mean. It is kept to its cell, unless the planes really meet beside it: an edge of the object
    that pokes out of a cell through a side none of whose edges it crosses is seen by this cell
    alone. (Held back to the cell, a rotated cube loses fifty times more of its edges and its
    triangles fold over.)
    """
    quadrics = _gather_quadrics(sheets, crossings, grid)
    steps = _minimise(quadrics.matrices, quadrics.targets)
    meet = quadrics.misfit(steps) <= _MEETING**2
    slack = np.where(meet, _REACH, 0.0)[:, None]
    cells = grid.coordinates(sheets.cells)
    low, high = cells - slack - quadrics.means, cells + 1.0 + slack - quadrics.means
    out = np.flatnonzero(((steps < low) | (steps > high)).any(axis=1))
    steps[out] = _minimise_in_box(
        quadrics.matrices[out], quadrics.targets[out], low[out], high[out]
    )
    vertices: FloatArray = grid.origin + grid.cell * (quadrics.means + steps)
    return vertices


@dataclass(frozen=True, slots=True, eq=False)
class Quadrics:
    """Of each sheet, sum (n . (m + x - p))^2 = x' Q x - 2 t' x + r over its crossings.

    Lengths are in cells, from the grid's origin.

    Parameters
    ----------
    counts
        Shape (V,), number of crossings.
    means
        Shape (V, 3), m, mean of the crossings.
    matrices
        Shape (V, 3, 3), Q.
    targets
        Shape (V, 3), t.
    rests
        Shape (V,), r.
    """

    counts: IndexArray
    means: FloatArray
    matrices: FloatArray
    targets: FloatArray
    rests: FloatArray

    def misfit(self, steps: FloatArray) -> FloatArray:
        """Return the mean squared distance from m + steps, shape (V, 3), to the planes, (V,)."""
        images = np.einsum("vij,vj->vi", self.matrices, steps) - 2.0 * self.targets
        squares: FloatArray = self.rests + np.einsum("vi,vi->v", steps, images)
        return squares / self.counts


def _gather_quadrics(sheets: Sheets, crossings: Crossings, grid: Grid) -> Quadrics:
    members = sheets.corners.reshape(-1)
    counts = np.bincount(members, minlength=len(sheets.cells))

    def gather(per_crossing: FloatArray) -> FloatArray:
        weights = np.repeat(per_crossing, 4)
        return np.bincount(members, weights, minlength=len(counts)).astype(np.float64)

    points = (crossings.points - grid.origin) / grid.cell
    normals = crossings.normals
    heights = np.einsum("ek,ek->e", normals, points)
    means = np.stack([gather(x) for x in points.T], axis=1) / counts[:, None]
    matrices = np.empty((len(counts), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            matrices[:, i, j] = matrices[:, j, i] = gather(normals[:, i] * normals[:, j])
    # Gathered from the grid's origin, then moved to the means.
    targets = np.stack([gather(n * heights) for n in normals.T], axis=1)
    rests = gather(heights**2) - np.einsum("vi,vi->v", means, targets)
    targets -= np.einsum("vij,vj->vi", matrices, means)
    rests -= np.einsum("vi,vi->v", means, targets)
    return Quadrics(counts, means, matrices, targets, rests)


def _minimise(quadric: FloatArray, target: FloatArray) -> FloatArray:
    """Return the minimum of x' Q x - 2 t' x in the directions about which Q says something."""
    scales, directions = np.linalg.eigh(quadric)  # ascending
    kept = (scales > _RANK_TOLERANCE * scales[:, -1:]) & (scales > 0.0)
    along = np.einsum("vik,vi->vk", directions, target)
    along = np.where(kept, along, 0.0) / np.where(kept, scales, 1.0)
    minima: FloatArray = np.einsum("vik,vk->vi", directions, along)
    return minima


def _minimise_in_box(
    quadric: FloatArray, target: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the minimum of x' Q x - 2 t' x with low <= x <= high, by coordinate descent."""
    # A small pull to the mass point, the origin, decides what the planes leave open.
    pull = _RANK_TOLERANCE * np.trace(quadric, axis1=1, axis2=2)
    quadric = quadric + np.maximum(pull, np.finfo(float).tiny)[:, None, None] * np.eye(3)
    x = np.zeros_like(target)
    for _ in range(_SWEEPS):
        for k in range(3):
            others = np.einsum("vj,vj->v", quadric[:, k], x) - quadric[:, k, k] * x[:, k]
            best = (target[:, k] - others) / quadric[:, k, k]
            x[:, k] = np.clip(best, low[:, k], high[:, k])
    return x


def _split_quads(corners: IndexArray, vertices: FloatArray, crossings: Crossings) -> IndexArray:
    """Cut each quad (E, 4) into two triangles, along the better diagonal; shape (2 E, 3).

    Better is the diagonal whose worse triangle agrees better with the surface's normal where the
    quad's grid edge is crossed: it lies along a sharp edge, not across, and folds nothing over.
    """
    choices = [corners[:, order].reshape(-1, 2, 3) for order in _DIAGONALS]
    first, second = (_agreement(choice, vertices, crossings.normals) for choice in choices)
    better = np.where((second > first)[:, None, None], choices[1], choices[0])
    return better.reshape(-1, 3)


def _agreement(triangles: IndexArray, vertices: FloatArray, normals: FloatArray) -> FloatArray:
    """Return how well pairs of triangles (E, 2, 3) agree with normals (E, 3) and each other."""
    a, b, c = (vertices[triangles[..., k]] for k in range(3))
    areas = np.cross(b - a, c - a)  # (E, 2, 3)
    lengths = np.linalg.norm(areas, axis=-1, keepdims=True)
    units = areas / np.maximum(lengths, np.finfo(float).tiny)
    worse = np.einsum("etk,ek->et", units, normals).min(axis=1)
    return worse + _FLATNESS * np.einsum("ek,ek->e", units[:, 0], units[:, 1])
