"""Solid modelling: extrusions, revolutions, tubes, star-shaped and implicit solids.

Solids are manifolds of manifold3d, in metres: `a + b` is their union, `a - b` their difference,
`a ^ b` their intersection.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import igl
import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh
from scipy.interpolate import PchipInterpolator, make_interp_spline

from lis_grasp.shapes.builtin import circle
from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import FloatArray

Solid: TypeAlias = manifold3d.Manifold
"""A closed solid."""

SEGMENTS = 96
"""Sides of a full circle: its chords are within 0.03 mm of a circle of 5 cm."""

# Steps of Newton's method that move vertices of marching cubes to the zero set.
_NEWTON_STEPS = 3


def block(x: float, y: float, z: float) -> Solid:
    """Return a box of these sides, centred on the origin."""
    return Solid.cube((x, y, z), True)


def disk(radius: float, *, segments: int = SEGMENTS) -> manifold3d.CrossSection:
    """Return a circle of this radius about the origin, as a plane outline."""
    return manifold3d.CrossSection.circle(radius, segments)


def outline(corners: npt.ArrayLike) -> manifold3d.CrossSection:
    """Return a polygon (n, 2) as a plane outline; counterclockwise is its inside."""
    return manifold3d.CrossSection([np.asarray(corners, dtype=np.float64)])


def rounded(plane: manifold3d.CrossSection, radius: float) -> manifold3d.CrossSection:
    """Return an outline with its convex corners rounded by a radius, then its concave ones."""
    kind = manifold3d.JoinType.Round
    shrunk = plane.offset(-radius, kind, 2.0, SEGMENTS).offset(radius, kind, 2.0, SEGMENTS)
    return shrunk.offset(radius, kind, 2.0, SEGMENTS).offset(-radius, kind, 2.0, SEGMENTS)


def extrude(plane: manifold3d.CrossSection, height: float, *, top: float = 1.0) -> Solid:
    """Return the upright prism on an outline, from -height/2 to height/2, its top scaled."""
    solid = Solid.extrude(plane, height, 0, 0.0, (top, top))
    return solid.translate((0.0, 0.0, -0.5 * height))


def rod(radius: float, height: float, *, top: float | None = None) -> Solid:
    """Return an upright cylinder about the origin, or a cone with another radius at its top."""
    return Solid.cylinder(height, radius, -1.0 if top is None else top, SEGMENTS, True)


def ball(radius: float) -> Solid:
    """Return a ball about the origin."""
    return Solid.sphere(radius, SEGMENTS)


def revolve(profile: npt.ArrayLike) -> Solid:
    """Revolve a closed profile, rows (radius, z) counterclockwise, about the z axis."""
    return Solid.revolve(outline(profile), SEGMENTS)


def curve(knots: npt.ArrayLike, count: int) -> FloatArray:
    """Return `count` points of a smooth curve through knots (n, k), shape (count, k)."""
    points = np.asarray(knots, dtype=np.float64)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(steps)])
    spline = make_interp_spline(passed, points, k=min(3, len(points) - 1))
    return np.asarray(spline(np.linspace(0.0, passed[-1], count)))


def turned(knots: npt.ArrayLike) -> Solid:
    """Return the body of revolution whose radius passes through knots, rows (radius, z) upward.

    The radius is a monotone cubic of z between knots; the ends are flat.
    """
    radii, heights = np.asarray(knots, dtype=np.float64).T
    z = np.linspace(heights[0], heights[-1], 64)
    outer = np.column_stack([PchipInterpolator(heights, radii)(z), z])
    return revolve(np.concatenate([[[0.0, z[0]]], outer, [[0.0, z[-1]]]]))


def tube(
    path: npt.ArrayLike, radius: npt.ArrayLike, *, sides: int = 48, flatness: float = 1.0
) -> Solid:
    """Return the solid swept by a circle along an open path (n, 3), with flat ends.

    Frames are carried along the path without twist. `radius` is one number or one for each point
    of the path; with `flatness` below 1 the section is an ellipse, lower across the plane of bend.
    """
    points = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), len(points))
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    spread = np.linalg.svd(points - points.mean(axis=0))[2][-1]  # normal of the plane of bend
    section = circle(1.0, sides)
    rings = []
    for point, tangent, size in zip(points, tangents, radii, strict=True):
        up = spread - (spread @ tangent) * tangent
        up /= np.linalg.norm(up)
        side = np.cross(up, tangent)
        spread = up
        rings.append(point + size * (section[:, :1] * side + flatness * section[:, 1:] * up))
    return lofted(rings)


def lofted(rings: list[FloatArray]) -> Solid:
    """Return the solid between rings (n, 3), with its ends closed by fans about their centres."""
    count, sides = len(rings), len(rings[0])
    i = np.arange(sides)
    j = np.arange(count - 1)[:, None] * sides
    a, b, c, d = j + i, j + (i + 1) % sides, j + sides + (i + 1) % sides, j + sides + i
    faces = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    first, last = count * sides, count * sides + 1
    top = (count - 1) * sides
    faces.append(np.column_stack([np.full(sides, first), (i + 1) % sides, i]))
    faces.append(np.column_stack([np.full(sides, last), top + i, top + (i + 1) % sides]))
    centres = [rings[0].mean(axis=0), rings[-1].mean(axis=0)]
    mesh = trimesh.Trimesh(np.vstack([*rings, *centres]), np.concatenate(faces), process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return solid_of(mesh)


def star(radius: Callable[[FloatArray], FloatArray], *, segments: int = 120) -> Solid:
    """Return the solid with the surface r(d) d over unit directions d (n, 3), r (n,) [m]."""

    def moved(points: FloatArray) -> FloatArray:
        directions = points / np.linalg.norm(points, axis=1, keepdims=True)
        return np.asarray(directions * radius(directions)[:, None])

    return Solid.sphere(1.0, segments).warp_batch(moved)


def superquadric(axes: npt.ArrayLike, exponent: float) -> Callable[[FloatArray], FloatArray]:
    """Return the radius of ``sum |x / a|^p = 1`` as a function of the direction, for `star`."""
    sides = np.asarray(axes, dtype=np.float64)
    return lambda d: (np.abs(d / sides) ** exponent).sum(axis=1) ** (-1.0 / exponent)


def zero_set(
    field: Callable[[FloatArray], FloatArray], low: npt.ArrayLike, high: npt.ArrayLike, cell: float
) -> Solid:
    """Return the solid where a smooth field (n, 3) -> (n,) is negative, by marching cubes."""
    lowest, highest = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    counts = np.ceil((highest - lowest) / cell).astype(int) + 1
    z, y, x = np.meshgrid(*(np.arange(n) for n in counts[::-1]), indexing="ij")
    nodes = lowest + cell * np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    vertices, faces, _ = igl.marching_cubes(field(nodes), nodes, *(int(n) for n in counts), 0.0)
    step = 1e-3 * cell
    for _ in range(_NEWTON_STEPS):
        moves = step * np.eye(3)
        slopes = [(field(vertices + move) - field(vertices - move)) / (2 * step) for move in moves]
        gradient = np.column_stack(slopes)
        vertices = vertices - (field(vertices) / (gradient**2).sum(axis=1))[:, None] * gradient
    mesh = trimesh.Trimesh(vertices, faces, process=True)
    if mesh.volume < 0.0:
        mesh.invert()
    return solid_of(mesh).simplify(0.02 * cell)


def mesh_of(solid: Solid) -> trimesh.Trimesh:
    """Return the mesh of a solid, without slivers and with merged vertices."""
    found = solid.simplify(1e-6).to_mesh64()
    vertices, faces = np.array(found.vert_properties[:, :3]), np.array(found.tri_verts, np.int64)
    return trimesh.Trimesh(vertices, faces, process=False)
