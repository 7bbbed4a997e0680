"""Mesh simplification of flat parts, for faster hydroelastic contact."""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh

_TOLERANCE = 2e-5  # [m], far below the resolution of a trial


def merge_flat_faces(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh of the same solid with as few triangles as possible on flat parts.

    Edges are collapsed as long as the surface moves by less than 0.02 mm (manifold3d); a box of any
    tessellation comes back with 12 triangles. A mesh that is no manifold comes back as it is.
    """
    solid = manifold3d.Manifold(
        manifold3d.Mesh(
            vert_properties=np.asarray(mesh.vertices, dtype=np.float32),
            tri_verts=np.asarray(mesh.faces, dtype=np.uint32),
        )
    )
    if solid.status() != manifold3d.Error.NoError:
        return mesh
    simple = solid.simplify(_TOLERANCE).to_mesh()
    merged = trimesh.Trimesh(
        np.asarray(simple.vert_properties[:, :3], dtype=np.float64), simple.tri_verts, process=False
    )
    return merged if merged.is_watertight and merged.volume > 0.0 else mesh
