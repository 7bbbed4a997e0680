"""Inside or outside of a triangle mesh, by winding number: no ray, no luck, no random draw."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

FloatArray = npt.NDArray[np.float64]


def winding_number(point: FloatArray, triangles: FloatArray) -> float:
    """Return how often triangles wind round a point: 1 inside a closed outward mesh, 0 outside.

    Sum of the triangles' solid angles (Van Oosterom and Strackee 1983) over 4 pi. Unlike Drake's
    signed distance it takes meshes with folded triangles, which scans have; unlike the parity of a
    ray's crossings it has no bad directions.

    Parameters
    ----------
    point
        Shape (3,) [m].
    triangles
        Shape (T, 3, 3) [m], corners in order.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)  # each (T, 3)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
    denominator = la * lb * lc + ab * lc + bc * la + ca * lb
    return float(np.arctan2(numerator, denominator).sum() / (2.0 * np.pi))


def any_inside(mesh: trimesh.Trimesh, points: FloatArray) -> bool:
    """Tell whether any of the points (P, 3) [m] is inside a closed, outward-oriented mesh."""
    low, high = mesh.bounds
    boxed = points[np.all((points > low) & (points < high), axis=1)]
    return any(winding_number(point, mesh.triangles) > 0.5 for point in boxed)
