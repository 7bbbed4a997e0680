"""A hand in a Drake plant: links with compliant hydroelastic skin, joints under PD control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
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
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)

from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import Inertial, LinkGeometry
from lis_grasp.hands.hand_parts import Joint as HandJoint
from lis_grasp.typing import FloatArray

# A frame without matter still needs a mass for the solver; a gram on a hand of a kilogram.
_LEAST_MASS = 1e-3
_WRIST_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class HandInPlant:
    """A hand that `add_hand` has put into a plant.

    Parameters
    ----------
    hand
        The hand.
    instance
        Its model instance; actuators and desired states are in the order of `Hand.joint_names`.
    bodies
        Link name -> body.
    joints
        The actuated joints, in the order of `Hand.joint_names`.
    link_of_geometry
        Collision geometry -> name of the link that carries it.
    followers
        The joints that a transmission couples to actuated ones, and what they are in the hand.
    """

    hand: Hand
    instance: ModelInstanceIndex
    bodies: Mapping[str, RigidBody]
    joints: tuple[Joint, ...]
    link_of_geometry: Mapping[GeometryId, str]
    followers: tuple[tuple[Joint, HandJoint], ...] = ()

    def set_joint_positions(self, plant_context: object, q: FloatArray) -> None:
        """Put the joints at positions q, shape (J,), and those that follow them, at rest."""
        followed = [(joint, float(follower.position(q))) for joint, follower in self.followers]
        for joint, position in [*zip(self.joints, q, strict=True), *followed]:
            if isinstance(joint, RevoluteJoint):
                joint.set_angle(plant_context, position)
                joint.set_angular_rate(plant_context, 0.0)
            else:
                joint.set_translation(plant_context, position)
                joint.set_translation_rate(plant_context, 0.0)


def add_hand(
    plant: MultibodyPlant,
    hand: Hand,
    *,
    stiffness: npt.ArrayLike,
    damping: npt.ArrayLike,
    friction: float,
    hydroelastic_modulus: float,
    name: str = "hand",
) -> HandInPlant:
    """Add a hand's links and joints; its base link gets no joint here, and gravity is compensated.

    Parameters
    ----------
    plant
        Registered as a source of geometry, not finalized.
    hand
        What to add.
    stiffness, damping
        Implicit PD gains of the joints [N m/rad, N m s/rad; or N/m, N s/m], scalar or (J,); efforts
        are limited by `Hand.effort_limits`.
    friction
        Coulomb coefficient of every link.
    hydroelastic_modulus
        Of the compliant skin [Pa].
    name
        Of the model instance.
    """
    instance = plant.AddModelInstance(name)
    count = len(hand.joint_names)
    stiffness = np.broadcast_to(np.asarray(stiffness, dtype=np.float64), count)
    damping = np.broadcast_to(np.asarray(damping, dtype=np.float64), count)
    bodies = {
        link: plant.AddRigidBody(link, instance, _spatial_inertia(hand.inertials.get(link)))
        for link in hand.links
    }
    joints: dict[int, Joint] = {}
    followers: list[tuple[Joint, HandJoint]] = []
    for joint in hand.joints:
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
        joints[i] = plant.AddJoint(
            kind(
                joint.name,
                frame,
                child.body_frame(),
                joint.axis_J,
                hand.lower[i],
                hand.upper[i],
                0.0,
            )
        )
    for i in range(count):
        actuator = plant.AddJointActuator(joints[i].name(), joints[i], hand.effort_limits[i])
        actuator.set_controller_gains(PdControllerGains(p=stiffness[i], d=damping[i]))
    for follower, joint in followers:
        plant.AddCouplerConstraint(follower, joints[joint.index], joint.multiplier, joint.offset)
    link_of_geometry = {}
    for number, geometry in enumerate(hand.link_geometries):
        properties = _skin(geometry, friction, hydroelastic_modulus)
        identity = plant.RegisterCollisionGeometry(
            bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            _shape(geometry),
            f"{geometry.link}_{number}",
            properties,
        )
        link_of_geometry[identity] = geometry.link
    plant.set_gravity_enabled(instance, False)
    ordered = tuple(joints[i] for i in range(count))
    return HandInPlant(hand, instance, bodies, ordered, link_of_geometry, tuple(followers))


def ignore_self_collision(scene_graph: SceneGraph, added: HandInPlant) -> None:
    """Let no two links of the hand collide."""
    everything = GeometrySet(list(added.link_of_geometry))
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def ignore_designed_contacts(scene_graph: SceneGraph, added: HandInPlant) -> None:
    """Let those links not collide that touch by design (`Hand.self_collision_exclusions`)."""
    by_link: dict[str, list[GeometryId]] = {}
    for geometry, link in added.link_of_geometry.items():
        by_link.setdefault(link, []).append(geometry)
    declaration = CollisionFilterDeclaration()
    for geometries in by_link.values():
        declaration.ExcludeWithin(GeometrySet(geometries))
    for first, second in sorted(added.hand.self_collision_exclusions):
        if first in by_link and second in by_link:
            declaration.ExcludeBetween(GeometrySet(by_link[first]), GeometrySet(by_link[second]))
    scene_graph.collision_filter_manager().Apply(declaration)


@dataclass(frozen=True, slots=True, eq=False)
class Wrist:
    """A 6-axis wrist that `add_wrist` has put under a hand.

    Its state is ``[x, y, z, roll, pitch, yaw]`` and rates, relative to the pose it was added at, in
    W's axes; its model instance has one desired-state port in that order.
    """

    instance: ModelInstanceIndex
    joints: tuple[Joint, ...]


def add_wrist(
    plant: MultibodyPlant,
    added: HandInPlant,
    X_WB: FloatArray,
    *,
    stiffness: tuple[float, float],
    damping: tuple[float, float],
    limits: tuple[float, float],
) -> Wrist:
    """Hold the hand's base link by three sliding and three turning joints under PD control.

    The wrist's zero is `X_WB`, so it is far from its singularity (a quarter turn of pitch) wherever
    the hand is posed.

    Parameters
    ----------
    plant, added
        The plant, and the hand in it.
    X_WB
        Shape (4, 4): pose of the base link with the wrist at zero.
    stiffness, damping, limits
        Of the sliding [N/m, N s/m, N] and of the turning joints [N m/rad, N m s/rad, N m].
    """
    instance = plant.AddModelInstance("wrist")
    # Light against the hand, heavy enough to keep the solver's mass matrix well conditioned.
    carriage = SpatialInertia(0.1, np.zeros(3), UnitInertia.SolidSphere(0.05))
    frame = plant.AddFrame(
        FixedOffsetFrame("wrist_zero", plant.world_frame(), RigidTransform(X_WB[:3, 3]), instance)
    )
    joints: list[Joint] = []
    for kind, turning in ((PrismaticJoint, False), (RevoluteJoint, True)):
        for axis, letter in zip(np.eye(3)[:: -1 if turning else 1], _order(turning), strict=True):
            joint_name = f"wrist_{'turn' if turning else 'slide'}_{letter}"
            body = plant.AddRigidBody(f"{joint_name}_body", instance, carriage)
            joint = plant.AddJoint(kind(joint_name, frame, body.body_frame(), axis))
            frame = body.body_frame()
            joints.append(joint)
    base = added.bodies[added.hand.base_link]
    R_WB = np.eye(4)
    R_WB[:3, :3] = X_WB[:3, :3]
    plant.WeldFrames(frame, base.body_frame(), RigidTransform(R_WB))
    in_order = (*joints[:3], *reversed(joints[3:]))  # x y z, then roll pitch yaw
    for joint in in_order:
        turning = isinstance(joint, RevoluteJoint)
        actuator = plant.AddJointActuator(joint.name(), joint, limits[turning])
        actuator.set_controller_gains(PdControllerGains(p=stiffness[turning], d=damping[turning]))
    plant.set_gravity_enabled(instance, False)
    return Wrist(instance, in_order)


def _order(turning: bool) -> tuple[str, ...]:
    # Yaw first, roll last: the usual roll-pitch-yaw about W's axes.
    return _WRIST_AXES[::-1] if turning else _WRIST_AXES


def _spatial_inertia(inertial: Inertial | None) -> SpatialInertia:
    if inertial is None or inertial.mass < _LEAST_MASS:
        return SpatialInertia(_LEAST_MASS, np.zeros(3), UnitInertia.SolidSphere(0.01))
    matrix = inertial.inertia_L
    return SpatialInertia.MakeFromCentralInertia(
        inertial.mass,
        inertial.center_L,
        RotationalInertia(*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2]),
    )


def _shape(geometry: LinkGeometry) -> Shape:
    match geometry.kind:
        case "box":
            return Box(*geometry.dimensions)
        case "sphere":
            return Sphere(*geometry.dimensions)
        case "cylinder":
            return Cylinder(*geometry.dimensions)
        case "capsule":
            return Capsule(*geometry.dimensions)
        case "mesh":
            obj = geometry.mesh.convex_hull.export(file_type="obj", include_normals=False)
            return Convex(InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", geometry.link)))


def _skin(geometry: LinkGeometry, friction: float, modulus: float) -> ProximityProperties:
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
