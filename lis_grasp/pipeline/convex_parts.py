"""Convex decomposition of an object's mesh, for simulators that collide convex bodies."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.exceptions import require_at_least

# Voxels of the search, and the volume that parts may add to the object [%].
_VOXELS, _ADDED_VOLUME = 200_000, 1.0


def convex_parts(mesh: trimesh.Trimesh, *, most: int = 32) -> tuple[trimesh.Trimesh, ...]:
    """Return convex meshes whose union approximates a watertight mesh [m].

    Volumetric hierarchical approximate convex decomposition (V-HACD; Mamou and Ghorbel 2009). A
    convex object is one part: its hull. The same mesh gives the same parts.

    Parameters
    ----------
    mesh
        Watertight, in metres.
    most
        Largest number of parts.

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
        resolution=_VOXELS,
        minimumVolumePercentErrorAllowed=_ADDED_VOLUME,
    )
    parts = [trimesh.convex.convex_hull(center + size * np.array(p["vertices"])) for p in found]
    return tuple(part for part in parts if part.volume > 0.0)
