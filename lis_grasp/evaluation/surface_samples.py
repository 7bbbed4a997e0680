"""Deterministic samples, spread evenly over meshes and along edges."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.typing import FloatArray, IndexArray

# Steps of the golden sequence in two dimensions (Roberts 2018, "R2"): 1/g, 1/g^2, g^3 = g + 1.
_STEP = np.array([0.7548776662466927, 0.5698402909980532])


def sample_mesh(mesh: trimesh.Trimesh, count: int) -> tuple[FloatArray, IndexArray]:
    """Return `count` points spread over a mesh in proportion to area, and the triangle of each.

    Stratified by area over the triangles in order; within triangles a low-discrepancy sequence. No
    random numbers: equal meshes have equal samples. Shapes (count, 3) [m] and (count,).
    """
    corners = np.array(mesh.triangles)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    passed = np.cumsum(np.linalg.norm(np.cross(first, second), axis=1))
    faces = np.searchsorted(passed, (np.arange(count) + 0.5) / count * passed[-1], side="right")
    u, v = ((np.arange(count)[:, None] + 0.5) * _STEP % 1.0).T
    beyond = u + v > 1.0  # the other half of the parallelogram
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    points = corners[faces, 0] + u[:, None] * first[faces] + v[:, None] * second[faces]
    return points, faces


def sample_segments(segments: FloatArray, count: int) -> FloatArray:
    """Return `count` points evenly along straight pieces (E, 2, 3) put end to end, (count, 3)."""
    steps = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(steps, axis=1)
    passed = np.cumsum(lengths)
    along = (np.arange(count) + 0.5) / count * passed[-1]
    piece = np.searchsorted(passed, along, side="right")
    fraction = (along - (passed - lengths)[piece]) / lengths[piece]
    return np.asarray(segments[piece, 0] + fraction[:, None] * steps[piece])
