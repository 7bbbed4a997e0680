"""Inside or outside of a triangle mesh, by winding number: no luck, no random draw."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.typing import FloatArray

# What is nearer to zero than this share of its largest terms has no sure sign.
_ROUNDING = 1e-12


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
    """Tell whether any of the points (P, 3) [m] is inside a closed, outward-oriented mesh.

    Of a closed mesh the winding number is the count of faces that a line from the point upward
    leaves through, less those that it enters through. Few triangles are above a point, so that
    counting takes a thirtieth of the time of adding up all angles, which is left for points
    above which the line meets an edge.
    """
    low, high = mesh.bounds
    boxed = points[np.all((points > low) & (points < high), axis=1)]
    return any(_winds(point, mesh) for point in boxed)


def _winds(point: FloatArray, mesh: trimesh.Trimesh) -> bool:
    triangles = np.asarray(mesh.triangles)
    count = _crossings_above(point, triangles) if mesh.is_watertight else None
    if count is None:
        return winding_number(point, triangles) > 0.5
    return count > 0


def _crossings_above(point: FloatArray, triangles: FloatArray) -> int | None:
    """Return how often a line upward leaves, less how often it enters; None if it meets an edge."""
    for axis in (0, 1):  # only what is above or below the point in the plane of x and y
        side = triangles[:, :, axis] > point[axis]
        triangles = triangles[(side[:, 0] != side[:, 1]) | (side[:, 0] != side[:, 2])]
    corners = triangles - point  # (T, 3, 3)
    x, y = corners[:, :, 0], corners[:, :, 1]
    # Twice the signed areas of the point's triangles with each edge, seen from above.
    areas = x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)  # (T, 3)
    unclear = _ROUNDING * (x**2 + y**2).max(initial=0.0)
    if (np.abs(areas) <= unclear).any():
        return None
    through = (areas > 0.0).all(axis=1) | (areas < 0.0).all(axis=1)
    corners, upward = corners[through], np.sign(areas[through, 0])
    a, b, c = np.moveaxis(corners, 1, 0)
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    if (np.abs(volumes) <= _ROUNDING * np.abs(corners).max(initial=0.0) ** 3).any():
        return None  # the point is on the surface
    # A face turned up is above the point if the point is behind it: then the volume is positive.
    return int(upward[volumes * upward > 0.0].sum())
