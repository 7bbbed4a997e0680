"""Rigid-body dynamics of an arm with its hand, as its controller knows them."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces, SpatialInertia

from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.link_tree_plant import LinksInPlant, add_links
from lis_grasp.simulation.drake.object_plant import spatial_inertia
from lis_grasp.typing import FloatArray


def add_arm_links(plant: MultibodyPlant, arm: Arm, X_WA: FloatArray) -> LinksInPlant:
    """Add an arm's links, joints and motors, with its base link at X_WA (4, 4) in the world.

    Joints have the arm's damping, motors its effort limits and the inertia of their rotors.
    """
    instance = plant.AddModelInstance("arm")
    added = add_links(plant, arm, instance)
    base = added.bodies[arm.base_link]
    plant.WeldFrames(plant.world_frame(), base.body_frame(), RigidTransform(X_WA))
    for j, joint in enumerate(added.joints):
        joint.set_default_damping_vector([arm.damping[j]])
        actuator = plant.AddJointActuator(joint.name(), joint, arm.effort_limits[j])
        actuator.set_default_rotor_inertia(arm.rotor_inertias[j])
        actuator.set_default_gear_ratio(1.0)
    return added


class ArmDynamics:
    """Inverse dynamics and the palm's kinematics of an arm that carries a hand.

    The hand is one body in the posture q, shape (J,): its fingers move little mass.

    Parameters
    ----------
    arm, hand
        The robot.
    X_WA, X_FB
        Shape (4, 4): the arm's base link in the world, the hand's base link in the flange frame.
    q_hand
        Posture of the hand, shape (J,).
    """

    def __init__(
        self, arm: Arm, hand: Hand, X_WA: FloatArray, X_FB: FloatArray, q_hand: FloatArray
    ) -> None:
        plant = MultibodyPlant(0.0)
        added = add_arm_links(plant, arm, X_WA)
        X_LB = RigidTransform(arm.X_LF @ X_FB)
        instance = plant.AddModelInstance("hand")
        body = plant.AddRigidBody("hand", instance, hand_inertia(hand, q_hand))
        plant.WeldFrames(added.bodies[arm.flange].body_frame(), body.body_frame(), X_LB)
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


def hand_inertia(hand: Hand, q: FloatArray) -> SpatialInertia:
    """Return the spatial inertia of a hand in a posture (J,), in its base link's frame."""
    poses = hand.forward_kinematics(hand.X_LH, q)  # in the base link's frame
    total = SpatialInertia.Zero()
    for link, inertial in hand.inertials.items():
        if inertial.mass > 0.0:
            X_BL = RigidTransform(poses[link])
            of_link = spatial_inertia(inertial.mass, inertial.center_L, inertial.inertia_L)
            total += of_link.ReExpress(X_BL.rotation()).Shift(-X_BL.translation())
    return total
