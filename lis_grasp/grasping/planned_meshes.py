"""Check of meshes on which grasps are planned."""

from __future__ import annotations

import trimesh

from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.shapes.shape import require_mesh


def require_closed(mesh: trimesh.Trimesh) -> None:
    """Raise `InvalidMeshError` unless grasps can be planned on a mesh: it is closed, in metres."""
    if not require_mesh("the mesh", mesh).is_watertight:
        raise InvalidMeshError(
            "grasps are planned on closed meshes; this one has open edges: repair it with"
            " Shape.from_mesh or shapes.load, or mesh an estimate with extract_mesh"
        )
