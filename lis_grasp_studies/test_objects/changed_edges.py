"""Solids with rounded convex edges, and with faces that continue beyond their convex edges."""

from __future__ import annotations

from collections import defaultdict

import manifold3d
import numpy as np
import trimesh

from lis_grasp.geometry import cross
from lis_grasp.shapes.shape import SHARP_ANGLE
from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import FloatArray, IntArray
from lis_grasp_studies.test_objects.solid_modelling import Solid, mesh_of

ROUND_SEGMENTS = 24
"""Sides of a circle of the ball that rounds edges, and of a plate round a corner. The ball is an
inscribed polytope, symmetric about its centre, so that flat faces stay where they are."""

PLATE = 2e-3
"""Depth of the plates that continue faces [m]."""

_LEAST_VOLUME = 0.85  # of a solid that is rounded, and not too thin for it
_SIMPLIFIED = 2e-5  # by which a surface may move for fewer triangles [m]
_INSET = 5e-4  # by which a plate begins before the edge [m]


def round_edges(mesh: trimesh.Trimesh, radius: float) -> trimesh.Trimesh | None:
    """Return a solid with its convex edges rounded by a ball: its opening.

    The opening is the union of all balls of this radius inside the solid: erosion, then dilation,
    by Minkowski sums (manifold3d). Concave edges and what a ball touches of flat faces stay. None
    where the solid is too thin: the erosion is empty or in several pieces, or the opening has lost
    15 % of the volume.

    Parameters
    ----------
    mesh
        Watertight, outward [m].
    radius
        Of the ball [m].

    Source: Serra, Image Analysis and Mathematical Morphology, 1982.
    """
    ball = Solid.sphere(radius, ROUND_SEGMENTS)
    eroded = solid_of(mesh).minkowski_difference(ball).simplify(_SIMPLIFIED)
    if len(eroded.decompose()) != 1:
        return None
    rounded = mesh_of(eroded.minkowski_sum(ball).simplify(_SIMPLIFIED))
    return rounded if rounded.volume > _LEAST_VOLUME * mesh.volume else None


def continue_faces(
    mesh: trimesh.Trimesh, reach: float, *, lowest: float | None = None
) -> trimesh.Trimesh:
    """Return a solid whose faces continue beyond their sharp convex edges as plates.

    A plate is in the plane of its face, `PLATE` deep, and has the points within `reach` of the
    edge, round the corners of the face too.

    Parameters
    ----------
    mesh
        Watertight, outward [m].
    reach
        Beyond the edges [m].
    lowest
        Height below which nothing is added, such as that of a table [m].
    """
    ends: dict[tuple[int, int], list[tuple[bool, FloatArray, FloatArray]]] = defaultdict(list)
    faces, parts = _smooth_faces(mesh), [solid_of(mesh)]
    sharp = (mesh.face_adjacency_angles > SHARP_ANGLE) & mesh.face_adjacency_convex
    for pair, edge in zip(
        mesh.face_adjacency[sharp], mesh.face_adjacency_edges[sharp], strict=True
    ):
        for face in pair:
            normal = mesh.face_normals[face]
            start, end = _along(mesh.faces[face], edge)
            along = mesh.vertices[end] - mesh.vertices[start]
            beyond = cross(along, normal) / np.linalg.norm(along)
            outline = [
                mesh.vertices[place] + by * beyond
                for place in (start, end)
                for by in (-_INSET, reach)
            ]
            parts.append(_plate(np.array(outline), normal))
            ends[faces[face], end].append((True, beyond, normal))
            ends[faces[face], start].append((False, beyond, normal))
    for (_, corner), met in ends.items():
        for arrives, before, normal in met:
            for continues, after, other in met:
                # The plates of the two edges part at the corner, if the face is convex there.
                if arrives > continues and cross(before, after) @ (normal + other) > 0.0:
                    fan = mesh.vertices[corner] + reach * _arc(before, after)
                    inside = fan[[0, -1]] + _INSET * np.array(
                        [-cross(normal, before), cross(other, after)]
                    )
                    around = np.vstack([mesh.vertices[corner], fan, inside])
                    parts.append(_plate(around, normal, other))
    solid = Solid.batch_boolean(parts, manifold3d.OpType.Add)
    if lowest is not None:
        solid = solid.trim_by_plane((0.0, 0.0, 1.0), lowest)
    # Without slivers, and without hollows that plates enclose.
    pieces = mesh_of(solid.simplify(_SIMPLIFIED)).split(only_watertight=False)
    return max(pieces, key=lambda piece: float(piece.extents.max()))


def _smooth_faces(mesh: trimesh.Trimesh) -> IntArray:
    """Return the smooth face of each triangle, (F,): triangles without sharp edges between them."""
    smooth = mesh.face_adjacency[mesh.face_adjacency_angles <= SHARP_ANGLE]
    labels = trimesh.graph.connected_component_labels(smooth, node_count=len(mesh.faces))
    return np.asarray(labels, dtype=np.int64)


def _along(triangle: IntArray, edge: IntArray) -> tuple[int, int]:
    """Return the ends of an edge of a triangle, in the order of the triangle's corners."""
    first, second = (int(end) for end in edge)
    place = triangle.tolist().index(first)
    return (first, second) if triangle[(place + 1) % 3] == second else (second, first)


def _plate(outline: FloatArray, *normals: FloatArray) -> Solid:
    """Return the plate below an outline (P, 3), as deep as `PLATE` along each normal (3,)."""
    return Solid.hull_points(np.vstack([outline, *(outline - PLATE * n for n in normals)]))


def _arc(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return directions (A, 3) from one to another, in equal steps like those of a circle."""
    angle = float(np.arctan2(np.linalg.norm(cross(start, end)), start @ end))
    steps = int(np.ceil(angle * ROUND_SEGMENTS / (2.0 * np.pi) - 1e-9))
    parts = np.linspace(0.0, 1.0, steps + 1)[:, None]
    both = np.sin((1.0 - parts) * angle) * start + np.sin(parts * angle) * end
    return np.asarray(both / np.sin(angle))
