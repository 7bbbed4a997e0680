"""Bodies beside the object in a Drake plant: fixed or free, with the forces on them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    CollisionFilterDeclaration,
    CollisionFilterManager,
    Convex,
    GeometryId,
    GeometrySet,
    Mesh,
    ProximityProperties,
    QueryObject,
    Role,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody
from pydrake.systems.framework import Context

from lis_grasp.robots.robot_model import LinkGeometry
from lis_grasp.simulation.drake.contact_patches import patch_forces, point_forces
from lis_grasp.simulation.drake.link_plant import primitive_shape
from lis_grasp.simulation.drake.object_plant import (
    TABLE_DISSIPATION,
    add_ground,
    in_memory,
    spatial_inertia,
)
from lis_grasp.simulation.drake.plant_parts import rigid
from lis_grasp.typing import FloatArray
from lis_grasp.world import Body, Surroundings

Pusher = Literal["hand", "arm", "object"]
"""Who pushes a body."""

_MODULUS = 5e6  # [Pa], of bodies beside the object
_FACETS = 0.2  # length of a round body's facets, in its radii: they are within 0.5 % of the arc
_SUNK = 1e-6  # [m] into the ground at the start, so that the first step finds contact
_TOGETHER = 1e-3  # bodies that are no farther apart at the start [m] stand on or lean on each other


@dataclass(frozen=True, slots=True, eq=False)
class SurroundingsInPlant:
    """Bodies beside the object that `add_surroundings` has added to a plant; W is its world."""

    surroundings: Surroundings  # with poses in W at the start
    plant: MultibodyPlant
    bodies: Mapping[str, RigidBody]
    name_of_geometry: Mapping[GeometryId, str]
    rigid: frozenset[GeometryId]  # meshes, which meet other meshes by their convex hulls
    grounds: Mapping[str, GeometryId]  # of free bodies

    @property
    def unmoving_geometries(self) -> list[GeometryId]:
        """Shapes of fixed bodies, and grounds."""
        fixed = [g for g, name in self.name_of_geometry.items() if name not in self.grounds]
        return [*fixed, *self.grounds.values()]

    def geometries(self, names: Collection[str]) -> list[GeometryId]:
        """Return the shapes of bodies by name."""
        return [g for g, name in self.name_of_geometry.items() if name in names]

    def touched(self, results: ContactResults) -> set[str]:
        """Return the names of the bodies that are in contact with anything."""
        pairs = chain(patch_forces(results), point_forces(results))
        found = {self.name_of_geometry.get(g) for pair in pairs for g in pair[:2]}
        return {name for name in found if name is not None}

    def joint(self, name: str) -> Joint:
        """Return the joint of a free body: Drake gives one without any six degrees of freedom."""
        (joint,) = self.plant.GetJointIndices(self.bodies[name].model_instance())
        return self.plant.get_joint(joint)

    def poses(self, context: Context) -> dict[str, FloatArray]:
        """Return the poses X_WB (4, 4) of the free bodies now."""
        return {
            name: np.asarray(self.bodies[name].EvalPoseInWorld(context).GetAsMatrix4())
            for name in self.grounds
        }

    def place(self, context: Context, poses: Mapping[str, FloatArray]) -> None:
        """Place the free ones of bodies at poses X_WB (4, 4) by name; their velocities stay."""
        for name in self.grounds.keys() & poses.keys():
            self.joint(name).SetPose(context, rigid(poses[name]))

    def forces(
        self, results: ContactResults, pushers: Mapping[GeometryId, Pusher]
    ) -> dict[tuple[str, Pusher], float]:
        """Return the forces [N] of a step on each body by who pushes it, if any does.

        They are sums over contacts of the sizes of their forces.
        """
        sums: dict[tuple[str, Pusher], float] = {}
        for first, second, force in chain(patch_forces(results), point_forces(results)):
            for own, other in ((first, second), (second, first)):
                name, who = self.name_of_geometry.get(own), pushers.get(other)
                if name is not None and who is not None:
                    sums[name, who] = sums.get((name, who), 0.0) + force
        return sums

    def let_rest(self, scene_graph: SceneGraph, not_under: Collection[GeometryId]) -> None:
        """Make free bodies rest on their own grounds alone, which carry nothing else.

        Tables of others are `not_under` any body.
        """
        declaration = CollisionFilterDeclaration()
        own = list(self.name_of_geometry)
        every = scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
        for name, ground in self.grounds.items():
            others = [g for g in every if self.name_of_geometry.get(g) != name and g != ground]
            declaration.ExcludeBetween(GeometrySet([ground]), GeometrySet(others))
        if not_under:
            declaration.ExcludeBetween(GeometrySet(list(not_under)), GeometrySet(own))
        scene_graph.collision_filter_manager().Apply(declaration)

    def separate(
        self, filters: CollisionFilterManager, query: QueryObject, obj: GeometryId
    ) -> None:
        """Let bodies pass through each other that stand on or lean on each other now.

        Each has its own ground, so that a stack stays as it is. Drake replaces two meshes that
        meet by their convex hulls: the object, too, passes through a mesh whose hull it is in.
        """
        pairs = [
            (first, second)
            for first, name in self.name_of_geometry.items()
            for second, other in self.name_of_geometry.items()
            if name in self.grounds and (other not in self.grounds or name < other)
        ]
        limit = dict.fromkeys(pairs, _TOGETHER) | {(obj, mesh): 0.0 for mesh in self.rigid}
        declaration = CollisionFilterDeclaration()
        for (first, second), least in limit.items():
            pair = query.ComputeSignedDistancePairClosestPoints(first, second)
            if pair.distance < least:
                declaration.ExcludeBetween(GeometrySet([first]), GeometrySet([second]))
        filters.Apply(declaration)


def add_surroundings(plant: MultibodyPlant, surroundings: Surroundings) -> SurroundingsInPlant:
    """Add each body as a model instance of its own, and return the record of all.

    Fixed ones are welded to W where they are. Free ones float on a ground of their own at the
    height of their lowest point, as soft as their mass and the plant's time step ask for.
    Primitives and convex meshes are compliant, other meshes rigid, with every detail. The plant is
    not finalized yet. `surroundings` are in W.
    """
    bodies: dict[str, RigidBody] = {}
    grounds: dict[str, GeometryId] = {}
    names: dict[GeometryId, str] = {}
    hard: set[GeometryId] = set()
    for body in surroundings:
        added = bodies[body.name] = _add_body(plant, body)
        for number, (shape, X_BG, fineness) in enumerate(_shapes(body)):
            geometry = plant.RegisterCollisionGeometry(
                added, X_BG, shape, f"{body.name}_{number}", _properties(body, fineness)
            )
            names[geometry] = body.name
            if fineness is None:
                hard.add(geometry)
        if body.inertial is not None:
            grounds[body.name] = add_ground(
                plant,
                float(body.mesh.bounds[0, 2]) + _SUNK,
                body.friction,
                under=body.mesh,
                mass=body.inertial.mass,
                name=f"ground of {body.name}",
            )
    return SurroundingsInPlant(surroundings, plant, bodies, names, frozenset(hard), grounds)


def _add_body(plant: MultibodyPlant, body: Body) -> RigidBody:
    instance, inertial = plant.AddModelInstance(f"beside {body.name}"), body.inertial
    if inertial is None:
        fixed = plant.AddRigidBody(body.name, instance)
        plant.WeldFrames(plant.world_frame(), fixed.body_frame(), rigid(body.X_EB))
        return fixed
    inertia = spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
    return plant.AddRigidBody(body.name, instance, inertia)


def _shapes(body: Body) -> Iterator[tuple[Shape, RigidTransform, float | None]]:
    """Yield Drake's shapes of a body with their poses in B, and the length of facets [m].

    It is None for a rigid shape.
    """
    for geometry in body.geometries:
        X_BG = rigid(geometry.X_LG)
        if geometry.kind != "mesh":
            yield primitive_shape(geometry), X_BG, _FACETS * min(geometry.dimensions)
            continue
        for shape, compliant in _parts(geometry):
            yield shape, X_BG, float(geometry.mesh.extents.max()) if compliant else None


def _parts(geometry: LinkGeometry) -> Iterator[tuple[Shape, bool]]:
    """Yield the convex parts of a mesh, and the rest of it as one rigid mesh."""
    parts = geometry.mesh.split(only_watertight=False, repair=False)
    convex = [part for part in parts if part.is_watertight and part.is_convex]
    if len(convex) == len(parts):
        for part in convex:
            yield Convex(in_memory(part, geometry.link)), True
    else:
        yield Mesh(in_memory(geometry.mesh, geometry.link)), False


def _properties(body: Body, fineness: float | None) -> ProximityProperties:
    properties = ProximityProperties()
    friction = CoulombFriction(body.friction, body.friction)
    AddContactMaterial(dissipation=TABLE_DISSIPATION, friction=friction, properties=properties)
    if fineness is not None:
        AddCompliantHydroelasticProperties(
            resolution_hint=fineness, hydroelastic_modulus=_MODULUS, properties=properties
        )
    else:
        AddRigidHydroelasticProperties(properties)
    return properties
