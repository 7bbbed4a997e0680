"""Points of true surfaces with smooth normals, to draw contacts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import sample_mesh, sample_segments
from lis_grasp.shapes import SHARP_ANGLE, Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.typing import FloatArray, IndexArray

# Points of a surface that contacts are drawn from, even in area.
_POINTS = 20_000
_EDGE_POINTS = 4_000
# A contact does not explore a surface that faces away from it: the other side of a thin wall.
_FACES_AWAY = -0.5


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePoints:
    """Points spread over a true surface in proportion to area, with the true normals."""

    shape: Shape
    points: FloatArray  # (P, 3) [m]
    normals: FloatArray  # (P, 3)
    edge_distances: FloatArray  # (P,) [m], to the nearest sharp edge; infinite without edges
    corners: FloatArray  # (F, 3, 3), normals of the corners of each triangle

    @classmethod
    def of(cls, shape: Shape) -> SurfacePoints:
        """Sample a shape without random numbers, with smooth normals between sharp edges."""
        points, faces = sample_mesh(shape.mesh, _POINTS)
        corners = corner_normals(shape.mesh, SHARP_ANGLE if len(shape.edges) else np.pi)
        normals = _interpolated(corners, shape.mesh, points, faces)
        distances = _edge_distances(shape, points, _EDGE_POINTS)
        return cls(shape, points, normals, distances, corners)

    @classmethod
    def with_face_normals(cls, shape: Shape) -> SurfacePoints:
        """Sample a shape without random numbers, with the normals of its triangles."""
        points, faces = sample_mesh(shape.mesh, _POINTS)
        units = np.asarray(shape.mesh.face_normals)
        corners = np.repeat(units[:, None], 3, axis=1)
        return cls(shape, points, units[faces], _edge_distances(shape, points, _POINTS), corners)

    def contacts(self, chosen: IndexArray) -> Contacts:
        """Return some of the points as exact contacts."""
        return Contacts(self.points[chosen], self.normals[chosen])

    def nearest(self, places: FloatArray) -> Contacts:
        """Return exact contacts at the points of the surface nearest to places (Q, 3) [m]."""
        mesh = self.shape.mesh
        _, faces = distances_to_mesh(places, mesh)
        points = trimesh.triangles.closest_point(np.asarray(mesh.triangles)[faces], places)
        return Contacts(points, _interpolated(self.corners, mesh, points, faces))

    def shrink_gaps(self, gaps: FloatArray, chosen: int) -> None:
        """Reduce the distances (P,) from each point to the nearest contact that faces its way.

        The new contact is at one of the points, given by its index.
        """
        apart = np.linalg.norm(self.points - self.points[chosen], axis=1)
        apart[self.normals @ self.normals[chosen] < _FACES_AWAY] = np.inf
        np.minimum(gaps, apart, out=gaps)


def _edge_distances(shape: Shape, points: FloatArray, samples: int) -> FloatArray:
    """Return the distance from points (P, 3) to the sharp edges; infinite without edges."""
    if not len(shape.edges):
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(sample_segments(shape.edges, samples)).query(points)[0])


def corner_normals(mesh: trimesh.Trimesh, largest_bend: float) -> FloatArray:
    """Return the unit normal of each corner of each triangle, shape (F, 3, 3).

    The area-weighted mean over the triangles round the corner's vertex that bend from this one by
    at most `largest_bend` [rad]: tessellation does not show in the normals, edges stay sharp.
    """
    faces, areas = np.asarray(mesh.faces), np.asarray(mesh.area_faces)
    units = np.asarray(mesh.face_normals)
    # Pairs of corners that share a vertex: sort corners by vertex, pair each with all of its group.
    order = np.argsort(faces.ravel(), kind="stable")
    counts = np.bincount(faces.ravel(), minlength=len(mesh.vertices))
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    sizes = counts[faces.ravel()[order]]
    first = np.repeat(order, sizes)
    within = np.arange(len(first)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    second = order[np.repeat(starts[faces.ravel()[order]], sizes) + within]
    own, other = units[first // 3], units[second // 3]
    alike = np.einsum("qk,qk->q", own, other) >= np.cos(largest_bend) - 1e-12
    weighted = np.where(alike, areas[second // 3], 0.0)[:, None] * other
    sums = np.column_stack([np.bincount(first, c, minlength=faces.size) for c in weighted.T])
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    sums = np.where(lengths > 0.0, sums / np.maximum(lengths, 1e-300), np.repeat(units, 3, axis=0))
    return np.asarray(sums.reshape(-1, 3, 3), dtype=np.float64)


def _interpolated(
    corners: FloatArray, mesh: trimesh.Trimesh, points: FloatArray, faces: IndexArray
) -> FloatArray:
    """Return the normals at points (P, 3) on triangles (P,), interpolated between corners."""
    weights = trimesh.triangles.points_to_barycentric(np.asarray(mesh.triangles)[faces], points)
    weights = np.clip(np.nan_to_num(weights, nan=1.0 / 3.0), 0.0, 1.0)
    normals = np.einsum("pc,pck->pk", weights, corners[faces])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
