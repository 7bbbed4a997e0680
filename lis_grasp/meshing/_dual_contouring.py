"""Dual contouring of Hermite data: one vertex per sheet of the surface in a cell, sharp edges.

Ju, Losasso, Schaefer and Warren 2002, "Dual contouring of Hermite data"; made manifold after
Schaefer, Ju and Warren 2007, see `cell_sheets`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.meshing._cell_sheets import corner_configurations, edge_number, sheets_of_cells
from lis_grasp.meshing._grid import Grid
from lis_grasp.meshing._hermite import Crossings
from lis_grasp.meshing._quadrics import place_vertices
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Cells round an edge along +a, in turn: cell (u, v) has the edge at its (b, c) = (u, v).
_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))

# The two ways to cut a quad.
_DIAGONALS = ([0, 1, 2, 2, 3, 0], [1, 2, 3, 3, 0, 1])

# Weight of a flat diagonal, which decides where the normal does not.
_FLATNESS = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Sheets:
    """The vertices of the mesh, each a sheet of the surface in a cell."""

    cells: IndexArray  # (V,) the cell of each
    corners: IndexArray  # (E, 4) the sheets that meet each crossing, in turn about its axis


def contour(inside: BoolArray, crossings: Crossings, grid: Grid) -> tuple[FloatArray, IndexArray]:
    """Return vertices (V, 3) [m] and outward triangles (2 E, 3) of a closed manifold mesh.

    `inside` has shape `grid.nodes`; `crossings` are all E edges of the grid whose ends differ.
    """
    sheets = _sheets(inside.reshape(-1), crossings, grid)
    vertices = place_vertices(sheets.cells, sheets.corners, crossings, grid)
    corners = sheets.corners.copy()
    # Seen from outside, counterclockwise.
    entering = ~crossings.leaving
    corners[entering] = corners[entering][:, ::-1]
    return vertices, _split_quads(corners, vertices, crossings)


def _sheets(inside: BoolArray, crossings: Crossings, grid: Grid) -> Sheets:
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


def _split_quads(corners: IndexArray, vertices: FloatArray, crossings: Crossings) -> IndexArray:
    """Cut each quad (E, 4) into two triangles, shape (2 E, 3), along the better diagonal.

    Its worse triangle agrees better with the normal at the crossing: it is along a sharp edge.
    """
    choices = [corners[:, order].reshape(-1, 2, 3) for order in _DIAGONALS]
    first, second = (_agreement(choice, vertices, crossings.normals) for choice in choices)
    better = np.where((second > first)[:, None, None], choices[1], choices[0])
    return better.reshape(-1, 3)


def _agreement(triangles: IndexArray, vertices: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the agreement of triangle pairs (E, 2, 3) with normals (E, 3) and each other."""
    a, b, c = (vertices[triangles[..., k]] for k in range(3))
    areas = np.cross(b - a, c - a)  # (E, 2, 3)
    lengths = np.linalg.norm(areas, axis=-1, keepdims=True)
    units = areas / np.maximum(lengths, np.finfo(float).tiny)
    worse = np.einsum("etk,ek->et", units, normals).min(axis=1)
    return worse + _FLATNESS * np.einsum("ek,ek->e", units[:, 0], units[:, 1])
