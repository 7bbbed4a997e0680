"""Hand in a Drake plant: links with compliant skin, and joints under PD control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from warnings import warn

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PdControllerGains, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder

from lis_grasp.exceptions import InvalidOptionError, listed
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.mjcf import SERVO_STIFFNESS
from lis_grasp.robots.robot_model import by_joint_kind
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.simulation.drake.link_plant import LinksInPlant, add_links, add_skin
from lis_grasp.simulation.drake.pd_wrist import PdWrist
from lis_grasp.simulation.drake.plant_parts import wrong_type
from lis_grasp.typing import FloatArray, IndexArray

PROBING_SKIN = 1e6
"""Hydroelastic modulus of the skin while probing [Pa].

A spherical tip pressed in by d needs F = pi E d^2: 0.2 N press it in by 0.25 mm, more than the
0.2 mm of a simulation step.
"""
LIFTING_SKIN = 1e7
"""While lifting, the skin is as firm as rubber [Pa]: 5 N press it in by 0.4 mm."""

_DAMPING = {"revolute": 0.1, "prismatic": 50.0}  # [N m s/rad], [N s/m]
_COMPLIANCE = ("hydroelastic", "compliance_type")  # Drake's name of the property


@dataclass(frozen=True, slots=True, eq=False)
class HandInPlant:
    """A hand in a plant, which `add_hand` has added or `find_hand` has found."""

    hand: Hand
    links: LinksInPlant
    link_of_geometry: Mapping[GeometryId, str]
    scene_graph: SceneGraph | None = None  # of the plant; None if that was finalized before

    @property
    def instance(self) -> ModelInstanceIndex:
        """Model instance; desired states are in the order of `actuated`."""
        return self.links.instance

    @property
    def actuated(self) -> IndexArray:
        """Indices in `Hand.joint_names` of the joints by actuator, shape (J,)."""
        driven = _driven_joints(self.base.GetParentPlant(), self.instance)
        return np.array([self.hand.joint_names.index(name) for name in driven], dtype=np.intp)

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
        """Return the joints' values (..., J) out of values of the plant's velocities (..., V).

        Joints that follow another by a transmission add theirs to its own.
        """
        joints: FloatArray = values[..., [joint.velocity_start() for joint in self.joints]]
        for follower, joint in self.links.followers:
            joints[..., joint.index] += joint.multiplier * values[..., follower.velocity_start()]
        return joints

    def add_wrist(self, builder: DiagramBuilder) -> PdWrist:
        """Add a system that pulls the floating hand to a pose, and return it.

        Connect its input ``X_WG``, and its output to the plant's ``applied_spatial_force``: of
        several hands by an ``ExternallyAppliedSpatialForceMultiplexer``.

        Raises `InvalidOptionError` if the plant is not finalized, or the hand does not float, or
        has weight, which a wrist does not carry.
        """
        if not isinstance(builder, DiagramBuilder):
            raise wrong_type("builder", builder, "the DiagramBuilder of the plant")
        plant, base = self.base.GetParentPlant(), self.base
        name = plant.GetModelInstanceName(self.instance)
        if not plant.is_finalized():
            raise InvalidOptionError(
                "a wrist needs a finalized plant: call plant.Finalize() first", option="builder"
            )
        if base.index() not in plant.GetFloatingBaseBodies():
            raise InvalidOptionError(
                f"a wrist needs a hand that floats; '{name}' is held by a joint or a weld: add it"
                " without one, or move what holds it",
                option="hand",
                value=name,
            )
        if plant.is_gravity_enabled(self.instance):
            raise InvalidOptionError(
                f"a wrist needs a hand without gravity; '{name}' has weight, and would hang"
                f" low: call add_hand before plant.Finalize()",
                option="hand",
                value=name,
            )
        every = map(plant.get_joint, plant.GetJointIndices())
        floats = [joint.index() for joint in every if joint.child_body().index() == base.index()]
        carried = plant.GetBodiesKinematicallyAffectedBy(floats)
        wrist: PdWrist = builder.AddSystem(PdWrist(base, [plant.get_body(b) for b in carried]))
        for port in ("body_poses", "body_spatial_velocities"):
            builder.Connect(plant.GetOutputPort(port), wrist.GetInputPort(port))
        return wrist

    def X_WL(self, plant_context: Context, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        return self.links.X_WL(plant_context, link)

    def X_WH(self, plant_context: Context) -> FloatArray:
        """Return the pose of the palm, shape (4, 4)."""
        return self.X_WL(plant_context, self.hand.base_link) @ self.hand.X_LH


def require_in_plant(system: str, hand: object) -> None:
    """Raise `InvalidOptionError` if a system is not given what `add_hand` returns."""
    if not isinstance(hand, HandInPlant):
        raise InvalidOptionError(
            f"{system} needs the hand in the plant, which add_hand returns; it has a"
            f" {type(hand).__name__}",
            option="hand",
            value=hand,
        )


def add_hand_model(
    plant: MultibodyPlant,
    hand: Hand,
    *,
    name: str = "hand",
    gains: tuple[FloatArray, FloatArray] | None = None,
    friction: float = USUAL_FRICTION,
    modulus: float = PROBING_SKIN,
) -> HandInPlant:
    """Add a hand as a model instance; its base link floats until it is welded or jointed.

    Gravity is compensated. The joints get implicit PD control, and efforts limited by
    `Hand.effort_limits`. Links of the hand do not collide with each other. The plant is not
    finalized yet. For arguments see `lis_grasp.drake.add_hand`, which also loads, draws and welds
    the hand.
    """
    links = add_links(plant, hand, plant.AddModelInstance(name))
    stiffness, damping = gains or (
        by_joint_kind(hand, **SERVO_STIFFNESS),
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
    added = HandInPlant(hand, links, link_of_geometry, Parser(plant).scene_graph())
    _ignore_self_collision(added)
    return added


def find_hand(plant: MultibodyPlant, hand: Hand, instance: ModelInstanceIndex) -> HandInPlant:
    """Return a hand that is in a plant already, such as one that a parser has added.

    Its links and joints are found in the model instance by their names. While the plant is not
    finalized, it loses its weight, as a hand of `add_hand`, and a link without hydroelastic
    properties is reported by a warning.

    Raises `InvalidOptionError` if the instance lacks a link, a joint or an actuator, or has other
    actuators.
    """
    name = plant.GetModelInstanceName(instance)
    followers = [joint for joint in hand.joints if joint.follows]
    moving = [*hand.joint_names, *(joint.name for joint in followers)]
    driven = _driven_joints(plant, instance)
    lacks = [f"link {n}" for n in hand.links if not plant.HasBodyNamed(n, instance)]
    lacks += [f"joint {n}" for n in moving if not plant.HasJointNamed(n, instance)]
    lacks += [f"actuator of {n}" for n in hand.joint_names if n not in driven]
    others = [n for n in driven if n not in hand.joint_names]
    if lacks or others:
        wrong = f"lacks {listed(lacks)}" if lacks else f"also drives {listed(others)}"
        raise InvalidOptionError(
            f"model instance '{name}' must be hand {hand.name} with its motors; it {wrong}: correct"
            " the description file, or let add_hand add the hand",
            option="instance",
            value=name,
        )
    links = LinksInPlant(
        instance,
        {link: plant.GetBodyByName(link, instance) for link in hand.links},
        tuple(plant.GetJointByName(n, instance) for n in hand.joint_names),
        tuple((plant.GetJointByName(joint.name, instance), joint) for joint in followers),
    )
    link_of_geometry = {
        geometry: link
        for link, body in links.bodies.items()
        for geometry in plant.GetCollisionGeometriesForBody(body)
    }
    scene_graph = None if plant.is_finalized() else Parser(plant).scene_graph()
    if not plant.is_finalized():
        plant.set_gravity_enabled(instance, False)
    if scene_graph is not None:
        inspector = scene_graph.model_inspector()
        hard = {
            link: None
            for geometry, link in link_of_geometry.items()
            if not inspector.GetProximityProperties(geometry).HasProperty(*_COMPLIANCE)
        }
        if hard:
            warn(
                f"links {listed(list(hard))} of '{name}' have no hydroelastic properties: they feel"
                " by point contact, which takes meshes for their convex hulls. Give them"
                " drake:compliant_hydroelastic in their file, or let add_hand add the hand",
                stacklevel=3,
            )
    return HandInPlant(hand, links, link_of_geometry, scene_graph)


def _driven_joints(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[str]:
    """Return the names of an instance's joints with an actuator, in the actuators' order."""
    every = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    return [each.joint().name() for each in every if each.model_instance() == instance]


def _ignore_self_collision(added: HandInPlant) -> None:
    """Exclude collisions between links of the hand, before a context is made."""
    if added.scene_graph is not None:
        declaration = CollisionFilterDeclaration()
        declaration.ExcludeWithin(GeometrySet(list(added.link_of_geometry)))
        added.scene_graph.collision_filter_manager().Apply(declaration)
