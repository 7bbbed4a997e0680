"""Bodies that a mesh touches (python-fcl)."""

from __future__ import annotations

import fcl
import numpy as np
import trimesh
from trimesh.collision import mesh_to_BVH

from lis_grasp.shapes.mesh_distance import any_inside
from lis_grasp.world.surroundings import Body, Surroundings


def bodies_touching(surroundings: Surroundings, mesh: trimesh.Trimesh) -> list[str]:
    """Return the names of the bodies that touch a closed mesh in E [m], or contain or are in it.

    Examples
    --------
    >>> wall = Body.box("wall", (0.02, 0.4, 0.2), (0.15, 0.0, 0.1))
    >>> bodies_touching(Surroundings((wall,)), trimesh.creation.box((0.3, 0.1, 0.1)))
    ['wall']
    """
    return [body.name for body in surroundings if _touches(body, mesh)]


def _touches(body: Body, mesh: trimesh.Trimesh) -> bool:
    low, high = mesh.bounds
    if (body.mesh.bounds[0] > high).any() or (body.mesh.bounds[1] < low).any():
        return False
    shells = (fcl.CollisionObject(mesh_to_BVH(each)) for each in (body.mesh, mesh))
    if fcl.collide(*shells, fcl.CollisionRequest(), fcl.CollisionResult()):
        return True
    # Shells that do not meet: one is wholly inside of the other, or they are apart.
    if any_inside(
        mesh, np.array([part.vertices[0] for part in body.mesh.split(only_watertight=False)])
    ):
        return True
    return bool(body.distances(mesh.vertices[:1])[0] < 0.0)
