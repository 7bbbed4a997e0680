"""Hand in a Drake plant: links with compliant hydroelastic skin, joints under PD control."""

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
    SpatialInertia,
    UnitInertia,
)

from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_parts import Inertial, LinkGeometry
from lis_grasp.hands.hand_parts import Joint as HandJoint
from lis_grasp.hands.inertias import LEAST_MASS
from lis_grasp.simulation.object_plant import spatial_inertia
from lis_grasp.typing import FloatArray

PROBING_SKIN, LIFTING_SKIN = 1e6, 1e7
"""Hydroelastic moduli of the skin [Pa].

A spherical tip pressed in by d needs F = pi E d^2. While probing, the skin is soft: 0.2 N press it
in by 0.25 mm, more than the 0.2 mm of a simulation step. While lifting, it is as firm as rubber:
5 N press it in by 0.4 mm.
"""


@dataclass(frozen=True, slots=True, eq=False)
class HandInPlant:
    """A hand that `add_hand` has added to a plant."""

    hand: Hand
    instance: ModelInstanceIndex  # actuators and desired states in the order of Hand.joint_names
    bodies: Mapping[str, RigidBody]  # by link
    joints: tuple[Joint, ...]  # actuated, in the order of Hand.joint_names
    link_of_geometry: Mapping[GeometryId, str]
    followers: tuple[tuple[Joint, HandJoint], ...] = ()  # coupled to actuated joints

    def set_joint_positions(self, plant_context: object, q: FloatArray) -> None:
        """Set the joints and their followers to positions q, shape (J,), at rest."""
        followed = [(joint, float(follower.position(q))) for joint, follower in self.followers]
        for joint, position in [*zip(self.joints, q, strict=True), *followed]:
            if isinstance(joint, RevoluteJoint):
                joint.set_angle(plant_context, position)
                joint.set_angular_rate(plant_context, 0.0)
            else:
                joint.set_translation(plant_context, position)
                joint.set_translation_rate(plant_context, 0.0)

    def joint_positions(self, plant_context: object) -> FloatArray:
        """Return the positions of the actuated joints, shape (J,)."""
        return np.array([joint.GetOnePosition(plant_context) for joint in self.joints])

    def X_WL(self, plant_context: object, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        pose: FloatArray = self.bodies[link].EvalPoseInWorld(plant_context).GetAsMatrix4()
        return pose

    def X_WH(self, plant_context: object) -> FloatArray:
        """Return the pose of the palm, shape (4, 4)."""
        return self.X_WL(plant_context, self.hand.base_link) @ self.hand.X_LH


def by_joint_kind(hand: Hand, *, revolute: float, prismatic: float) -> FloatArray:
    """Return one of two values for each actuated joint, shape (J,)."""
    values = {"revolute": revolute, "prismatic": prismatic}
    kinds = {joint.index: joint.kind for joint in hand.joints if joint.is_actuated}
    return np.array([values[kinds[i]] for i in range(len(hand.joint_names))])


def add_hand(
    plant: MultibodyPlant,
    hand: Hand,
    *,
    stiffness: npt.ArrayLike,
    damping: npt.ArrayLike,
    friction: float,
    hydroelastic_modulus: float,
) -> HandInPlant:
    """Add a hand's links and joints; its base link gets no joint, and gravity is compensated.

    The joints get implicit PD control with gains [N m/rad, N m s/rad; or N/m, N s/m], scalar or
    (J,), and efforts limited by `Hand.effort_limits`. `friction` is Coulomb's coefficient of every
    link, `hydroelastic_modulus` that of its skin [Pa]. The plant is not finalized yet.
    """
    instance = plant.AddModelInstance("hand")
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
        limits = hand.lower[i], hand.upper[i], 0.0  # and damping
        joints[i] = plant.AddJoint(
            kind(joint.name, frame, child.body_frame(), joint.axis_J, *limits)
        )
    for i in range(count):
        actuator = plant.AddJointActuator(joints[i].name(), joints[i], hand.effort_limits[i])
        actuator.set_controller_gains(PdControllerGains(p=stiffness[i], d=damping[i]))
    for follower, joint in followers:
        plant.AddCouplerConstraint(follower, joints[joint.index], joint.multiplier, joint.offset)
    link_of_geometry = {}
    for number, geometry in enumerate(hand.link_geometries):
        name = f"{geometry.link}_{number}"
        identity = plant.RegisterCollisionGeometry(
            bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            _shape(geometry),
            name,
            _skin(geometry, friction, hydroelastic_modulus),
        )
        link_of_geometry[identity] = geometry.link
    plant.set_gravity_enabled(instance, False)
    ordered = tuple(joints[i] for i in range(count))
    return HandInPlant(hand, instance, bodies, ordered, link_of_geometry, tuple(followers))


def ignore_self_collision(scene_graph: SceneGraph, added: HandInPlant) -> None:
    """Exclude collisions between links of the hand."""
    everything = GeometrySet(list(added.link_of_geometry))
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def _spatial_inertia(inertial: Inertial | None) -> SpatialInertia:
    # A link without inertia needs a mass for the solver: a gram on a hand of a kilogram.
    if inertial is None or inertial.mass < LEAST_MASS:
        return SpatialInertia(LEAST_MASS, np.zeros(3), UnitInertia.SolidSphere(0.01))
    return spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)


def _shape(geometry: LinkGeometry) -> Shape:
    if geometry.kind == "mesh":
        obj = geometry.mesh.export(file_type="obj", include_normals=False)
        return Convex(InMemoryMesh(mesh_file=MemoryFile(obj.encode(), ".obj", geometry.link)))
    primitives = {"box": Box, "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}
    return primitives[geometry.kind](*geometry.dimensions)


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
