"""Hand in a Drake plant: links with compliant hydroelastic skin, joints under PD control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    Joint,
    ModelInstanceIndex,
    PdControllerGains,
    RigidBody,
)
from pydrake.systems.framework import Context

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.hand_parts import Joint as HandJoint
from lis_grasp.robots.hand_parts import LinkGeometry
from lis_grasp.simulation.drake.link_tree_plant import (
    LinksInPlant,
    add_links,
    collision_shape,
    couple_followers,
)
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
    added: LinksInPlant
    link_of_geometry: Mapping[GeometryId, str]

    @property
    def bodies(self) -> Mapping[str, RigidBody]:
        """The body of each link."""
        return self.added.bodies

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The actuated joints, in the order of `Hand.joint_names`."""
        return self.added.joints

    @property
    def followers(self) -> tuple[tuple[Joint, HandJoint], ...]:
        """The joints that are coupled to actuated ones."""
        return self.added.followers

    def set_joint_positions(self, plant_context: Context, q: FloatArray) -> None:
        """Set the joints and their followers to positions q, shape (J,), at rest."""
        self.added.set_positions(plant_context, q)

    def joint_positions(self, plant_context: object) -> FloatArray:
        """Return the positions of the actuated joints, shape (J,)."""
        return np.array([joint.GetOnePosition(plant_context) for joint in self.joints])

    def weight_efforts(self, plant: MultibodyPlant, plant_context: Context) -> FloatArray:
        """Return the joint efforts (J,) that carry the weight of the links."""
        forces: FloatArray = plant.CalcGravityGeneralizedForces(plant_context)
        efforts = -forces[[joint.velocity_start() for joint in self.joints]]
        for follower, joint in self.followers:
            efforts[joint.index] -= joint.multiplier * forces[follower.velocity_start()]
        return efforts

    def X_WL(self, plant_context: object, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        pose: FloatArray = self.bodies[link].EvalPoseInWorld(plant_context).GetAsMatrix4()
        return pose

    def X_WH(self, plant_context: object) -> FloatArray:
        """Return the pose of the palm, shape (4, 4)."""
        return self.X_WL(plant_context, self.hand.base_link) @ self.hand.X_LH


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
    added = add_links(plant, hand, instance)
    for i in range(count):
        actuator = plant.AddJointActuator(
            added.joints[i].name(), added.joints[i], hand.effort_limits[i]
        )
        actuator.set_controller_gains(PdControllerGains(p=stiffness[i], d=damping[i]))
    couple_followers(plant, added)
    link_of_geometry = {}
    for number, geometry in enumerate(hand.link_geometries):
        name = f"{geometry.link}_{number}"
        identity = plant.RegisterCollisionGeometry(
            added.bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            collision_shape(geometry),
            name,
            link_skin(geometry, friction, hydroelastic_modulus),
        )
        link_of_geometry[identity] = geometry.link
    plant.set_gravity_enabled(instance, False)
    return HandInPlant(hand, instance, added, link_of_geometry)


def ignore_self_collision(scene_graph: SceneGraph, added: HandInPlant) -> None:
    """Exclude collisions between links of the hand."""
    everything = GeometrySet(list(added.link_of_geometry))
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeWithin(everything)
    )


def link_skin(geometry: LinkGeometry, friction: float, modulus: float) -> ProximityProperties:
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
