"""Bodies of a hand's links: primitive shapes, and convex hulls of mesh files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
import yourdfpy
from scipy.spatial import QhullError

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, LisGraspError, shown
from lis_grasp.geometry import apply_pose, make_pose
from lis_grasp.io.mesh_files import TO_Z_UP, read_mesh
from lis_grasp.robots.robot_model import GeometryKind, LinkGeometry, LinkVisual
from lis_grasp.typing import FloatArray

# Facets round a sphere or cylinder: the chord is within 1 % of the radius of the arc.
_CYLINDER_SECTIONS = 32
_SPHERE_SUBDIVISIONS = 3  # of an icosahedron
_SIZES: Mapping[GeometryKind, int] = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}
LARGEST = 1e3
"""Largest length or position in a hand [m or rad]; more is a mistake."""
_MOST_VERTICES = 200  # of a mesh's convex hull
_LEAST_HEIGHT = 2e-5  # of a triangle of a hull [m]
_FORMATS = (".obj", ".stl", ".dae", ".ply", ".gltf", ".glb", ".off", ".3mf")
_SMALLEST = 1e-6  # size of a body [m]


class Capsule(yourdfpy.Cylinder):
    """A cylinder with round ends, which SDF has and URDF lacks."""


class GivenMesh(yourdfpy.Mesh):
    """A mesh in memory [m], instead of a file."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        super().__init__(filename="")
        self.mesh = mesh


def shape_and_sizes(geometry: Any) -> tuple[GeometryKind | None, list[float]]:
    """Return the kind and sizes of a simple shape; None for no shape."""
    if geometry is None:
        return None, []
    if geometry.box is not None:
        return "box", np.ravel(geometry.box.size).tolist()
    if geometry.sphere is not None:
        return "sphere", [geometry.sphere.radius]
    if (cylinder := geometry.cylinder) is not None:
        kind: GeometryKind = "capsule" if isinstance(cylinder, Capsule) else "cylinder"
        # A capsule without a straight part is a sphere.
        if kind == "capsule" and not cylinder.length:
            return "sphere", [cylinder.radius]
        return kind, [cylinder.radius, cylinder.length]
    return None, []


def primitive(
    link: str, X_LG: FloatArray, kind: GeometryKind, dimensions: npt.ArrayLike
) -> LinkGeometry:
    """Return a body of a simple shape with its mesh; dimensions as in `LinkGeometry`."""
    sizes = tuple(float(size) for size in np.asarray(dimensions, np.float64).ravel())
    if len(sizes) != _SIZES[kind] or not all(_SMALLEST <= size <= LARGEST for size in sizes):
        raise InvalidHandError(
            f"a {kind} of link '{link}' must have {_SIZES[kind]} sizes of {_SMALLEST:g} to"
            f" {LARGEST:g} m; it has {', '.join(map(str, sizes)) or 'none'}"
        )
    match kind:
        case "box":
            mesh = trimesh.creation.box(extents=sizes)
        case "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=_SPHERE_SUBDIVISIONS, radius=sizes[0])
        case "cylinder":
            mesh = trimesh.creation.cylinder(
                radius=sizes[0], height=sizes[1], sections=_CYLINDER_SECTIONS
            )
        case _:
            mesh = trimesh.creation.capsule(radius=sizes[0], height=sizes[1])
    return LinkGeometry(link, X_LG, kind, sizes, mesh)


def load_link_mesh(file: Path, scale: npt.ArrayLike | None) -> trimesh.Trimesh:
    """Read the mesh of a link's body, and scale it by one factor or by one for each axis."""
    factors = None if scale is None else np.atleast_1d(np.asarray(scale, np.float64))
    if factors is not None and (
        factors.shape not in ((1,), (3,)) or not (np.isfinite(factors) & (factors != 0.0)).all()
    ):
        raise InvalidHandError(
            f"the scale of {file} must be 1 or 3 finite numbers other than 0; it is"
            f" {shown(factors.tolist())}"
        )
    read = read_mesh(file, _FORMATS, merge=True, materials=True)
    loaded = read.mesh
    if len(loaded.faces) == 0:
        raise InvalidFileError(f"the mesh {file} has no triangles", path=file)
    if file.suffix.lower() in (".gltf", ".glb"):
        # As Drake and RViz do; the axis that COLLADA states they ignore.
        loaded.apply_transform(make_pose(TO_Z_UP["y"], np.zeros(3)))
    if read.metres not in (None, 1.0):
        loaded.apply_scale(read.metres)
    if factors is not None:
        with np.errstate(all="ignore"):
            loaded.apply_scale(factors if len(factors) == 3 else float(factors[0]))
    if not (np.abs(loaded.vertices) <= LARGEST).all():
        raise InvalidHandError(f"the mesh {file} must be within {LARGEST:g} m of its origin")
    return loaded


def points_of_bodies(bodies: Sequence[LinkGeometry], link: str) -> FloatArray:
    """Return all vertices of the bodies of a link, shape (N, 3) [m], in the link frame."""
    own = [apply_pose(b.X_LG, np.asarray(b.mesh.vertices)) for b in bodies if b.link == link]
    return np.vstack([np.empty((0, 3)), *own])


def convex_body(link: str, X_LG: FloatArray, mesh: trimesh.Trimesh) -> LinkGeometry | None:
    """Return the convex hull of a mesh as a body; None if the mesh is flat and has no hull.

    A hull of many vertices is replaced by that of its outermost points along 200 directions. On a
    round part of radius R this is at most 0.01 R smaller, and much faster to check and to simulate.
    """
    try:
        hull = mesh.convex_hull
        if len(hull.vertices) > _MOST_VERTICES:
            far = np.argmax(hull.vertices @ fibonacci_directions(_MOST_VERTICES).T, axis=0)
            hull = trimesh.convex.convex_hull(hull.vertices[np.unique(far)])
        hull = _without_slivers(hull)
    except QhullError:
        return None
    return LinkGeometry(link, X_LG, "mesh", (), hull) if hull.volume > 0.0 else None


def _without_slivers(hull: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a hull without triangles lower than 20 um, of which Drake finds no plane.

    Removes one vertex of a short edge, else the middle one of three that are about on a line.
    """
    while len(hull.vertices) > 4:
        triangles = hull.triangles
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # (F, 3)
        heights = 2.0 * hull.area_faces / sides.max(axis=1)
        low = np.flatnonzero(heights < _LEAST_HEIGHT)
        if not len(low):
            break
        # Side k is from corner k to the next: opposite of the longest is the middle corner.
        middle = (sides[low].argmax(axis=1) + 2) % 3
        dropped = np.zeros(len(hull.vertices), dtype=bool)
        for corner, face in zip(middle, hull.faces[low], strict=True):
            if not dropped[face].any():
                dropped[face[corner]] = True
        hull = trimesh.convex.convex_hull(hull.vertices[~dropped])
    return hull


def fibonacci_directions(count: int) -> FloatArray:
    """Return unit vectors (N, 3) on a spherical Fibonacci lattice (Gonzalez, 2010)."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), height])


def mesh_of(visual: LinkVisual) -> trimesh.Trimesh:
    """Return the mesh of a link's visual in its frame G [m]; for errors see `load_link_mesh`."""
    shape = visual.shape
    return shape if isinstance(shape, trimesh.Trimesh) else load_link_mesh(shape, visual.scale)


def load_visual(visual: LinkVisual) -> trimesh.Trimesh | None:
    """Return the mesh of a link's visual in its frame G [m]; None if its file cannot be read."""
    try:
        return mesh_of(visual)
    except LisGraspError:
        return None


def balls_inside(geometry: LinkGeometry) -> tuple[FloatArray, FloatArray]:
    """Return centres (S, 3) in G and radii (S,) of balls inside a body; none for a shell."""
    match geometry.kind:
        case "sphere":
            return np.zeros((1, 3)), np.array(geometry.dimensions)
        case "capsule" | "cylinder":
            radius, length = geometry.dimensions
            if geometry.kind == "cylinder":
                radius = min(radius, length / 2.0)
                length -= 2.0 * radius
            half = np.array([0.0, 0.0, length / 2.0])
        case "box":
            radius = min(geometry.dimensions) / 2.0
            half = np.array(geometry.dimensions) / 2.0 - radius
        case "mesh":
            return _ball_in_mesh(geometry.mesh)
    # Balls one radius apart: neighbours overlap.
    counts = np.ceil(2.0 * half / radius).astype(int) + 1
    axes = (np.linspace(-h, h, n) * (n > 1) for h, n in zip(half, counts, strict=True))
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return centers, np.full(len(centers), radius)


def _ball_in_mesh(mesh: trimesh.Trimesh) -> tuple[FloatArray, FloatArray]:
    """Return the largest ball about the centre of mass of a convex mesh."""
    center = np.asarray(mesh.center_mass)
    heights = ((mesh.triangles[:, 0] - center) * mesh.face_normals).sum(axis=1)
    if not len(heights) or heights.min() <= 0.0:  # an open or concave mesh, perhaps not inside
        return np.zeros((0, 3)), np.zeros(0)
    return center[None], np.array([heights.min()])
