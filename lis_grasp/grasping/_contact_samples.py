"""Sampled contact points of a mesh: points that a pad can press on, with normals."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from lis_grasp.geometry import angle_between, cross, unit
from lis_grasp.shapes.mesh_distance import closest_points
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

_SAMPLES = 4000
# Flat enough for a pad: normals within this radius [m] differ by at most this angle [rad] from the
# middle one. Averted normals belong to the far side of a thin object and do not count.
_FLAT_RADIUS, _FLAT_ANGLE = 0.006, np.deg2rad(25.0)
# On a narrow face, a pad may overhang convex edges that are at least as far away as this [m].
_NARROW_RADIUS = 0.001
_AVERTED = np.cos(np.deg2rad(100.0))
_BULGE = 0.0005  # [m] by which the surface round a bend's sample may rise above its tangent plane
# Edges of more than 150 degrees are too sharp to press on: least length of their normals' sum.
_BLADE = 2.0 * np.cos(np.deg2rad(150.0) / 2.0)
_EDGE_STEP = 0.001  # [m] between points that are sampled along a sharp edge
# A rounded pad rests on an edge in any direction between the normals of its faces. One is taken at
# each point, spread by the golden ratio.
_NORMAL_UNIT = 0.006  # [m]: distance that counts as much as normals one apart
SEARCH_RADIUS = 0.005
"""Largest distance of a contact from its nearest sample along the tangent plane [m]."""
# A tangent plane's contact may be on a face whose normal has at least this cosine with the plane's.
_SAME_SURFACE = np.cos(np.deg2rad(40.0))
_ALONG = 1e-6  # least cosine between a line and the normal of a plane that it meets
# Surface is not supported by touches if its uncertainty exceeds this many times the median, and
# this much [m]: most of a flat object is its top, which is known far better than its low sides.
_UNSUPPORTED, _UNCERTAIN = 3.0, 0.004


class SurfaceSamples:
    """Points of a mesh that a pad can press on, with their normals.

    The mesh is closed, in O [m]. A pad of radius `pad_radius` [m], 0 for a flat one, stays above
    the height `lowest` [m] with all of its sphere. With `bends`, pads may also press on convex
    bends: sharp edges, ribs, and thin rods and balls. The surface falls off alike on opposite sides
    there, so that the pad rests on the ridge. The normal of a sharp edge is halfway between those
    of its two faces for a flat pad, and anywhere between them for a rounded one.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        *,
        lowest: float,
        rng: np.random.Generator,
        bends: bool = False,
        pad_radius: float = 0.0,
    ) -> None:
        def clears(points: FloatArray, normals: FloatArray) -> BoolArray:
            return points[:, 2] - pad_radius * (1.0 - normals[:, 2]) > lowest

        points, normals, faces = _on_faces(mesh, rng)
        sharp = np.flatnonzero(np.asarray(mesh.face_adjacency_angles) > _FLAT_ANGLE)
        along, edge = _along_edges(mesh, sharp)
        known = _supported(mesh)
        flat = _flat(points, normals) & ~_near(along, points)
        usable = flat & known[faces] & clears(points, normals)
        if bends:
            sides = np.asarray(mesh.face_adjacency)[edge]  # (E, 2)
            of_sides = np.asarray(mesh.face_normals)[sides]  # (E, 2, 3)
            halfway = of_sides.sum(axis=1)
            length = np.linalg.norm(halfway, axis=1)
            ridge = np.asarray(mesh.face_adjacency_convex)[edge] & (length > _BLADE)
            middles = np.vstack([points, along[ridge]])
            even = _bends_evenly(
                middles, np.vstack([normals, halfway[ridge] / length[ridge, None]])
            ) & ~_near(along[~ridge], middles)
            usable |= even[: len(faces)] & known[faces] & clears(points, normals)
            # A pad across an edge could as well rest on the flat top or side of a rib.
            across = even[len(faces) :] & known[sides[ridge]].all(axis=1)
            across &= ~_near(points[usable], along[ridge])
            narrow = _flat(points, normals, _NARROW_RADIUS) & ~_near(along[~ridge], points)
            narrow &= ~_near(along, points, _NARROW_RADIUS) & ~_rises(points, normals)
            narrow &= ~_near(points[usable], points)
            usable |= narrow & known[faces] & clears(points, normals)
            on_edges, of_edges = _on_edges(
                along[ridge][across], of_sides[ridge][across], rounded=pad_radius > 0.0
            )
            points, normals = np.vstack([points, on_edges]), np.vstack([normals, of_edges])
            usable = np.concatenate([usable, clears(on_edges, of_edges)])
            flat = np.concatenate([flat, np.zeros(len(on_edges), dtype=bool)])
        self._mesh = mesh
        self.center: FloatArray = np.asarray(mesh.center_mass)
        self.points: FloatArray = points[usable]
        self.normals: FloatArray = normals[usable]
        self.flat: BoolArray = flat[usable]
        self._tree = cKDTree(self._places(self.points, self.normals)) if len(self.points) else None

    def __len__(self) -> int:
        return len(self.points)

    def query(self, points: FloatArray, normals: FloatArray) -> IndexArray:
        """Return the samples nearest to points (..., 3) with similar normals (..., 3)."""
        assert self._tree is not None
        return np.asarray(self._tree.query(self._places(points, normals))[1])

    def nearest(
        self, points: FloatArray, normals: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Project points (..., 3) on the surface with similar normals (..., 3).

        Return the projected points, their normals, and which are usable.
        """
        index = self.query(points, normals)
        normals = self.normals[index]
        height = ((points - self.points[index]) * normals).sum(axis=-1, keepdims=True)
        on_plane = points - height * normals
        beside = np.linalg.norm(on_plane - self.points[index], axis=-1)
        flat = self.flat[index]
        on_surface, bent = self.project(on_plane, normals)
        on_surface = np.where(flat[..., None], on_surface, self.points[index])
        normals = np.where(flat[..., None], bent, normals)
        return on_surface, normals, beside <= SEARCH_RADIUS

    def project(self, points: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return contacts (..., 3) on tangent planes and their normals on the mesh itself.

        A contact is up to 5 mm beside its sample, where a tube of 2 cm has turned by 28 degrees.
        One whose nearest face has another normal than its flat surroundings stays as it is.
        """
        nearest, faces = closest_points(points.reshape(-1, 3), self._mesh)
        nearest = nearest.reshape(points.shape)
        there = np.asarray(self._mesh.face_normals)[faces].reshape(points.shape)
        alike = (there * normals).sum(axis=-1, keepdims=True) >= _SAME_SURFACE
        alike &= np.linalg.norm(nearest - points, axis=-1, keepdims=True) <= SEARCH_RADIUS
        return np.where(alike, nearest, points), np.where(alike, there, normals)

    def intersect(self, p: FloatArray, direction: FloatArray, j: int) -> FloatArray:
        """Return where a line from p, shape (3,), meets the tangent plane of sample j.

        On a bend, or where the plane is along the line, return the sample itself.
        """
        point, normal = self.points[j], self.normals[j]
        if not self.flat[j] or direction @ normal < _ALONG:
            return point
        return np.asarray(p + direction * (((point - p) @ normal) / (direction @ normal)))

    @staticmethod
    def _places(points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return points and scaled normals, shape (..., 6), whose distances rank samples."""
        return np.concatenate([points, _NORMAL_UNIT * normals], axis=-1)


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


def _flat(points: FloatArray, normals: FloatArray, radius: float = _FLAT_RADIUS) -> BoolArray:
    """Return which samples have only similar normals within a radius [m]."""
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")  # (P, 2)
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
        along = tilts @ np.column_stack([steepest, cross(normal, steepest)])  # (N, 2)
        uneven = np.abs(along.max(axis=0) + along.min(axis=0))
        risen = ((points[around] - point) @ normal).max()
        even[i] = (uneven <= np.sin(_FLAT_ANGLE)).all() and risen <= _BULGE
    return even


def _rises(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return which samples have surface above their tangent plane around them."""
    pairs = cKDTree(points).query_pairs(_FLAT_RADIUS, output_type="ndarray")  # (P, 2)
    pairs = np.vstack([pairs, pairs[:, ::-1]])
    first, second = pairs.T
    above = ((points[second] - points[first]) * normals[first]).sum(axis=1) > _BULGE
    risen = np.zeros(len(points), dtype=bool)
    risen[first[above]] = True
    return risen


def _near(places: FloatArray, points: FloatArray, radius: float = _FLAT_RADIUS) -> BoolArray:
    """Return which points are within a radius [m] of some place."""
    if not len(places):
        return np.zeros(len(points), dtype=bool)
    distances, _ = cKDTree(places).query(points, distance_upper_bound=radius)
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


def _on_edges(
    points: FloatArray, normals: FloatArray, *, rounded: bool
) -> tuple[FloatArray, FloatArray]:
    """Return contacts on points (P, 3) of edges between faces with the normals (P, 2, 3)."""
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    spread = golden * np.arange(1, len(points) + 1) % 1.0
    part = spread if rounded else np.full(len(points), 0.5)
    angles = angle_between(normals[:, 0], normals[:, 1])
    # Spherical linear interpolation: from the first normal to the second one.
    between = np.sin((1.0 - part) * angles)[:, None] * normals[:, 0]
    between += np.sin(part * angles)[:, None] * normals[:, 1]
    return points, unit(between)


def _supported(mesh: trimesh.Trimesh) -> BoolArray:
    """Return which faces touches support, by the mesh's uncertainty; all without it."""
    uncertainty = mesh.vertex_attributes.get("uncertainty")
    if uncertainty is None:
        return np.ones(len(mesh.faces), dtype=bool)
    of_face = np.asarray(uncertainty)[mesh.faces].mean(axis=1)  # (faces,)
    return np.asarray(of_face <= max(_UNSUPPORTED * np.median(of_face), _UNCERTAIN))
