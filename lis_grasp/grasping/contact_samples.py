"""Sampled contact points of a mesh: points that a pad can press on, with normals."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.typing import BoolArray, FloatArray, IndexArray

_SAMPLES = 4000
# Flat enough for a pad: normals within this radius [m] differ by at most this angle [rad] from the
# middle one. Averted normals belong to the far side of a thin object and do not count.
_FLAT_RADIUS, _FLAT_ANGLE = 0.006, np.deg2rad(25.0)
_AVERTED = np.cos(np.deg2rad(100.0))
_BULGE = 0.0005  # [m] by which the surface round a bend's sample may rise above its tangent plane
# Edges of more than 150 degrees are too sharp to press on: least length of their normals' sum.
_BLADE = 2.0 * np.cos(np.deg2rad(150.0) / 2.0)
_EDGE_STEP = 0.001  # [m] between points that are sampled along a sharp edge
SEARCH_RADIUS = 0.005
"""Largest distance of a contact from its nearest sample along the tangent plane [m]."""
# Vertices whose uncertainty exceeds this many times the median are not supported by touches.
_UNSUPPORTED = 3.0


class SurfaceSamples:
    """Points of a mesh that a pad can press on, with their normals.

    The mesh is closed, in O [m]; all points are above the height `lowest` [m]. With `bends`, pads
    may also press on convex bends: sharp edges, ribs, and thin rods and balls. The surface falls
    off alike on opposite sides there, so that the pad rests on the ridge. The normal of a sharp
    edge is halfway between those of its two faces.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        *,
        lowest: float,
        rng: np.random.Generator,
        bends: bool = False,
    ) -> None:
        points, normals, faces = _on_faces(mesh, rng)
        sharp = np.flatnonzero(np.asarray(mesh.face_adjacency_angles) > _FLAT_ANGLE)
        along, edge = _along_edges(mesh, sharp)
        known = _supported(mesh)
        flat = _flat(points, normals) & ~_near(along, points)
        usable = flat & known[faces]
        if bends:
            sides = np.asarray(mesh.face_adjacency)[edge]  # (E, 2)
            halfway = np.asarray(mesh.face_normals)[sides].sum(axis=1)
            length = np.linalg.norm(halfway, axis=1)
            ridge = np.asarray(mesh.face_adjacency_convex)[edge] & (length > _BLADE)
            sides, halfway = sides[ridge], halfway[ridge] / length[ridge, None]
            on_faces = points
            points, normals = np.vstack([points, along[ridge]]), np.vstack([normals, halfway])
            even = _bends_evenly(points, normals) & ~_near(along[~ridge], points)
            usable |= even[: len(faces)] & known[faces]
            # A pad across an edge could as well rest on the flat top or side of a rib.
            across = even[len(faces) :] & known[sides].all(axis=1)
            across &= ~_near(on_faces[usable], along[ridge])
            usable = np.concatenate([usable, across])
            flat = np.concatenate([flat, np.zeros(len(sides), dtype=bool)])
        usable &= points[:, 2] > lowest
        self.points: FloatArray = points[usable]
        self.normals: FloatArray = normals[usable]
        self.flat: BoolArray = flat[usable]
        self.tree = cKDTree(self.points) if len(self.points) else None

    def __len__(self) -> int:
        return len(self.points)

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (..., 3) on the surface; return them, normals, and which are usable."""
        assert self.tree is not None
        _, index = self.tree.query(points)
        normals = self.normals[index]
        height = ((points - self.points[index]) * normals).sum(axis=-1, keepdims=True)
        on_plane = points - height * normals
        beside = np.linalg.norm(on_plane - self.points[index], axis=-1)
        on_surface = np.where(self.flat[index, None], on_plane, self.points[index])
        return on_surface, normals, beside <= SEARCH_RADIUS

    def intersect(self, p: FloatArray, direction: FloatArray, j: int) -> FloatArray:
        """Return where a line from p, shape (3,), meets the tangent plane of sample j.

        On a bend, return the sample itself.
        """
        if not self.flat[j]:
            return self.points[j]
        point, normal = self.points[j], self.normals[j]
        return np.asarray(p + direction * (((point - p) @ normal) / (direction @ normal)))


# `trimesh.sample.sample_surface` draws other numbers in another order: its grasps would differ.
def _on_faces(
    mesh: trimesh.Trimesh, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Return points (S, 3) spread over the mesh by area, their normals, and their faces (S,)."""
    weights = mesh.area_faces / mesh.area_faces.sum()
    faces = rng.choice(len(weights), size=_SAMPLES, p=weights)
    u, v = rng.random((2, _SAMPLES))
    flip = u + v > 1.0
    u, v = np.where(flip, 1.0 - u, u), np.where(flip, 1.0 - v, v)
    a, b, c = np.moveaxis(mesh.triangles[faces], 1, 0)  # (S, 3) each
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return points, np.asarray(mesh.face_normals)[faces], faces


def _flat(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return which samples have only similar normals around them."""
    pairs = cKDTree(points).query_pairs(_FLAT_RADIUS, output_type="ndarray")  # (P, 2)
    bent = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) < np.cos(_FLAT_ANGLE)
    flat = np.ones(len(points), dtype=bool)
    flat[pairs[bent].ravel()] = False
    return flat


def _bends_evenly(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return which samples are on a ridge: the surface falls off alike on opposite sides."""
    tree = cKDTree(points)
    even = np.zeros(len(points), dtype=bool)
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        around = tree.query_ball_point(point, _FLAT_RADIUS)
        cosines = normals[around] @ normal
        facing = cosines > _AVERTED
        tilts = normals[around][facing] - cosines[facing, None] * normal  # (N, 3)
        sizes = np.linalg.norm(tilts, axis=1)
        steepest = tilts[sizes.argmax()] / max(sizes.max(), np.finfo(float).tiny)
        along = tilts @ np.column_stack([steepest, np.cross(normal, steepest)])  # (N, 2)
        uneven = np.abs(along.max(axis=0) + along.min(axis=0))
        risen = ((points[around] - point) @ normal).max()
        even[i] = (uneven <= np.sin(_FLAT_ANGLE)).all() and risen <= _BULGE
    return even


def _near(places: FloatArray, points: FloatArray) -> BoolArray:
    """Return which points are within a pad's flat radius of some place."""
    if not len(places):
        return np.zeros(len(points), dtype=bool)
    distances, _ = cKDTree(places).query(points, distance_upper_bound=_FLAT_RADIUS)
    return np.isfinite(distances)


def _along_edges(mesh: trimesh.Trimesh, chosen: IndexArray) -> tuple[FloatArray, IndexArray]:
    """Return points (P, 3) along the chosen edges between faces, and which edge each is of."""
    ends = np.asarray(mesh.vertices)[np.asarray(mesh.face_adjacency_edges)[chosen]]  # (E, 2, 3)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    counts = np.maximum(np.ceil(lengths / _EDGE_STEP).astype(int) + 1, 2)
    edge = np.repeat(np.arange(len(ends)), counts)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (place / (counts[edge] - 1))[:, None]
    return (1.0 - along) * ends[edge, 0] + along * ends[edge, 1], chosen[edge]


def _supported(mesh: trimesh.Trimesh) -> BoolArray:
    """Return which faces touches support, by the mesh's uncertainty; all without it."""
    uncertainty = mesh.vertex_attributes.get("uncertainty")
    if uncertainty is None:
        return np.ones(len(mesh.faces), dtype=bool)
    of_face = np.asarray(uncertainty)[mesh.faces].mean(axis=1)  # (faces,)
    return np.asarray(of_face <= _UNSUPPORTED * np.median(of_face) + 1e-12)
