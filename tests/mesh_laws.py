"""Laws of closed manifold meshes."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def fans(mesh: trimesh.Trimesh) -> int:
    """Return the number of fans of triangles round vertices: one a vertex on a manifold."""
    corner = {}
    for face, triangle in enumerate(mesh.faces):
        for k in range(3):
            corner[face, int(triangle[k])] = 3 * face + k
    links = [
        (corner[first, int(vertex)], corner[second, int(vertex)])
        for (first, second), edge in zip(
            mesh.face_adjacency, mesh.face_adjacency_edges, strict=True
        )
        for vertex in edge
    ]
    row, column = np.array(links).T
    size = 3 * len(mesh.faces)
    count, _ = connected_components(coo_array((np.ones(len(row)), (row, column)), (size, size)))
    return int(count)


def require_closed(mesh: trimesh.Trimesh) -> None:
    assert mesh.is_watertight  # every edge has two triangles
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert np.isfinite(mesh.vertices).all()
    assert len(np.unique(mesh.faces)) == len(mesh.vertices)
