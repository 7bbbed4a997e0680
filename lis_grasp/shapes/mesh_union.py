"""Boolean union of solids."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from trimesh.collision import mesh_to_BVH

from lis_grasp.exceptions import InvalidMeshError

# Crossings a face: up to five where solids meet or coincide. With more than this, solids are torn
# and their union may take minutes; the second number of crossings is always permitted.
_MOST_CROSSINGS = 10
_FEW_CROSSINGS = 1000


def unite(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return the union of solids, pair by pair.

    They are moved to the origin first, because Manifold computes in single precision. Raises
    `InvalidMeshError` if their faces cross each other nearly everywhere.
    """
    middle = np.mean([part.bounds.mean(axis=0) for part in parts], axis=0)
    parts = [part.copy().apply_translation(-middle) for part in parts]
    most = _FEW_CROSSINGS + _MOST_CROSSINGS * sum(len(part.faces) for part in parts)
    while len(parts) > 1:
        pairs = [parts[i : i + 2] for i in range(0, len(parts), 2)]
        left = most
        for pair in pairs:
            left -= _crossings(pair[0], pair[-1], left + 1) if len(pair) == 2 else 0
            if left < 0:
                raise InvalidMeshError(
                    "has parts that cross each other everywhere, as a torn mesh does: repair it by"
                    " hand, for example with MeshLab or Blender"
                )
        parts = [
            trimesh.boolean.union(pair, engine="manifold", check_volume=False) for pair in pairs
        ]
    return parts[0].apply_translation(middle)


def _crossings(a: trimesh.Trimesh, b: trimesh.Trimesh, most: int) -> int:
    """Count the pairs of faces of two meshes that meet, at most `most`."""
    if not (len(a.faces) and len(b.faces)):  # Manifold drops tiny parts; FCL would crash on them
        return 0
    request = fcl.CollisionRequest(num_max_contacts=most, enable_contact=False)
    objects = [fcl.CollisionObject(mesh_to_BVH(mesh)) for mesh in (a, b)]
    return int(fcl.collide(*objects, request, fcl.CollisionResult()))
