"""Closed meshes as solids: exact booleans, simplification and convex decomposition."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh

from lis_grasp.exceptions import require_at_least

_TOLERANCE = 2e-5  # [m], far below the resolution of a trial
_COARSEST = 2.5e-3  # [m]
_ADDED_VOLUME = 1.0  # by which convex parts may differ [%]


def solid_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Return a closed mesh as a solid of manifold3d, whose booleans are exact.

    A mesh that is no manifold gives a solid with another status than `manifold3d.Error.NoError`.
    """
    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            tri_verts=np.ascontiguousarray(mesh.faces, dtype=np.uint64),
        )
    )


def merge_flat_faces(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh of the same solid with as few triangles as possible on flat parts.

    Edges are collapsed as long as the surface moves by less than 0.02 mm (manifold3d); a box of any
    tessellation comes back with 12 triangles. A mesh that is no manifold comes back as it is.
    """
    return _simplified(mesh, _TOLERANCE)


def with_fewer_faces(mesh: trimesh.Trimesh, most: int) -> trimesh.Trimesh:
    """Return a mesh of nearly the same solid with at most so many triangles, if it is a manifold.

    The tolerance is that of `merge_flat_faces`, doubled until they are so few, up to 5 mm.
    """
    tolerance, simple = _TOLERANCE, merge_flat_faces(mesh)
    while len(simple.faces) > most and tolerance < _COARSEST:
        tolerance *= 2.0
        simple = _simplified(mesh, tolerance)
    return simple


def _simplified(mesh: trimesh.Trimesh, tolerance: float) -> trimesh.Trimesh:
    solid = manifold3d.Manifold(
        manifold3d.Mesh(
            vert_properties=np.asarray(mesh.vertices, dtype=np.float32),
            tri_verts=np.asarray(mesh.faces, dtype=np.uint32),
        )
    )
    if solid.status() != manifold3d.Error.NoError:
        return mesh
    simple = solid.simplify(tolerance).to_mesh()
    merged = trimesh.Trimesh(
        np.asarray(simple.vert_properties[:, :3], dtype=np.float64), simple.tri_verts, process=False
    )
    return merged if merged.is_watertight and merged.volume > 0.0 else mesh


def split_large_faces(mesh: trimesh.Trimesh, *, longest: float, widest: float) -> trimesh.Trimesh:
    """Return a mesh of the same surface whose large triangles are split.

    A triangle is large if its longest edge and its least altitude are longer than `longest` and
    `widest` [m]: slivers stay as they are. Parts of a large one have edges up to `longest`. Its
    neighbours keep their edges, so that the surface is closed but not the mesh's topology.
    """
    sides = np.roll(mesh.triangles, -1, axis=1) - mesh.triangles  # (F, 3, 3)
    length = np.linalg.norm(sides, axis=2).max(axis=1)
    large = (length > longest) & (2.0 * mesh.area_faces > widest * length)
    if not large.any():
        return mesh
    parts = trimesh.Trimesh(mesh.vertices, mesh.faces[large], process=False)
    rest = trimesh.Trimesh(mesh.vertices, mesh.faces[~large], process=False)
    joined: trimesh.Trimesh = trimesh.util.concatenate([rest, parts.subdivide_to_size(longest)])
    return joined


def convex_parts(
    mesh: trimesh.Trimesh, *, most: int = 32, voxels: int = 200_000
) -> tuple[trimesh.Trimesh, ...]:
    """Return convex meshes whose union approximates a watertight mesh [m].

    Uses volumetric hierarchical approximate convex decomposition (V-HACD; Mamou and Ghorbel 2009).
    A convex object is one part: its hull. The same mesh gives the same parts.

    Parameters
    ----------
    mesh
        Watertight, in metres.
    most
        Largest number of parts.
    voxels
        Number of voxels of the search: fewer are faster and coarser.

    Raises
    ------
    InvalidOptionError
        If `most` is below 1.
    """
    require_at_least(1, most=most)
    hull = mesh.convex_hull
    if most == 1 or hull.volume <= (1.0 + 0.01 * _ADDED_VOLUME) * mesh.volume:
        return (hull,)
    # The search has absolute tolerances: it gets the mesh at unit size.
    size, center = float(mesh.extents.max()), mesh.bounds.mean(axis=0)
    unit = trimesh.Trimesh((mesh.vertices - center) / size, mesh.faces, process=False)
    hulls = trimesh.decomposition.convex_decomposition(
        unit, maxConvexHulls=most, resolution=voxels, minimumVolumePercentErrorAllowed=_ADDED_VOLUME
    )
    parts = [trimesh.convex.convex_hull(center + size * np.array(p["vertices"])) for p in hulls]
    return tuple(part for part in parts if part.volume > 0.0)
