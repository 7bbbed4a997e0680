"""Sheets of the surface in a cell: groups of crossed edges that get one vertex each.

The surface cuts a face of a cell in lines from one crossed edge of the face to another. A face with
two crossed edges has one line. A face with four has two, round either pair of opposite corners; by
default round the corners inside the object. Both cells of a face have the same lines. The lines of
a cell's six faces close to cycles over its crossed edges: a cycle is a sheet.

One vertex a sheet (Schaefer, Ju and Warren 2007, "Manifold dual contouring"; Nielson 2004, "Dual
marching cubes") makes each line a mesh edge between two vertices, which closes the mesh. Two lines
of one face are still one edge with four polygons if they join the same two sheets, one sheet on
each side. Flipping them to the other two corners then splits the sheet on both sides (a cycle
crossed over at two of its links becomes two), so repeated flips terminate, and the mesh is manifold
(Wenger 2013, "Isosurfaces", repairs the ambiguous pairs of dual marching cubes this way).

Numbering: the corner at (x, y, z) of the unit cell is 4 x + 2 y + z; the edge along axis a from
(b, c) = (u, v) is 4 a + 2 u + v; the face s = 0, 1 across axis a is 2 a + s; (a, b, c) cyclic.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lis_grasp.meshing._grid import Grid
from lis_grasp.typing import BoolArray, ByteArray, IndexArray

_CORNER_BIT = (4, 2, 1)


def edge_number(axis: int, u: int, v: int) -> int:
    """Return the number of a cell's edge."""
    return 4 * axis + 2 * u + v


def _face_layout(face: int) -> tuple[list[int], list[int]]:
    """Return a face's corners in order, and the edges from each to the next."""
    axis, side = divmod(face, 2)
    b, c = (axis + 1) % 3, (axis + 2) % 3
    base = side * _CORNER_BIT[axis]
    corners = [
        base + u * _CORNER_BIT[b] + v * _CORNER_BIT[c] for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    # An edge along b is at (c, a), one along c at (a, b).
    edges = [
        edge_number(b, 0, side),
        edge_number(c, side, 1),
        edge_number(b, 1, side),
        edge_number(c, side, 0),
    ]
    return corners, edges


@lru_cache(maxsize=1)
def _tables() -> tuple[ByteArray, BoolArray]:
    """Return sheets (256, 64, 12), by least edge, and faces with a sheet twice (256, 64, 6)."""
    config = np.arange(256)[:, None]
    flips = np.arange(64)[None, :]
    links = []  # (edge, edge, where they are linked (256, 64))
    ambiguous = []
    for face in range(6):
        corners, edges = _face_layout(face)
        inside = [(config >> corner) & 1 == 1 for corner in corners]
        crossed = [inside[k] != inside[(k + 1) % 4] for k in range(4)]
        four = crossed[0] & crossed[1] & crossed[2] & crossed[3]
        flipped = (flips >> face) & 1 == 1
        ambiguous.append(four)
        for k in range(4):
            # A line round corner k joins the edges that meet there.
            around = four & (inside[k] != flipped)
            links.append((edges[k - 1], edges[k], around))
            for j in range(k):
                links.append((edges[j], edges[k], crossed[j] & crossed[k] & ~four))
    sheets = np.broadcast_to(np.arange(12, dtype=np.uint8), (256, 64, 12)).copy()
    before = None
    while before is None or (sheets != before).any():
        before = sheets.copy()
        for first, second, linked in links:
            least = np.minimum(sheets[..., first], sheets[..., second])
            sheets[..., first] = np.where(linked, least, sheets[..., first])
            sheets[..., second] = np.where(linked, least, sheets[..., second])
    doubled = np.zeros((256, 64, 6), dtype=bool)
    for face, four in enumerate(ambiguous):
        _, edges = _face_layout(face)
        doubled[..., face] = four & (sheets[..., edges[0]] == sheets[..., edges[2]])
    return sheets, doubled


def corner_configurations(inside: BoolArray, cells: IndexArray, grid: Grid) -> IndexArray:
    """Return which corners of cells (C,) are inside, one bit each; `inside` is flat, of nodes."""
    sx, sy, sz = grid.strides
    config = np.zeros(len(cells), dtype=np.intp)
    for corner in range(8):
        offset = (corner >> 2 & 1) * sx + (corner >> 1 & 1) * sy + (corner & 1) * sz
        config |= inside[cells + offset].astype(np.intp) << corner
    return config


def sheets_of_cells(config: IndexArray, cells: IndexArray, grid: Grid) -> ByteArray:
    """Return the sheet of each edge of each cell, shape (C, 12), manifold.

    `config` (C,) is of `corner_configurations`; `cells` (C,) are all that have a crossed edge,
    ascending.
    """
    sheets, doubled = _tables()
    flips = np.zeros(len(cells), dtype=np.intp)
    # Faces that could be doubled, each as (its lower cell, its upper cell, axis, parity).
    faces = []
    for axis in range(3):
        lower = np.flatnonzero(_ambiguous(config, 2 * axis + 1))
        upper = np.searchsorted(cells, cells[lower] + grid.strides[axis])
        odd = grid.coordinates(cells[lower])[:, axis] % 2 == 1
        faces += [(lower[odd], upper[odd], axis), (lower[~odd], upper[~odd], axis)]
    changed = True
    while changed:
        changed = False
        for lower, upper, axis in faces:  # no cell is twice among the faces of one turn
            below, above = 2 * axis + 1, 2 * axis
            bad = doubled[config[lower], flips[lower], below]
            bad &= doubled[config[upper], flips[upper], above]
            flips[lower[bad]] ^= 1 << below
            flips[upper[bad]] ^= 1 << above
            changed |= bool(bad.any())
    return sheets[config, flips]


def _ambiguous(config: IndexArray, face: int) -> BoolArray:
    corners, _ = _face_layout(face)
    bits = [(config >> corner) & 1 for corner in corners]
    return (bits[0] == bits[2]) & (bits[1] == bits[3]) & (bits[0] != bits[1])
