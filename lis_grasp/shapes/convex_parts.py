"""Convex decomposition of a mesh, for collisions of convex bodies."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.exceptions import require_at_least

_ADDED_VOLUME = 1.0  # by which parts may differ [%]


def convex_parts(
    mesh: trimesh.Trimesh, *, most: int = 32, voxels: int = 200_000
) -> tuple[trimesh.Trimesh, ...]:
    """Return convex meshes whose union approximates a watertight mesh [m].

    Volumetric hierarchical approximate convex decomposition (V-HACD; Mamou and Ghorbel 2009). A
    convex object is one part: its hull. The same mesh gives the same parts.

    Parameters
    ----------
    mesh
        Watertight, in metres.
    most
        Largest number of parts.
    voxels
        Of the search: fewer are faster and coarser.

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
    found = trimesh.decomposition.convex_decomposition(
        unit,
        maxConvexHulls=most,
        resolution=voxels,
        minimumVolumePercentErrorAllowed=_ADDED_VOLUME,
    )
    parts = [trimesh.convex.convex_hull(center + size * np.array(p["vertices"])) for p in found]
    return tuple(part for part in parts if part.volume > 0.0)
