"""Arm in a Drake plant, with its hand: links, inverse dynamics, joint control, and its limits."""

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
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import (
    JacobianWrtVariable,
    MultibodyForces,
    PdControllerGains,
    SpatialInertia,
)
from pydrake.systems.framework import Context

from lis_grasp.arms.station import Station
from lis_grasp.arms.use import EFFORT_LIMIT, TABLE, ArmStoppedError, ArmUse
from lis_grasp.motion import OBJECT
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.object_mass import USUAL_FRICTION
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.contact_patches import patch_forces, point_forces
from lis_grasp.simulation.drake.hand_plant import LIFTING_SKIN, HandInPlant
from lis_grasp.simulation.drake.link_plant import LinksInPlant, add_links, add_skin
from lis_grasp.simulation.drake.object_plant import spatial_inertia
from lis_grasp.typing import FloatArray

# A joint that is at its limit for so long [s] no longer follows.
_SATURATED = 0.05


class ArmDynamics:
    """Inverse dynamics and the palm's kinematics of an arm with a hand, as its controller has them.

    The hand is one body in the posture q_hand, shape (K,): its fingers move little mass.
    """

    def __init__(self, station: Station, q_hand: FloatArray) -> None:
        plant, hand, arm = MultibodyPlant(0.0), station.hand, station.arm
        links = _add_arm_links(plant, arm, station.X_WA)
        instance = plant.AddModelInstance("hand")
        body = plant.AddRigidBody("hand", instance, hand_inertia(hand, q_hand))
        X_LB = RigidTransform(arm.X_LF @ station.mount.X_FB)
        plant.WeldFrames(links.bodies[arm.flange].body_frame(), body.body_frame(), X_LB)
        plant.Finalize()
        self._plant, self._context = plant, plant.CreateDefaultContext()
        self._frame, self._world = body.body_frame(), plant.world_frame()
        self._p_BH = np.asarray(hand.X_LH[:3, 3])
        self._X_BH = RigidTransform(hand.X_LH)
        self._forces = MultibodyForces(plant)

    def jacobians(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the palm's pose X_WH (4, 4) and Jacobian (6, J), linear rows first, in W."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, q)
        X_WB = self._frame.CalcPoseInWorld(context)
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self._frame, self._p_BH, self._world, self._world
        )
        return (X_WB @ self._X_BH).GetAsMatrix4(), np.concatenate([J[3:], J[:3]])

    def efforts(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Return the joint efforts (J,) of a motion: inverse dynamics with gravity and damping."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, q)
        plant.SetVelocities(context, qd)
        plant.CalcForceElementsContribution(context, self._forces)
        efforts: FloatArray = plant.CalcInverseDynamics(context, qdd, self._forces)
        return efforts

    def inertias(self, q: FloatArray) -> FloatArray:
        """Return the diagonal of the mass matrix, shape (J,) [kg m^2 or kg]."""
        self._plant.SetPositions(self._context, q)
        return np.diag(self._plant.CalcMassMatrix(self._context)).copy()


@dataclass(frozen=True, slots=True, eq=False)
class ArmInPlant:
    """An arm with its hand that `add_arm` has added to a plant."""

    arm: Arm
    hand: HandInPlant
    plant: MultibodyPlant
    links: LinksInPlant
    link_of_geometry: Mapping[GeometryId, str]
    dynamics: ArmDynamics

    def place(self, context: Context, q: FloatArray, qd: FloatArray) -> None:
        """Set joint positions and rates, shapes (J,)."""
        self.plant.SetPositions(context, self.links.instance, q)
        self.plant.SetVelocities(context, self.links.instance, qd)

    def command(self, context: Context, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> None:
        """Command positions, rates and the efforts of inverse dynamics with qdd, shapes (J,)."""
        plant, instance = self.plant, self.links.instance
        state = np.concatenate([q, qd])
        plant.get_desired_state_input_port(instance).FixValue(context, state)
        efforts = self.dynamics.efforts(q, qd, qdd)
        plant.get_actuation_input_port(instance).FixValue(context, efforts)


def add_arm(
    plant: MultibodyPlant, station: Station, hand: HandInPlant, q_hand: FloatArray
) -> ArmInPlant:
    """Add an arm as a model instance at its base, and weld the hand's base link to its flange.

    The joints get implicit PD control with the arm's stiffness, critically damped for the inertia
    at each joint in the home posture: rotors of large gears are most of it. Gravity acts on arm and
    hand. The control's model has the hand's mass in the posture q_hand (K,). The plant is not
    finalized yet.
    """
    arm, dynamics = station.arm, ArmDynamics(station, q_hand)
    links = _add_arm_links(plant, arm, station.X_WA)
    damping = 2.0 * np.sqrt(arm.stiffness * dynamics.inertias(arm.home))
    for j, joint in enumerate(links.joints):
        gains = PdControllerGains(p=arm.stiffness[j], d=damping[j])
        plant.GetJointActuatorByName(joint.name(), links.instance).set_controller_gains(gains)
    X_LB = RigidTransform(arm.X_LF @ station.mount.X_FB)
    plant.WeldFrames(links.bodies[arm.flange].body_frame(), hand.base.body_frame(), X_LB)
    skin = add_skin(plant, arm, links, friction=USUAL_FRICTION, modulus=LIFTING_SKIN)
    plant.set_gravity_enabled(hand.instance, True)
    return ArmInPlant(arm, hand, plant, links, skin, dynamics)


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

    def bodies(*links: str) -> list[GeometryId]:
        return [g for g, link in arm.link_of_geometry.items() if link in links]

    for first, second in sorted(arm.arm.self_collision_exclusions):
        exclude(bodies(first), bodies(second))
    exclude(bodies(*arm.arm.fixed_links), [] if table is None else [table])
    base = arm.hand.hand.base_link
    mounted = [g for g, link in arm.hand.link_of_geometry.items() if link == base]
    exclude(bodies(*arm.arm.flange_links), mounted)


def hand_inertia(hand: Hand, q: FloatArray) -> SpatialInertia:
    """Return the spatial inertia of a hand in a posture (J,), in its base link's frame."""
    poses = hand.forward_kinematics(hand.X_LH, q)  # in the base link's frame
    total = SpatialInertia.Zero()
    for link, inertial in hand.inertials.items():
        if inertial.mass > 0.0:
            X_BL = RigidTransform(poses[link])
            inertia_L = spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
            total += inertia_L.ReExpress(X_BL.rotation()).Shift(-X_BL.translation())
    return total


def _add_arm_links(plant: MultibodyPlant, arm: Arm, X_WA: FloatArray) -> LinksInPlant:
    """Add an arm's links, joints and motors, with its base link at X_WA (4, 4) in the world.

    Joints have the arm's damping, motors its effort limits and the inertia of their rotors.
    """
    links = add_links(plant, arm, plant.AddModelInstance("arm"))
    base = links.bodies[arm.base_link]
    plant.WeldFrames(plant.world_frame(), base.body_frame(), RigidTransform(X_WA))
    for j, joint in enumerate(links.joints):
        joint.set_default_damping_vector([arm.damping[j]])
        actuator = plant.AddJointActuator(joint.name(), joint, arm.effort_limits[j])
        actuator.set_default_rotor_inertia(arm.rotor_inertias[j])
        actuator.set_default_gear_ratio(1.0)
    return links


class ArmWatch:
    """Records how an arm's limits are used, and every unwanted contact, at each time step.

    Wanted are contacts of the object with fingertips and pads: links that carry a pad or lead in a
    probe posture, and those fixed to them.
    No other link of the hand should touch the object, none the table or a body beside the object,
    and a link of the arm nothing at all. While the hand is to be `free` of the object, even pads
    should not touch it. With `slides`, fingertips may touch the table. A contact of the arm ends
    the motion, and, where `object_ends` it, an unwanted one of the object or of a body beside it.
    """

    def __init__(
        self,
        scene: PlantScene,
        arm: ArmInPlant,
        *,
        stage: str,
        use: ArmUse | None = None,
        object_ends: bool = False,
        slides: bool = False,
    ) -> None:
        plant = scene.plant
        self.use = ArmUse() if use is None else use
        self.free, self._slides, self._stage = object_ends, slides, stage
        self._wanted = arm.hand.hand.fingertip_links
        self._plant, self._context, self._arm = plant, scene.context, arm
        self._table, self._object_ends = scene.table, object_ends
        beside = scene.surroundings
        self._beside = {} if beside is None else beside.name_of_geometry
        ignore_mounting(scene.filters, arm, scene.table)
        self._longest = round(_SATURATED / plant.time_step())
        self._saturated = np.zeros(len(arm.arm.joint_names), dtype=int)
        self._efforts = plant.get_net_actuation_output_port(arm.links.instance)
        self._results = plant.get_contact_results_output_port()

    def check(self) -> None:
        """Record the step that was just taken; raise `ArmStoppedError` if the motion must end."""
        use, arm = self.use, self._arm.arm
        use.steps += 1
        effort = np.abs(self._efforts.Eval(self._context)) / arm.effort_limits
        rates = self._plant.GetVelocities(self._context, self._arm.links.instance)
        speed = np.abs(rates) / arm.velocity_limits
        if effort.max() > use.effort:
            use.effort = float(effort.max())
            use.effort_joint = arm.joint_names[int(effort.argmax())]
        if speed.max() > use.speed:
            use.speed = float(speed.max())
            use.speed_joint = arm.joint_names[int(speed.argmax())]
        self._saturated = np.where(effort > EFFORT_LIMIT, self._saturated + 1, 0)
        if self._collides():
            raise ArmStoppedError("arm_collision")
        if self._saturated.max() >= self._longest:
            raise ArmStoppedError("torque_limit")

    def _collides(self) -> bool:
        """Count unwanted contacts; return whether one of them ends the motion."""
        results: ContactResults = self._results.Eval(self._context)
        hand, ends = self._arm.hand.link_of_geometry, False
        for first, second, force in patch_forces(results):
            if self._table not in (first, second) and (first in hand or second in hand):
                self.use.contact_force = max(self.use.contact_force, force)
            ends |= self._count(first, second, force)
        for first, second, force in point_forces(results):
            ends |= self._count(first, second, force)
        return ends

    def _count(self, first: GeometryId, second: GeometryId, force: float) -> bool:
        """Count a contact with a force [N] if it is unwanted; return whether it ends the motion."""
        arm, hand = self._arm.link_of_geometry, self._arm.hand.link_of_geometry
        of_arm = first in arm or second in arm
        if not of_arm and first not in hand and second not in hand:
            return False
        # The arm or the hand is named first.
        pair = sorted(
            (first, second), key=lambda g: (g not in arm and g not in hand, self._name(g))
        )
        names = [self._name(geometry) for geometry in pair]
        wanted = self._slides if names[1] == TABLE else names[1] == OBJECT and not self.free
        wanted = wanted and pair[1] not in self._beside
        if not of_arm and names[0] in self._wanted and wanted:
            return False
        together = " with ".join(names)
        self.use.contacts[together] = self.use.contacts.get(together, 0) + 1
        self.use.stages.setdefault(together, self._stage)
        self.use.forces[together] = max(force, self.use.forces.get(together, 0.0))
        return of_arm or (self._object_ends and (OBJECT in names or pair[1] in self._beside))

    def _name(self, geometry: GeometryId) -> str:
        if geometry == self._table:
            return TABLE
        arm, hand = self._arm.link_of_geometry, self._arm.hand.link_of_geometry
        if geometry in arm:
            return f"arm's {arm[geometry]}"
        return hand.get(geometry) or self._beside.get(geometry, OBJECT)
