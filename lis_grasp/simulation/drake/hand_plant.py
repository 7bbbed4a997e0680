"""Hand in a Drake plant: links with compliant hydroelastic skin, joints under PD control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    GeometryId,
    GeometrySet,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.inertias import LEAST_MASS
from lis_grasp.robots.link_bodies import load_visual
from lis_grasp.robots.robot_model import Inertial, LinkGeometry, RobotModel, by_joint_kind
from lis_grasp.robots.robot_model import Joint as TreeJoint
from lis_grasp.simulation.drake.object_plant import FRICTION, spatial_inertia
from lis_grasp.typing import FloatArray

PROBING_SKIN = 1e6
"""Hydroelastic modulus of the skin while probing [Pa].

A spherical tip pressed in by d needs F = pi E d^2: 0.2 N press it in by 0.25 mm, more than the
0.2 mm of a simulation step.
"""
LIFTING_SKIN = 1e7
"""While lifting, the skin is as firm as rubber [Pa]: 5 N press it in by 0.4 mm."""

_STIFFNESS = {"revolute": 5.0, "prismatic": 5_000.0}  # [N m/rad], [N/m]
_DAMPING = {"revolute": 0.1, "prismatic": 50.0}  # [N m s/rad], [N s/m]
_GREY = (0.6, 0.6, 0.63, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class LinksInPlant:
    """Bodies and joints that `add_links` has added to a plant."""

    instance: ModelInstanceIndex  # actuators and desired states in the order of `joints`
    bodies: Mapping[str, RigidBody]  # by link
    joints: tuple[Joint, ...]  # actuated, in the order of the tree's
    followers: tuple[tuple[Joint, TreeJoint], ...]  # coupled to actuated joints

    def set_positions(self, plant_context: Context, q: FloatArray) -> None:
        """Set the joints and their followers to positions q, shape (J,), at rest."""
        followed = [(joint, float(follower.position(q))) for joint, follower in self.followers]
        for joint, position in [*zip(self.joints, q, strict=True), *followed]:
            if isinstance(joint, RevoluteJoint):
                joint.set_angle(plant_context, position)
                joint.set_angular_rate(plant_context, 0.0)
            else:
                joint.set_translation(plant_context, position)
                joint.set_translation_rate(plant_context, 0.0)

    def X_WL(self, plant_context: Context, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        pose: FloatArray = self.bodies[link].EvalPoseInWorld(plant_context).GetAsMatrix4()
        return pose


@dataclass(frozen=True, slots=True, eq=False)
class HandInPlant:
    """A hand that `add_hand` has added to a plant."""

    hand: Hand
    links: LinksInPlant
    link_of_geometry: Mapping[GeometryId, str]

    @property
    def instance(self) -> ModelInstanceIndex:
        """Model instance; actuators and desired states are in the order of `Hand.joint_names`."""
        return self.links.instance

    @property
    def base(self) -> RigidBody:
        """The body of the base link."""
        return self.links.bodies[self.hand.base_link]

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The actuated joints, in the order of `Hand.joint_names`."""
        return self.links.joints

    def set_joint_positions(self, plant_context: Context, q: FloatArray) -> None:
        """Set the joints and their followers to positions q, shape (J,), at rest."""
        self.links.set_positions(plant_context, q)

    def joint_positions(self, plant_context: Context) -> FloatArray:
        """Return the positions of the actuated joints, shape (J,)."""
        return np.array([joint.GetOnePosition(plant_context) for joint in self.joints])

    def weight_efforts(self, plant: MultibodyPlant, plant_context: Context) -> FloatArray:
        """Return the joint efforts (J,) that carry the weight of the links."""
        forces: FloatArray = plant.CalcGravityGeneralizedForces(plant_context)
        return -self.by_joint(forces)

    def by_joint(self, values: FloatArray) -> FloatArray:
        """Return, of values (..., V) of the plant's velocities, those of the joints, (..., J).

        Joints that follow another by a transmission add theirs to its own.
        """
        joints: FloatArray = values[..., [joint.velocity_start() for joint in self.joints]]
        for follower, joint in self.links.followers:
            joints[..., joint.index] += joint.multiplier * values[..., follower.velocity_start()]
        return joints

    def X_WL(self, plant_context: Context, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        return self.links.X_WL(plant_context, link)

    def X_WH(self, plant_context: Context) -> FloatArray:
        """Return the pose of the palm, shape (4, 4)."""
        return self.X_WL(plant_context, self.hand.base_link) @ self.hand.X_LH


def add_hand(
    plant: MultibodyPlant,
    hand: Hand,
    *,
    name: str = "hand",
    gains: tuple[FloatArray, FloatArray] | None = None,
    friction: float = FRICTION,
    modulus: float = PROBING_SKIN,
) -> HandInPlant:
    """Add a hand as a model instance; its base link floats until it is welded or jointed.

    Gravity is compensated. The joints get implicit PD control, and efforts limited by
    `Hand.effort_limits`. The plant is not finalized yet.

    Parameters
    ----------
    plant
        The plant, with a SceneGraph.
    hand
        The hand.
    name
        Of the model instance: another one for each hand.
    gains
        Stiffness and damping of the joints, each (J,) [N m/rad, N m s/rad; or N/m, N s/m]; None for
        those of probing.
    friction
        Coulomb's coefficient of every link.
    modulus
        Hydroelastic modulus of the skin [Pa].
    """
    links = add_links(plant, hand, plant.AddModelInstance(name))
    stiffness, damping = gains or (
        by_joint_kind(hand, **_STIFFNESS),
        by_joint_kind(hand, **_DAMPING),
    )
    for i, joint in enumerate(links.joints):
        actuator = plant.AddJointActuator(joint.name(), joint, hand.effort_limits[i])
        actuator.set_controller_gains(PdControllerGains(p=stiffness[i], d=damping[i]))
    for follower, joint in links.followers:
        leader = links.joints[joint.index]
        plant.AddCouplerConstraint(follower, leader, joint.multiplier, joint.offset)
    link_of_geometry = add_skin(plant, hand, links, friction=friction, modulus=modulus)
    plant.set_gravity_enabled(links.instance, False)
    return HandInPlant(hand, links, link_of_geometry)


def ignore_self_collision(scene_graph: SceneGraph, added: HandInPlant) -> None:
    """Exclude collisions between links of the hand, before a context is made."""
    everything = GeometrySet(list(added.link_of_geometry))
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def add_links(
    plant: MultibodyPlant, tree: RobotModel, instance: ModelInstanceIndex
) -> LinksInPlant:
    """Add the links and joints of a hand or an arm, without motors; its root gets no joint.

    Joints have limits and no damping. Joints that follow another are not coupled to it yet.
    """
    bodies = {
        link: plant.AddRigidBody(link, instance, _spatial_inertia(tree.inertials.get(link)))
        for link in tree.links
    }
    joints: dict[int, Joint] = {}
    followers: list[tuple[Joint, TreeJoint]] = []
    for joint in tree.joints:
        parent, child = bodies[joint.parent], bodies[joint.child]
        frame = plant.AddFrame(
            FixedOffsetFrame(
                f"{joint.name}_frame", parent.body_frame(), RigidTransform(joint.X_PJ), instance
            )
        )
        if joint.kind == "fixed":
            plant.WeldFrames(frame, child.body_frame())
            continue
        kind = RevoluteJoint if joint.kind == "revolute" else PrismaticJoint
        if joint.follows:
            follower = kind(joint.name, frame, child.body_frame(), joint.axis_J)
            followers.append((plant.AddJoint(follower), joint))
            continue
        i = joint.index
        limits = tree.lower[i], tree.upper[i], 0.0  # and damping
        joints[i] = plant.AddJoint(
            kind(joint.name, frame, child.body_frame(), joint.axis_J, *limits)
        )
    ordered = tuple(joints[i] for i in range(len(joints)))
    return LinksInPlant(instance, bodies, ordered, tuple(followers))


def add_skin(
    plant: MultibodyPlant, tree: RobotModel, links: LinksInPlant, *, friction: float, modulus: float
) -> dict[GeometryId, str]:
    """Add compliant collision bodies of a modulus [Pa], and return the link of each."""
    link_of_geometry = {}
    for number, geometry in enumerate(tree.link_geometries):
        identity = plant.RegisterCollisionGeometry(
            links.bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            _collision_shape(geometry),
            f"{geometry.link}_{number}",
            _compliant(geometry, friction, modulus),
        )
        link_of_geometry[identity] = geometry.link
    return link_of_geometry


def add_visuals(plant: MultibodyPlant, tree: RobotModel, links: LinksInPlant) -> None:
    """Add what the links of a hand or an arm look like; those without a look, their bodies."""
    seen = set()
    for number, visual in enumerate(tree.visuals):
        mesh = load_visual(visual)
        if mesh is not None:
            seen.add(visual.link)
            plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            shape = Mesh(_in_memory(plain, visual.link))
            _show(plant, links, visual.link, visual.X_LG, shape, number)
    for number, geometry in enumerate(tree.link_geometries):
        if geometry.link not in seen:
            shape = _collision_shape(geometry)
            _show(plant, links, geometry.link, geometry.X_LG, shape, number)


def _show(
    plant: MultibodyPlant,
    links: LinksInPlant,
    link: str,
    X_LG: FloatArray,
    shape: Shape,
    number: int,
) -> None:
    name = f"{link}_visual_{number}"
    plant.RegisterVisualGeometry(links.bodies[link], RigidTransform(X_LG), shape, name, _GREY)


def _collision_shape(geometry: LinkGeometry) -> Shape:
    """Return Drake's shape of a collision body; a mesh is convex."""
    if geometry.kind == "mesh":
        return Convex(_in_memory(geometry.mesh, geometry.link))
    primitives = {"box": Box, "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}
    return primitives[geometry.kind](*geometry.dimensions)


def _in_memory(mesh: trimesh.Trimesh, name: str) -> InMemoryMesh:
    obj = mesh.export(file_type="obj", include_normals=False)
    return InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", name))


def _compliant(geometry: LinkGeometry, friction: float, modulus: float) -> ProximityProperties:
    """Return the properties of a compliant skin: Coulomb friction and hydroelastic modulus [Pa]."""
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=10.0, friction=CoulombFriction(friction, friction), properties=properties
    )
    smallest = (
        min(geometry.dimensions) if geometry.dimensions else float(geometry.mesh.extents.min())
    )
    AddCompliantHydroelasticProperties(
        resolution_hint=0.5 * smallest, hydroelastic_modulus=modulus, properties=properties
    )
    return properties


def _spatial_inertia(inertial: Inertial | None) -> SpatialInertia:
    # A link without inertia needs a mass for the solver: a gram on a hand of a kilogram.
    if inertial is None or inertial.mass < LEAST_MASS:
        return SpatialInertia(LEAST_MASS, np.zeros(3), UnitInertia.SolidSphere(0.01))
    return spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
