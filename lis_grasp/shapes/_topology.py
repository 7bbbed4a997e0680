"""Edge topology of a triangle mesh: non-manifold edges, orientation, boundary loops, their filling.

Holes are filled by the triangulation of least area (G. Barequet, M. Sharir, "Filling gaps in the
boundary of a polyhedron", Computer Aided Geometric Design 12, 1995): of all triangulations of a
loop of vertices the one of least area, by dynamic programming. Least area does not fold over
itself. Slivers count their squared edge lengths, which avoids them where flat parts leave a choice.
"""

from __future__ import annotations

import numpy as np
from trimesh.graph import connected_component_labels

from lis_grasp.geometry import tangent_frame, unit
from lis_grasp.typing import BoolArray, FloatArray, IntArray

# Faces at one edge whose directions differ by less than this [rad] coincide.
_SAME_ANGLE = 1e-6


# A triangle with less area than this fraction of its squared edge lengths is a sliver.
_SLIVER = 1e-3
# Time grows with the cube of the loop's length: half a second here, and a fan beyond it.
_LONGEST = 400


def signed_volume(triangles: FloatArray) -> float:
    """Return the volume that closed triangles (F, 3, 3) enclose [m^3], negative if inside out."""
    about_middle = triangles - triangles.reshape(-1, 3).mean(axis=0)
    return float(np.linalg.det(about_middle).sum() / 6.0)


def edge_keys(start: IntArray, end: IntArray, base: int) -> IntArray:
    """Return one number for each edge, whichever way it runs; vertices are below `base`."""
    return np.minimum(start, end) * base + np.maximum(start, end)


def edge_groups(faces: IntArray) -> tuple[IntArray, BoolArray, IntArray]:
    """Number the edges of faces (F, 3).

    Returns the number of the edge from each corner to the next (F, 3); whether the face runs along
    it from its lower to its higher vertex (F, 3); and how many faces each edge has (E,).
    """
    start, end = faces, np.roll(faces, -1, axis=1)
    keys = edge_keys(start, end, int(faces.max(initial=0)) + 1)
    _, edge, count = np.unique(keys, return_inverse=True, return_counts=True)
    return edge.reshape(-1, 3), start < end, count


def is_bad_edge(edge: IntArray, forward: BoolArray, count: IntArray) -> BoolArray:
    """Return which edges, shape (E,), have three faces or more, or two that disagree."""
    ahead = np.bincount(edge.ravel(), weights=forward.ravel(), minlength=len(count))
    return (count > 2) | ((count == 2) & (ahead != 1))


def disagreeing_faces(faces: IntArray) -> BoolArray:
    """Return the fewest faces, shape (F,), to turn over so that neighbours agree.

    Every face is two nodes, as it is and turned over, linked to the node of each neighbour that
    it agrees with: the nodes of a part that can be oriented fall into two components, one the
    other's reverse. The faces of a part that cannot (a Moebius strip) stay as they are.
    """
    edge, forward, count = edge_groups(faces)
    n = len(faces)
    by_edge = np.argsort(edge.ravel(), kind="stable")
    two = by_edge[np.cumsum(count)[count == 2, None] - [2, 1]]  # (E2, 2), corners
    a, b = (two // 3).T
    disagree = forward.ravel()[two[:, 0]] == forward.ravel()[two[:, 1]]
    links = np.concatenate([[a, b + n * disagree], [a + n, b + n * ~disagree]], axis=1).T
    label = connected_component_labels(links, 2 * n)
    as_is, turned = label[:n], label[n:]
    kept = np.bincount(as_is, minlength=label.max(initial=-1) + 1)  # faces of each way as they are
    fewer = kept[turned] > kept[as_is]
    tie = (kept[turned] == kept[as_is]) & (turned < as_is)
    return (as_is != turned) & (fewer | tie)


def drop_fins(faces: IntArray) -> BoolArray:
    """Return the faces, shape (F,), to keep without fins.

    A fin has an edge with more than two faces on one side and an open edge on the other.
    """
    kept = np.ones(len(faces), dtype=bool)
    while True:
        edge, _, count = edge_groups(faces[kept])
        fins = (count[edge] > 2).any(axis=1) & (count[edge] == 1).any(axis=1)
        if not fins.any():
            return kept
        kept[np.flatnonzero(kept)[fins]] = False


def split_at_shared_edges(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Separate solids that touch along an edge, by duplicating vertices there.

    Round such an edge the faces are paired across the material between them. Vertices that are at
    no such edge stay as they are.
    """
    edge, forward, count = edge_groups(faces)
    # An edge of a face is named by the corner (3 * face + k) that it starts from.
    by_edge = np.argsort(edge.ravel(), kind="stable")
    last = np.cumsum(count)
    two = by_edge[last[count == 2, None] - [2, 1]]  # (E2, 2)
    pairs = [two[forward.ravel()[two].sum(axis=1) == 1]]
    for number in np.flatnonzero(count > 2):
        sides = by_edge[last[number] - count[number] : last[number]]
        ahead, behind = sides[forward.ravel()[sides]], sides[~forward.ravel()[sides]]
        if len(ahead) == len(behind):
            pairs.append(_pair_round_edge(vertices, faces, ahead, behind))
    a, b = np.concatenate(pairs).T  # one runs from u to v, the other from v to u
    next_a, next_b = (i - i % 3 + (i + 1) % 3 for i in (a, b))
    # Vertices at no shared edge keep all their corners together.
    shared = np.zeros(len(vertices), dtype=bool)
    face, k = np.nonzero(count[edge] > 2)
    shared[faces[face, k]] = shared[faces[face, (k + 1) % 3]] = True
    _, first, inverse = np.unique(faces, return_index=True, return_inverse=True)
    whole = np.flatnonzero(~shared[faces.ravel()])
    same = [[a, next_b], [next_a, b], [whole, first[inverse.ravel()[whole]]]]
    split = connected_component_labels(np.concatenate(same, axis=1).T, faces.size)
    _, used = np.unique(split, return_index=True)
    return vertices[faces.ravel()[used]], split.astype(np.int64).reshape(-1, 3)


def _pair_round_edge(
    vertices: FloatArray, faces: IntArray, ahead: IntArray, behind: IntArray
) -> IntArray:
    """Pair the faces at one edge, given by corner numbers, with material between each two."""
    start = faces.ravel()[ahead[0]]
    end = faces[ahead[0] // 3, (ahead[0] + 1) % 3]
    first, second = tangent_frame(unit(vertices[end] - vertices[start]))

    def angles(corners: IntArray) -> FloatArray:
        away = vertices[faces[corners // 3, (corners + 2) % 3]] - vertices[start]
        return np.arctan2(away @ second, away @ first)

    # A face that runs along the axis has its material on the side of smaller angles.
    turn = np.mod(angles(ahead)[:, None] - angles(behind), 2.0 * np.pi)
    turn = np.where(turn < _SAME_ANGLE, 2.0 * np.pi, turn)
    pairs = []
    for _ in range(len(ahead)):
        i, j = np.unravel_index(np.argmin(turn), turn.shape)
        pairs.append((int(ahead[i]), int(behind[j])))
        turn[i, :] = turn[:, j] = np.inf
    return np.array(pairs, dtype=np.int64)


def boundary_loops(faces: IntArray) -> list[IntArray]:
    """Return the borders of a mesh whose inner edges have two agreeing faces each.

    Every loop runs along its faces' own direction and passes no vertex twice. As many border edges
    enter a vertex as leave it, so a walk ends where it began; a part between two visits of a vertex
    is a loop of its own.
    """
    edge, _, count = edge_groups(faces)
    face, k = np.nonzero(count[edge] == 1)
    following: dict[int, list[int]] = {}
    for start, end in zip(faces[face, k].tolist(), faces[face, (k + 1) % 3].tolist(), strict=True):
        following.setdefault(start, []).append(end)
    loops = []
    for start in sorted(following):
        while following[start]:
            loops += _walk(following, start)
    return loops


def _walk(following: dict[int, list[int]], start: int) -> list[IntArray]:
    """Walk from `start` back to it, consuming edges; cut off a loop at each vertex met again."""
    loops = []
    path, position = [start], {start: 0}
    while True:
        vertex = following[path[-1]].pop()
        if vertex not in position:
            position[vertex] = len(path)
            path.append(vertex)
            continue
        loop = path[position[vertex] :]
        loops.append(np.array(loop, dtype=np.int64))
        for passed in loop[1:]:
            del position[passed]
        path = path[: position[vertex] + 1]
        if vertex == start:
            return loops


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
    # cost[i, j] is the cost of the ring's part from i to j, closed by the chord between them.
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
        total += np.where(area < _SLIVER * lengths, lengths, 0.0)
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
