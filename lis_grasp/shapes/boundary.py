"""The open borders of a triangle mesh, as closed loops, and the triangles that close one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


def boundary_loops(faces: IndexArray) -> list[IndexArray]:
    """Return the borders of a mesh whose inner edges have two agreeing faces each.

    Every loop runs along its faces' own direction and passes no vertex twice. As many border
    edges enter a vertex as leave it, so a walk can only end where it began; where it meets itself
    before that, the part in between is a loop of its own.
    """
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, inverse, count = np.unique(
        np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    border = directed[count[inverse.reshape(-1)] == 1]
    following: dict[int, list[int]] = {}
    for start, end in border.tolist():
        following.setdefault(start, []).append(end)
    loops = []
    for start in sorted(following):
        while following[start]:
            loops += _walk(following, start)
    return loops


def _walk(following: dict[int, list[int]], start: int) -> list[IndexArray]:
    """Walk from `start` until back there, using edges up, and cut off a loop at each crossing."""
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


def fill_loop(vertices: FloatArray, loop: IndexArray) -> tuple[IndexArray, FloatArray]:
    """Return the triangles (F, 3) that close a loop, and the vertices (0 or 1, 3) that they add.

    Three edges are one triangle; more are a fan about the loop's middle, weighted by length so
    that many short edges on one side do not pull it there.
    """
    if len(loop) == 3:
        return loop[None, ::-1].copy(), np.empty((0, 3))
    ring = vertices[loop]
    middles = 0.5 * (ring + np.roll(ring, -1, axis=0))
    lengths = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    center = np.average(middles, axis=0, weights=lengths)
    hub = np.full(len(loop), len(vertices))
    return np.column_stack([np.roll(loop, -1), loop, hub]), center[None]
