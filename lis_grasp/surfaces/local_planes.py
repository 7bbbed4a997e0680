"""Local planes: normals of a dense point cloud by principal component analysis of neighbours.

Hoppe et al. (1992, Surface reconstruction from unorganized points), section 3.1. The sign of a
normal is that of a reference, not propagated.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray

# Neighbours of a plane, the point itself included.
_NEIGHBOURS = 12
# Least sine of a normal's standard deviation: a plane of neighbours on a curved surface is biased.
_LEAST_DEVIATION = 0.05


def local_planes(points: FloatArray, references: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit normals of the plane about each point, and their standard deviations.

    Parameters
    ----------
    points
        Shape (N, 3) [m].
    references
        Shape (N, 3): each normal is turned to the side of its reference.

    Returns
    -------
    normals, deviations
        Shapes (N, 3) and (N,) [rad]. A deviation is that of the least-squares plane's slope: the
        neighbours' scatter across the plane, over their smaller extent along it.
    """
    count = min(_NEIGHBOURS, len(points))
    _, index = cKDTree(points).query(points, count)
    offsets = points[np.reshape(index, (len(points), count))]  # (N, K, 3)
    offsets = offsets - offsets.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(offsets.transpose(0, 2, 1) @ offsets)
    normals = vectors[:, :, 0]
    signs = np.where(np.sum(normals * references, axis=1) < 0.0, -1.0, 1.0)
    across = np.maximum(values[:, 0], 0.0) / max(count - 3, 1)
    deviations = np.sqrt(across / np.maximum(values[:, 1], 1e-300))
    return signs[:, None] * normals, np.maximum(deviations, _LEAST_DEVIATION)
