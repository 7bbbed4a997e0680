"""Object and table in a Drake plant: an exact rigid mesh, never its hull, on a compliant box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, RotationalInertia, SpatialInertia
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.shapes.object_mass import USUAL_FRICTION, require_load, uniform_inertia
from lis_grasp.typing import FloatArray

_TABLE_SIZE = 1.5  # [m]
_TABLE_THICKNESS = 0.1  # [m]
_TABLE_MARGIN = 0.3  # [m] of table beyond the object
# A ball of 10 cm and 0.5 kg sinks in by 0.2 mm: F = pi E R d^2 / (half the thickness).
_TABLE_MODULUS = 5e7  # [Pa], at most
# A flat face on the table is a spring of stiffness k. From k (time step)^2 of about 40 masses on,
# light plates bounce by themselves, at times by centimetres; this is half of it.
_STIFFNESS_LIMIT = 20.0
# The same of bodies that are pushed: at 10 a roof that is tilted by 0.01 degrees bounces along.
_GROUND_LIMIT = 5.0
_FOOT = 0.03  # [rad] of tilt, within which a body stands on a face
_ON_TABLE = 5e-4  # [m] above an object's lowest point, as good as on the table
TABLE_DISSIPATION = 20.0  # [s/m], a thud, not a bounce


@dataclass(frozen=True, slots=True)
class FreeObject:
    """An object that is free to move on a table.

    Parameters
    ----------
    support_height
        Height of the table in O [m].
    mass
        [kg], of uniform density.
    friction
        Coulomb coefficient, of object on table and of hand on object.

    Raises
    ------
    InvalidOptionError
        If mass or friction is out of range.
    """

    support_height: float
    mass: float = 0.2
    friction: float = 0.5

    def __post_init__(self) -> None:
        require_load(mass=self.mass, friction=self.friction)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectInPlant:
    """An object that `add_object_body` has added to a plant."""

    body: RigidBody
    geometry: GeometryId


def add_object_body(
    plant: MultibodyPlant,
    mesh: trimesh.Trimesh,
    *,
    mass: float,
    friction: float = USUAL_FRICTION,
    name: str = "object",
) -> ObjectInPlant:
    """Add a model instance: one body of uniform density with the exact shape of a watertight mesh.

    Drake's point contact and distance queries replace a mesh by its convex hull; a rigid
    hydroelastic mesh against compliant primitives keeps its bores and corners. The body's frame is
    the mesh's [m]; without a joint it floats. Mass is in [kg]; `friction` is Coulomb's coefficient,
    static and dynamic. The plant is not finalized yet.
    """
    instance = plant.AddModelInstance(name)
    inertia = spatial_inertia(mass, mesh.center_mass, uniform_inertia(mesh, mass))
    body = plant.AddRigidBody(name, instance, inertia)
    shape = Mesh(in_memory(mesh, name))
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(friction, friction), properties=properties)
    AddRigidHydroelasticProperties(properties)
    geometry = plant.RegisterCollisionGeometry(body, RigidTransform(), shape, name, properties)
    return ObjectInPlant(body, geometry)


def in_memory(mesh: trimesh.Trimesh, name: str) -> InMemoryMesh:
    """Return a mesh as Drake's, without colours."""
    obj = mesh.export(file_type="obj", include_normals=False, include_texture=False)
    return InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", name))


def spatial_inertia(mass: float, center: FloatArray, matrix: FloatArray) -> SpatialInertia:
    """Return the inertia of a mass [kg] at a centre (3,) [m], given about it, (3, 3) [kg m^2]."""
    inertia = RotationalInertia(*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2])
    return SpatialInertia.MakeFromCentralInertia(mass, center, inertia)


def add_table(
    plant: MultibodyPlant,
    support_height: float,
    friction: float = USUAL_FRICTION,
    *,
    under: trimesh.Trimesh,
) -> GeometryId:
    """Add a compliant table with its top at the support height in W [m], and return its geometry.

    It is 1.5 m wide about W's origin, or wider to be under the mesh, given in W. It is a box:
    Drake 1.51 fails on a compliant half space against a rigid mesh.
    """
    return _add_slab(plant, support_height, friction, under, "table", _TABLE_MODULUS)


def add_support(
    plant: MultibodyPlant,
    support_height: float,
    friction: float,
    *,
    under: trimesh.Trimesh,
    mass: float,
) -> GeometryId:
    """Add the table that supports a free object of a mass [kg], and return its geometry.

    Contact with a table of any stiffness is not stable: a flat object that is light for its face
    would bounce by itself. This one is as soft as the plant's time step asks for: such an object
    sinks in by 12 um at steps of 5 ms. For the hand there is another table; see `let_rest`.
    """
    heights = under.vertices[:, 2]
    foot = under.vertices[heights < heights.min() + _ON_TABLE, :2]
    modulus = _stable_modulus(_area(foot), mass, plant.time_step(), limit=_STIFFNESS_LIMIT)
    return _add_slab(plant, support_height, friction, under, "support", modulus)


def add_ground(
    plant: MultibodyPlant,
    height: float,
    friction: float,
    *,
    under: trimesh.Trimesh,
    mass: float,
    name: str,
) -> GeometryId:
    """Add the ground of a free body beside the object, and return its geometry.

    It is softer than the object's support: the body may be pushed, and comes to rest on it from
    any motion. A tilted body stands on all that is nearly as low as its lowest point.
    """
    heights = under.vertices[:, 2]
    width = float(np.ptp(under.vertices[:, :2], axis=0).max())
    foot = under.vertices[heights < heights.min() + _FOOT * width, :2]
    modulus = _stable_modulus(_area(foot), mass, plant.time_step(), limit=_GROUND_LIMIT)
    return _add_slab(plant, height, friction, under, name, modulus)


def let_rest(
    scene_graph: SceneGraph,
    obj: GeometryId,
    *,
    support: GeometryId | None,
    table: GeometryId | None,
) -> None:
    """Make the object's geometry rest on its support, and all others on the table.

    An object that does not move has no support: Drake 1.51 crashes on contact between a locked body
    and the world.
    """
    declaration = CollisionFilterDeclaration()
    if support is not None:
        all_others = [
            geometry
            for geometry in scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
            if geometry not in (obj, support)
        ]
        declaration.ExcludeBetween(GeometrySet(support), GeometrySet(all_others))
    if table is not None:
        declaration.ExcludeBetween(GeometrySet(obj), GeometrySet(table))
    scene_graph.collision_filter_manager().Apply(declaration)


def _area(points: FloatArray) -> float:
    """Return the area of the convex hull of points (P, 2) [m^2]; 0 of a point or a line."""
    try:
        return float(ConvexHull(points).volume)  # what Qhull calls the area is the border's length
    except QhullError:
        return 0.0


def _stable_modulus(area: float, mass: float, time_step: float, *, limit: float) -> float:
    """Return the largest modulus [Pa] of a table on which an object rests stably on an area."""
    if area == 0.0 or time_step == 0.0:  # continuous plants are stable on any
        return _TABLE_MODULUS
    gradient = limit * mass / (area * time_step**2)  # of the pressure [Pa/m]
    return min(0.5 * _TABLE_THICKNESS * gradient, _TABLE_MODULUS)


def _add_slab(
    plant: MultibodyPlant,
    support_height: float,
    friction: float,
    under: trimesh.Trimesh,
    name: str,
    modulus: float,
) -> GeometryId:
    size = max(_TABLE_SIZE, 2.0 * (float(np.abs(under.bounds[:, :2]).max()) + _TABLE_MARGIN))
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=TABLE_DISSIPATION,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    AddCompliantHydroelasticProperties(
        resolution_hint=0.1, hydroelastic_modulus=modulus, properties=properties
    )
    X_WT = RigidTransform([0.0, 0.0, support_height - 0.5 * _TABLE_THICKNESS])
    return plant.RegisterCollisionGeometry(
        plant.world_body(), X_WT, Box(size, size, _TABLE_THICKNESS), name, properties
    )
