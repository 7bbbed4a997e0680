"""Arm in a Drake plant: links that collide, and joints under stiff PD control with feedforward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    CollisionFilterManager,
    GeometryId,
    GeometrySet,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import Context

from lis_grasp.robots.arm import Arm
from lis_grasp.simulation.drake.arm_dynamics import ArmDynamics, add_arm_links
from lis_grasp.simulation.drake.hand_plant import HandInPlant, link_skin
from lis_grasp.simulation.drake.link_tree_plant import LinksInPlant, collision_shape
from lis_grasp.typing import FloatArray

# Firm against the hand's skin [Pa]; an arm that touches anything ends the motion.
_ARM_SKIN = 1e7
_FRICTION = 0.5
_DAMPING_RATIO = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ArmInPlant:
    """An arm that `add_arm` has added to a plant."""

    arm: Arm
    hand: HandInPlant
    instance: ModelInstanceIndex
    added: LinksInPlant
    link_of_geometry: Mapping[GeometryId, str]

    def X_WL(self, context: Context, link: str) -> FloatArray:
        """Return the pose of a link, shape (4, 4)."""
        pose: FloatArray = self.added.bodies[link].EvalPoseInWorld(context).GetAsMatrix4()
        return pose


def add_arm(
    plant: MultibodyPlant,
    arm: Arm,
    added_hand: HandInPlant,
    *,
    X_WA: FloatArray,
    X_FB: FloatArray,
    dynamics: ArmDynamics,
) -> ArmInPlant:
    """Add an arm with its base link at X_WA (4, 4), and weld the hand's base link to its flange.

    The joints get implicit PD control with the arm's stiffness, critically damped for the inertia
    at each joint in the home posture: rotors of large gears are most of it. Gravity acts on arm and
    hand. X_FB is the hand's base link in the flange frame. The plant is not finalized yet.
    """
    added = add_arm_links(plant, arm, X_WA)
    damping = 2.0 * _DAMPING_RATIO * np.sqrt(arm.stiffness * dynamics.inertias(arm.home))
    instance = added.bodies[arm.base_link].model_instance()
    for j, joint in enumerate(added.joints):
        gains = PdControllerGains(p=arm.stiffness[j], d=damping[j])
        plant.GetJointActuatorByName(joint.name(), instance).set_controller_gains(gains)
    base = added_hand.bodies[added_hand.hand.base_link]
    flange = added.bodies[arm.flange].body_frame()
    plant.WeldFrames(flange, base.body_frame(), RigidTransform(arm.X_LF @ X_FB))
    link_of_geometry = {}
    for number, geometry in enumerate(arm.link_geometries):
        identity = plant.RegisterCollisionGeometry(
            added.bodies[geometry.link],
            RigidTransform(geometry.X_LG),
            collision_shape(geometry),
            f"arm_{geometry.link}_{number}",
            link_skin(geometry, _FRICTION, _ARM_SKIN),
        )
        link_of_geometry[identity] = geometry.link
    plant.set_gravity_enabled(added_hand.instance, True)
    return ArmInPlant(arm, added_hand, instance, added, link_of_geometry)


def ignore_mounting(
    manager: CollisionFilterManager, arm: ArmInPlant, table: GeometryId | None
) -> None:
    """Exclude collisions that mean nothing.

    They are those between links of the arm that may touch by its file, between its foot and the
    table on which it is, and of the hand's base link with the flange that carries it.
    """

    def exclude(first: list[GeometryId], second: list[GeometryId]) -> None:
        if first and second:
            manager.Apply(
                CollisionFilterDeclaration().ExcludeBetween(GeometrySet(first), GeometrySet(second))
            )

    def of(*links: str) -> list[GeometryId]:
        return [g for g, link in arm.link_of_geometry.items() if link in links]

    for first, second in sorted(arm.arm.self_collision_exclusions):
        exclude(of(first), of(second))
    exclude(of(*arm.arm.fixed_links), [] if table is None else [table])
    base = arm.hand.hand.base_link
    mounted = [g for g, link in arm.hand.link_of_geometry.items() if link == base]
    exclude(of(*arm.arm.flange_links), mounted)
