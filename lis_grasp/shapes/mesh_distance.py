"""Distances from points to a triangle mesh, by libigl's bounding-volume tree."""

from __future__ import annotations

import igl
import numpy as np
import trimesh

from lis_grasp.typing import FloatArray, IndexArray


def distances_to_mesh(points: FloatArray, mesh: trimesh.Trimesh) -> tuple[FloatArray, IndexArray]:
    """Return the distance of each point to the nearest point of a mesh, and the triangle it is on.

    Exact but for rounding on closed meshes, slivers included. On a triangle a million times longer
    than wide, libigl overestimates the distance; its neighbours share its edges and are exact.

    Parameters
    ----------
    points
        Shape (P, 3) [m].
    mesh
        With at least one triangle.

    Returns
    -------
    distances
        Shape (P,) [m], at least 0.
    faces
        Shape (P,), a triangle of `mesh.faces` at that distance; any of them at an edge.
    """
    squares, faces, _ = MeshTree(mesh).nearest(points)
    return np.sqrt(squares), faces


def closest_points(points: FloatArray, mesh: trimesh.Trimesh) -> tuple[FloatArray, IndexArray]:
    """Return the nearest point (P, 3) [m] of a mesh to each point, and the triangle it is on."""
    _, faces, nearest = MeshTree(mesh).nearest(points)
    return nearest, faces


class MeshTree:
    """The bounding-volume tree of a mesh with at least one triangle, for many small queries."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._arrays = np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
        self._tree = igl.AABB()
        self._tree.init(*self._arrays)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, IndexArray, FloatArray]:
        """Return squared distances (P,) of points (P, 3), triangles (P,), nearest points (P, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        return self._tree.squared_distance(*self._arrays, points)  # type: ignore[no-any-return]
