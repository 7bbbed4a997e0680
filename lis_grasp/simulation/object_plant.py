"""Object and table in a Drake plant: an exact rigid mesh, never its hull, on a compliant box."""

from __future__ import annotations

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
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

from lis_grasp.typing import FloatArray

_OBJECT = "object"
_TABLE_SIZE, _TABLE_THICKNESS = 1.5, 0.1  # [m]
_TABLE_MARGIN = 0.3  # [m] of table beyond the object
# A ball of 10 cm and 0.5 kg sinks in by 0.2 mm: F = pi E R d^2 / (half the thickness).
_TABLE_MODULUS = 5e7  # [Pa]
_TABLE_DISSIPATION = 20.0  # [s/m], a thud, not a bounce


def add_object(
    plant: MultibodyPlant,
    mesh: trimesh.Trimesh,
    *,
    mass: float,
    friction: float,
    instance: ModelInstanceIndex,
) -> tuple[RigidBody, GeometryId]:
    """Add a body of uniform density with the exact shape of a watertight mesh.

    Drake's point contact and distance queries replace a mesh by its convex hull; a rigid
    hydroelastic mesh against compliant primitives keeps its bores and corners. The body's frame is
    the mesh's [m]; it gets no joint here. Mass is in [kg]; `friction` is Coulomb's coefficient,
    static and dynamic. Returns the body and its collision geometry.
    """
    body = plant.AddRigidBody(_OBJECT, instance, _uniform_inertia(mesh, mass))
    obj = mesh.export(file_type="obj", include_normals=False, include_texture=False)
    shape = Mesh(InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", _OBJECT)))
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    AddRigidHydroelasticProperties(properties)
    geometry = plant.RegisterCollisionGeometry(body, RigidTransform(), shape, _OBJECT, properties)
    return body, geometry


def spatial_inertia(mass: float, center: FloatArray, matrix: FloatArray) -> SpatialInertia:
    """Return the inertia of a mass [kg] at a centre (3,) [m], given about it, (3, 3) [kg m^2]."""
    inertia = RotationalInertia(*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2])
    return SpatialInertia.MakeFromCentralInertia(mass, center, inertia)


def _uniform_inertia(mesh: trimesh.Trimesh, mass: float) -> SpatialInertia:
    matrix = np.asarray(mesh.moment_inertia) * (mass / mesh.volume)  # about the centre of mass
    return spatial_inertia(mass, mesh.center_mass, matrix)


def add_table(
    plant: MultibodyPlant, height: float, friction: float, *, under: trimesh.Trimesh
) -> GeometryId:
    """Add a compliant table with its top at a height in W [m], and return its geometry.

    It is 1.5 m wide about W's origin, or wider to be under the mesh, given in W. It is a box:
    Drake 1.51 fails on a compliant half space against a rigid mesh.
    """
    size = max(_TABLE_SIZE, 2.0 * (float(np.abs(under.bounds[:, :2]).max()) + _TABLE_MARGIN))
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=_TABLE_DISSIPATION,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    AddCompliantHydroelasticProperties(
        resolution_hint=0.1, hydroelastic_modulus=_TABLE_MODULUS, properties=properties
    )
    X_WT = RigidTransform([0.0, 0.0, height - 0.5 * _TABLE_THICKNESS])
    return plant.RegisterCollisionGeometry(
        plant.world_body(), X_WT, Box(size, size, _TABLE_THICKNESS), "table", properties
    )
