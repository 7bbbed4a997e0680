"""Bodies beside the object in a Drake plant: fixed or free, with the forces on them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Literal, NamedTuple

import numpy as np
import trimesh
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

from lis_grasp.shapes.solids import with_fewer_faces
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
_SKIN = 5e-3  # [m], largest depth of a concave mesh's skin
_LEAST_DEPTH = 1e-4  # [m]; slivers have none
_MOST_IN_SKIN = 500  # triangles
_SUNK = 1e-6  # [m] into the ground at the start, so that the first step finds contact
_TOGETHER = 1e-3  # bodies that are no farther apart at the start [m] stand on or lean on each other


@dataclass(frozen=True, slots=True, eq=False)
class SurroundingsInPlant:
    """Bodies beside the object that `add_surroundings` has added to a plant; W is its world."""

    surroundings: Surroundings  # with poses in W at the start
    plant: MultibodyPlant
    bodies: Mapping[str, RigidBody]
    name_of_geometry: Mapping[GeometryId, str]
    skins: Mapping[GeometryId, tuple[GeometryId, ...]]  # of concave meshes, which are rigid
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
        names = self.name_of_geometry
        pairs = chain(patch_forces(results, names), point_forces(results, names))
        found = {names.get(g) for pair in pairs for g in pair[:2]}
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
        names = self.name_of_geometry
        pairs = chain(patch_forces(results, names), point_forces(results, names))
        for first, second, force in pairs:
            for own, other in ((first, second), (second, first)):
                name, who = names.get(own), pushers.get(other)
                if name is not None and who is not None:
                    sums[name, who] = sums.get((name, who), 0.0) + force
        return sums

    def let_rest(
        self, scene_graph: SceneGraph, obj: GeometryId, not_under: Collection[GeometryId]
    ) -> None:
        """Make free bodies rest on their own grounds alone, which carry nothing else.

        Tables of others are `not_under` any body. Object and concave meshes are rigid: they meet
        each other's skins alone.
        """
        declaration = CollisionFilterDeclaration()
        own = list(self.name_of_geometry)
        every = scene_graph.model_inspector().GetAllGeometryIds(Role.kProximity)
        rigid_meshes = {obj, *self.skins}
        for mesh, skin in self.skins.items():
            name = self.name_of_geometry[mesh]
            meets = {g for g in rigid_meshes if self.name_of_geometry.get(g) != name}
            declaration.ExcludeBetween(
                GeometrySet(list(skin)), GeometrySet([g for g in every if g not in meets])
            )
            declaration.ExcludeBetween(GeometrySet([mesh]), GeometrySet(list(meets)))
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

        Each has its own ground, so that a stack stays as it is. The object may stand on parts of a
        skin.
        """
        parts = {g for skin in self.skins.values() for g in skin}
        solid = {g: name for g, name in self.name_of_geometry.items() if g not in parts}
        pairs = [
            (first, second)
            for first, name in solid.items()
            for second, other in solid.items()
            if name in self.grounds and (other not in self.grounds or name < other)
        ]
        pairs += [(obj, part) for part in parts]
        declaration = CollisionFilterDeclaration()
        for first, second in pairs:
            # Of a mesh Drake has the distance from its hull: that of its skin tells more.
            near = (
                query.ComputeSignedDistancePairClosestPoints(first, each).distance < _TOGETHER
                for each in self.skins.get(second, (second,))
            )
            if any(near):
                declaration.ExcludeBetween(GeometrySet([first]), GeometrySet([second]))
        filters.Apply(declaration)


def add_surroundings(plant: MultibodyPlant, surroundings: Surroundings) -> SurroundingsInPlant:
    """Add each body as a model instance of its own, and return the record of all.

    Fixed ones are welded to W where they are. Free ones float on a ground of their own at the
    height of their lowest point, as soft as their mass and the plant's time step ask for.
    Primitives and convex meshes are compliant, other meshes rigid, with every detail. Drake
    replaces two rigid meshes that meet by their convex hulls: a concave one has a compliant skin,
    which other rigid meshes meet. The plant is not finalized yet. `surroundings` are in W.
    """
    bodies: dict[str, RigidBody] = {}
    grounds: dict[str, GeometryId] = {}
    names: dict[GeometryId, str] = {}
    skins: dict[GeometryId, tuple[GeometryId, ...]] = {}
    for body in surroundings:
        added = bodies[body.name] = _add_body(plant, body)

        def add(part: _Part, number: str, body: Body = body, to: RigidBody = added) -> GeometryId:
            properties = _properties(body, part.fineness)
            name = f"{body.name}_{number}"
            geometry = plant.RegisterCollisionGeometry(to, part.X_BG, part.shape, name, properties)
            names[geometry] = body.name
            return geometry

        for number, part in enumerate(_parts(body)):
            geometry = add(part, f"{number}")
            if part.fineness is None:
                skin = enumerate(_skin(part))
                skins[geometry] = tuple(add(piece, f"{number}_{k}") for k, piece in skin)
        if body.inertial is not None:
            grounds[body.name] = add_ground(
                plant,
                float(body.mesh.bounds[0, 2]) + _SUNK,
                body.friction,
                under=body.mesh,
                mass=body.inertial.mass,
                name=f"ground of {body.name}",
            )
    return SurroundingsInPlant(surroundings, plant, bodies, names, skins, grounds)


def _add_body(plant: MultibodyPlant, body: Body) -> RigidBody:
    instance, inertial = plant.AddModelInstance(f"beside {body.name}"), body.inertial
    if inertial is None:
        fixed = plant.AddRigidBody(body.name, instance)
        plant.WeldFrames(plant.world_frame(), fixed.body_frame(), rigid(body.X_EB))
        return fixed
    inertia = spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
    return plant.AddRigidBody(body.name, instance, inertia)


class _Part(NamedTuple):
    """A shape of a body, with its pose in B."""

    shape: Shape
    X_BG: RigidTransform
    fineness: float | None  # length of facets [m]; None of a rigid shape
    mesh: trimesh.Trimesh  # in G


def _parts(body: Body) -> Iterator[_Part]:
    """Yield the shapes of a body: a mesh as its convex parts, or as one rigid mesh."""
    for geometry in body.geometries:
        X_BG, mesh = rigid(geometry.X_LG), geometry.mesh
        if geometry.kind != "mesh":
            fineness = _FACETS * min(geometry.dimensions)
            yield _Part(primitive_shape(geometry), X_BG, fineness, mesh)
            continue
        parts = mesh.split(only_watertight=False, repair=False)
        if all(part.is_watertight and part.is_convex for part in parts):
            for part in parts:
                yield _compliant(part, X_BG, geometry.link)
        else:
            yield _Part(Mesh(in_memory(mesh, geometry.link)), X_BG, None, mesh)


def _compliant(mesh: trimesh.Trimesh, X_BG: RigidTransform, name: str) -> _Part:
    shape = Convex(in_memory(mesh, name))
    return _Part(shape, X_BG, float(mesh.extents.max()), mesh)


def _skin(part: _Part) -> Iterator[_Part]:
    """Yield a tetrahedron under each triangle of a mesh, no steeper than 45 degrees.

    So it is inside of a solid whose edges are no sharper than that.
    """
    mesh = with_fewer_faces(part.mesh, _MOST_IN_SKIN)
    corners = np.asarray(mesh.triangles)
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    around = opposite.sum(axis=1)
    center = np.einsum("fk,fkc->fc", opposite, corners) / around[:, None]  # of the inscribed circle
    depth = np.minimum(2.0 * mesh.area_faces / around, _SKIN)
    tops = center - depth[:, None] * mesh.face_normals
    for triangle, top, deep in zip(corners, tops, depth, strict=True):
        if deep > _LEAST_DEPTH:
            tetrahedron = trimesh.Trimesh(
                [*triangle, top], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], process=False
            )
            yield _compliant(tetrahedron, part.X_BG, "skin")


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
