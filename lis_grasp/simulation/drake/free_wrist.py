"""Free wrist: six joints that carry a hand anywhere, without an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import CollisionFilterManager, GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
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

from lis_grasp.geometry import make_pose
from lis_grasp.lifting.lift_gains import WRIST_DAMPING, WRIST_LIMITS, WRIST_STIFFNESS
from lis_grasp.lifting.wrist_trajectory import WristMotion, WristPath
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

_AXIS_NAMES = ("x", "y", "z")


class FreeWrist:
    """A wrist that flies freely: the `Carrier` of a hand without an arm.

    Its zero is the pose X_WB (4, 4) of the hand's base link in the grasp. The plant is not
    finalized yet.
    """

    def __init__(self, plant: MultibodyPlant, added: HandInPlant, X_WB: FloatArray) -> None:
        self._plant = plant
        self._wrist = add_wrist(
            plant,
            added,
            X_WB,
            stiffness=WRIST_STIFFNESS,
            damping=WRIST_DAMPING,
            limits=WRIST_LIMITS,
        )

    def connect(
        self,
        plant_context: Context,
        filters: CollisionFilterManager,
        carried: RigidBody,
        table: GeometryId,
    ) -> None:
        """Take the context of the finalized plant."""
        plant, instance = self._plant, self._wrist.instance
        self._context = plant_context
        self._port = plant.get_desired_state_input_port(instance)
        plant.get_actuation_input_port(instance).FixValue(plant_context, np.zeros(6))

    def place(self, displacement: FloatArray) -> None:
        """Set the wrist to a displacement (6,) without a rotation, at rest."""
        for joint, value in zip(self._wrist.joints[:3], displacement[:3], strict=True):
            joint.set_translation(self._context, value)
        self.command(displacement, np.zeros(6))

    def follow(self, path: WristPath, duration: float) -> WristMotion:
        """Return the motion along a path of a duration [s]."""
        return WristMotion(self.command, path, duration)

    def poses(self) -> dict[str, FloatArray]:
        """Return nothing: a free wrist has no bodies to see."""
        return {}

    def command(self, displacement: FloatArray, velocity: FloatArray) -> None:
        """Command the displacement (6,) from the zero, see `WristPath`, and its rate."""
        self._port.FixValue(self._context, np.concatenate([displacement, velocity]))


@dataclass(frozen=True, slots=True, eq=False)
class Wrist:
    """A 6-axis wrist that carries a hand.

    Its state is ``[x, y, z, roll, pitch, yaw]`` and rates, relative to the pose at which it was
    added, in W's axes. Its model instance has one desired-state port in that order.
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
    """Hold the hand's base link by three prismatic and three revolute joints under PD control.

    The wrist's zero is X_WB, shape (4, 4), far from its singularity (90 degrees of pitch) for any
    pose of the hand. Stiffness, damping and limits are those of the prismatic [N/m, N s/m, N] and
    of the revolute joints [N m/rad, N m s/rad, N m].
    """
    instance = plant.AddModelInstance("wrist")
    # Light against the hand, heavy enough to keep the solver's mass matrix well conditioned.
    carriage = SpatialInertia(0.1, np.zeros(3), UnitInertia.SolidSphere(0.05))
    frame = plant.AddFrame(
        FixedOffsetFrame("wrist_zero", plant.world_frame(), RigidTransform(X_WB[:3, 3]), instance)
    )
    joints: list[Joint] = []
    for kind, turning in ((PrismaticJoint, False), (RevoluteJoint, True)):
        # Yaw first, roll last: the usual roll-pitch-yaw about W's axes.
        order = slice(None, None, -1 if turning else 1)
        for axis, letter in zip(np.eye(3)[order], _AXIS_NAMES[order], strict=True):
            joint_name = f"wrist_{'turn' if turning else 'slide'}_{letter}"
            body = plant.AddRigidBody(f"{joint_name}_body", instance, carriage)
            joint = plant.AddJoint(kind(joint_name, frame, body.body_frame(), axis))
            frame = body.body_frame()
            joints.append(joint)
    base = added.bodies[added.hand.base_link]
    plant.WeldFrames(frame, base.body_frame(), RigidTransform(make_pose(X_WB[:3, :3])))
    in_order = (*joints[:3], *reversed(joints[3:]))  # x y z, then roll pitch yaw
    for joint in in_order:
        turning = isinstance(joint, RevoluteJoint)
        actuator = plant.AddJointActuator(joint.name(), joint, limits[turning])
        actuator.set_controller_gains(PdControllerGains(p=stiffness[turning], d=damping[turning]))
    plant.set_gravity_enabled(instance, False)
    return Wrist(instance, in_order)
