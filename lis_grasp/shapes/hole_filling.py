"""Hole filling by the triangulation of least area.

G. Barequet, M. Sharir, "Filling gaps in the boundary of a polyhedron", Computer Aided Geometric
Design 12, 1995: of all triangulations of a loop of vertices the one of least area, by dynamic
programming. Least area does not fold over itself. A little weight on lengths avoids slivers where
flat parts leave a choice.
"""

from __future__ import annotations

import numpy as np

from lis_grasp.shapes.topology import edge_keys
from lis_grasp.typing import BoolArray, FloatArray, IntArray

# Squared edge lengths count this much against areas.
_LENGTH_WEIGHT = 0.01
# A triangle with less area than this fraction of its squared edge lengths is a sliver.
_SLIVER = 1e-3
# Time grows with the cube of the loop's length: half a second here, and a fan beyond it.
_LONGEST = 400


def fill_loop(vertices: FloatArray, faces: IntArray, loop: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the triangles (F, 3) that close a loop, and the vertices (0 or 1, 3) that they add.

    The loop (n,) of vertices runs along the direction of the faces that it borders.
    """
    if len(loop) <= _LONGEST:
        corners = _least_area(vertices[loop], _forbidden(faces, loop))
        if corners is not None:
            return loop[corners], np.empty((0, 3))
    return _fan(vertices, loop)


def _forbidden(faces: IntArray, loop: IntArray) -> BoolArray:
    """Return which chords (n, n) are edges of the mesh already and can take no more faces."""
    n = len(loop)
    if n == 3:
        return np.zeros((n, n), dtype=bool)  # no chords
    i, j = np.triu_indices(n, 2)
    base = int(faces.max()) + 1
    used = np.isin(edge_keys(loop[i], loop[j], base), edge_keys(faces, np.roll(faces, -1, 1), base))
    used &= (i > 0) | (j < n - 1)  # the loop's own last edge
    forbidden = np.zeros((n, n), dtype=bool)
    forbidden[i, j] = used
    return forbidden


def _least_area(ring: FloatArray, forbidden: BoolArray) -> IntArray | None:
    """Return the best triangulation of a ring (n, 3) as rows of its corners, or None."""
    # cost[i, j] is that of the ring's part from i to j, closed by the chord between them.
    n = len(ring)
    cost = np.full((n, n), np.inf)
    cost[np.arange(n - 1), np.arange(1, n)] = 0.0
    apex = np.zeros((n, n), dtype=np.int64)
    squared = np.sum((ring[:, None] - ring) ** 2, axis=-1)  # (n, n)
    for span in range(2, n):
        i = np.arange(n - span)[:, None]
        j = i + span
        m = i + np.arange(1, span)  # (n - span, span - 1), the third corner
        area = 0.5 * np.linalg.norm(np.cross(ring[m] - ring[i], ring[j] - ring[i]), axis=-1)
        total = cost[i, m] + cost[m, j] + area
        lengths = squared[i, m] + squared[m, j] + squared[i, j]
        total += np.where(area < _SLIVER * lengths, 1.0, _LENGTH_WEIGHT) * lengths
        best = np.argmin(total, axis=1)
        rows = np.arange(n - span)
        cost[rows, rows + span] = np.where(forbidden[rows, rows + span], np.inf, total[rows, best])
        apex[rows, rows + span] = m[rows, best]
    if not np.isfinite(cost[0, n - 1]):
        return None
    corners, pending = [], [(0, n - 1)]
    while pending:
        first, last = pending.pop()
        if last - first > 1:
            middle = int(apex[first, last])
            corners.append((last, middle, first))
            pending += [(first, middle), (middle, last)]
    return np.array(corners, dtype=np.int64)


def _fan(vertices: FloatArray, loop: IntArray) -> tuple[IntArray, FloatArray]:
    """Close a loop by triangles to a new vertex, its middle weighted by edge length."""
    ring = vertices[loop]
    following = np.roll(ring, -1, axis=0)
    lengths = np.linalg.norm(following - ring, axis=1)
    center = np.average(0.5 * (ring + following), axis=0, weights=lengths)
    hub = np.full(len(loop), len(vertices))
    return np.column_stack([np.roll(loop, -1), loop, hub]), center[None]
