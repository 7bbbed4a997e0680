"""Free wrist: six joints that carry a hand anywhere, without an arm."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Joint,
    PdControllerGains,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
    UnitInertia,
)

from lis_grasp.geometry import make_pose
from lis_grasp.lifting.scene import FreeWrist
from lis_grasp.lifting.setup import WRIST_DAMPING, WRIST_LIMITS, WRIST_STIFFNESS
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

_AXIS_NAMES = ("x", "y", "z")


class WristInPlant(FreeWrist):
    """Six joints under PD control that hold the hand's base link: `LiftCarrier` without an arm.

    The displacement ``[x, y, z, roll, pitch, yaw]`` is relative to X_WB, shape (4, 4), the pose of
    the base link in the grasp, in W's axes. There the wrist is far from its singularity, 90 degrees
    of pitch, for any pose of the hand. The plant is not finalized yet.
    """

    def __init__(self, plant: MultibodyPlant, hand: HandInPlant, X_WB: FloatArray) -> None:
        super().__init__(self._command_state)
        self._plant, self._instance = plant, plant.AddModelInstance("wrist")
        # Light against the hand, heavy enough to keep the solver's mass matrix well conditioned.
        carriage = SpatialInertia(0.1, np.zeros(3), UnitInertia.SolidSphere(0.05))
        X_WZ = RigidTransform(X_WB[:3, 3])
        frame = plant.AddFrame(
            FixedOffsetFrame("wrist_zero", plant.world_frame(), X_WZ, self._instance)
        )
        joints: list[Joint] = []
        for kind, turning in ((PrismaticJoint, False), (RevoluteJoint, True)):
            # Yaw first, roll last: the usual roll-pitch-yaw about W's axes.
            order = slice(None, None, -1 if turning else 1)
            for axis, letter in zip(np.eye(3)[order], _AXIS_NAMES[order], strict=True):
                name = f"wrist_{'turn' if turning else 'slide'}_{letter}"
                body = plant.AddRigidBody(f"{name}_body", self._instance, carriage)
                joints.append(plant.AddJoint(kind(name, frame, body.body_frame(), axis)))
                frame = body.body_frame()
        X_ZB = RigidTransform(make_pose(X_WB[:3, :3]))
        plant.WeldFrames(frame, hand.base.body_frame(), X_ZB)
        self._joints = (*joints[:3], *reversed(joints[3:]))  # x y z, then roll pitch yaw
        for joint in self._joints:
            turning = isinstance(joint, RevoluteJoint)
            actuator = plant.AddJointActuator(joint.name(), joint, WRIST_LIMITS[turning])
            gains = PdControllerGains(p=WRIST_STIFFNESS[turning], d=WRIST_DAMPING[turning])
            actuator.set_controller_gains(gains)
        plant.set_gravity_enabled(self._instance, False)

    def connect(self, scene: PlantScene) -> None:
        """Take the scene of the finalized plant."""
        self._context = scene.context
        self._port = self._plant.get_desired_state_input_port(self._instance)
        efforts = self._plant.get_actuation_input_port(self._instance)
        efforts.FixValue(self._context, np.zeros(6))

    def place(self, displacement: FloatArray) -> None:
        """Set the wrist to a displacement (6,) without a rotation, at rest."""
        for joint, value in zip(self._joints[:3], displacement[:3], strict=True):
            joint.set_translation(self._context, value)
        self._command_state(displacement, np.zeros(6))

    def check(self) -> None:
        """Do nothing: a free wrist has no limits to exceed."""

    def poses(self) -> dict[str, FloatArray]:
        """Return nothing: a free wrist has no bodies to see."""
        return {}

    def _command_state(self, displacement: FloatArray, velocity: FloatArray) -> None:
        self._port.FixValue(self._context, np.concatenate([displacement, velocity]))
