"""Edge flips that remove slivers, triangles whose three vertices are nearly on a line."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray, IntArray

# A flip can turn the neighbour into a sliver's neighbour; chains of them take some rounds.
_ROUNDS = 10


def flip_slivers(vertices: FloatArray, faces: IntArray, *, height: float) -> tuple[IntArray, int]:
    """Flip the longest edge of each triangle lower than `height` [m] over that edge.

    A sliver has an edge as long as its two others together, and its normal is rounding. The flip
    gives its area to the neighbour across that edge: the surface stays, closed as it was, and no
    vertex is added or removed. A flip that would not make the lower of both triangles higher, or
    would repeat an edge, is not made.

    Returns the faces (F, 3) in their order, and how many flips were made.
    """
    faces, flips = np.array(faces), 0
    for _ in range(_ROUNDS):
        heights = _heights(vertices, faces)
        slivers = np.flatnonzero(heights < height)
        if not len(slivers):
            break
        # The face on the left of each directed edge; an edge with two such is not manifold.
        left = {}
        for number, face in enumerate(faces.tolist()):
            for k in range(3):
                left[face[k], face[(k + 1) % 3]] = number
        made = sum(_flip(vertices, faces, left, int(sliver)) for sliver in slivers)
        flips += made
        if not made:
            break
    return faces, flips


def _flip(
    vertices: FloatArray, faces: IntArray, left: dict[tuple[int, int], int], sliver: int
) -> bool:
    """Flip the longest edge of a face if that improves both triangles; return whether it did."""
    face = faces[sliver]
    k = int(np.argmax(_edge_lengths(vertices, face[None])[0]))
    a, c, b = (int(face[(k + i) % 3]) for i in range(3))  # the longest edge is from a to c
    neighbour = left.get((c, a))
    if neighbour is None or neighbour == sliver:
        return False
    d = int(next(v for v in faces[neighbour] if v not in (a, c)))
    if d == b or (b, d) in left or (d, b) in left:
        return False
    pair = np.array([face, faces[neighbour]])
    flipped = np.array([[b, a, d], [d, c, b]])
    if _heights(vertices, flipped).min() <= _heights(vertices, pair).min():
        return False
    for edge in ((a, c), (c, a)):
        del left[edge]
    faces[sliver], faces[neighbour] = flipped
    for number, corners in ((sliver, (b, a, d)), (neighbour, (d, c, b))):
        for i in range(3):
            left[corners[i], corners[(i + 1) % 3]] = number
    return True


def _edge_lengths(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the lengths of the edges from each corner to the next, shape (F, 3) [m]."""
    corners = vertices[faces]
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1))


def _heights(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the height of each triangle over its longest edge, shape (F,) [m]."""
    corners = vertices[faces]
    doubled = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = _edge_lengths(vertices, faces).max(axis=1)
    return np.asarray(doubled / np.maximum(longest, np.finfo(np.float64).tiny))
