"""The true object in a Drake plant: its exact triangle mesh, rigid hydroelastic, never its hull."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    GeometryId,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)

OBJECT_BODY = "object"


def add_object(
    plant: MultibodyPlant,
    mesh: trimesh.Trimesh,
    *,
    mass: float,
    friction: float,
    instance: ModelInstanceIndex,
) -> tuple[RigidBody, GeometryId]:
    """Add a body with the mesh's exact shape, of uniform density; its frame is the mesh's.

    Drake's point contact and distance queries replace a mesh by its convex hull; a rigid
    hydroelastic mesh against compliant primitives keeps its bores and corners. The body gets no
    joint here: weld it, lock it, or leave it free.

    Parameters
    ----------
    plant
        Registered as a source of geometry, not finalized.
    mesh
        Watertight, outward-oriented [m].
    mass
        [kg]
    friction
        Coulomb coefficient, static and dynamic.
    instance
        The model instance that the body joins.

    Returns
    -------
    tuple
        The body, and the identity of its collision geometry.
    """
    body = plant.AddRigidBody(OBJECT_BODY, instance, _uniform_inertia(mesh, mass))
    obj = mesh.export(file_type="obj", include_normals=False, include_texture=False)
    shape = Mesh(InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", OBJECT_BODY)))
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    AddRigidHydroelasticProperties(properties)
    geometry = plant.RegisterCollisionGeometry(
        body, RigidTransform(), shape, OBJECT_BODY, properties
    )
    return body, geometry


def _uniform_inertia(mesh: trimesh.Trimesh, mass: float) -> SpatialInertia:
    inertia = np.asarray(mesh.moment_inertia) * (mass / mesh.volume)  # about the centre of mass
    return SpatialInertia.MakeFromCentralInertia(
        mass, mesh.center_mass, _rotational_inertia(inertia)
    )


def _rotational_inertia(matrix: np.ndarray) -> RotationalInertia:
    return RotationalInertia(*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2])
