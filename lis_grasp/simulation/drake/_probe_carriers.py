"""Carriers of a hand on a probe's straight motion: a rail, and an arm."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    QuaternionFloatingJoint,
    SpatialInertia,
    UnitInertia,
)

from lis_grasp.arms.station import Station
from lis_grasp.arms.use import ArmStoppedError, ArmUse
from lis_grasp.geometry import inverse_pose, make_pose
from lis_grasp.lifting.wrist_path import joint_rates, posture_near
from lis_grasp.probing.approach_planner import rotation_to_x
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.arm_plant import ArmWatch, add_arm
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

# The rail that carries the hand: stiff to follow the motion, limited in force to stop at a touch.
_STIFFNESS = 20_000.0  # [N/m]
_DAMPING = 600.0  # [N s/m]
_FORCE = 60.0  # [N]

# A reversal at a touch accelerates the palm by this [m/s^2]; more exceeds effort limits.
_ACCELERATION = 4.0
# Largest fraction of a joint's speed limit that is commanded.
_LARGEST_SPEED = 0.9
# Spacing of the postures by which the arm comes to where its simulation starts [m].
_SPACING = 0.01


class ProbeRail:
    """A rail that carries the hand's base link along a straight line anywhere, without turning.

    The plant is not finalized yet.
    """

    def __init__(self, plant: MultibodyPlant, hand: HandInPlant) -> None:
        self._plant = plant
        self._instance = plant.AddModelInstance("arm")
        rail, carriage = (
            plant.AddRigidBody(
                name,
                self._instance,
                SpatialInertia(0.5, np.zeros(3), UnitInertia.SolidSphere(0.05)),
            )
            for name in ("rail", "carriage")
        )
        self._rail = plant.AddJoint(
            QuaternionFloatingJoint("rail", plant.world_frame(), rail.body_frame())
        )
        self._slider = plant.AddJoint(
            PrismaticJoint("slider", rail.body_frame(), carriage.body_frame(), np.eye(3)[0])
        )
        plant.AddJointActuator("slider", self._slider, _FORCE).set_controller_gains(
            PdControllerGains(p=_STIFFNESS, d=_DAMPING)
        )
        self._mount = plant.AddJoint(
            QuaternionFloatingJoint("mount", carriage.body_frame(), hand.base.body_frame())
        )
        plant.set_gravity_enabled(self._instance, False)

    def connect(self, scene: PlantScene) -> None:
        """Take the scene of the finalized plant."""
        self._context = scene.context
        self._port = self._plant.get_desired_state_input_port(self._instance)

    def place(self, X_WB: FloatArray, direction: FloatArray, q: FloatArray | None) -> None:
        """Begin at a pose X_WB (4, 4) of the base link, to move along a direction (3,) in W.

        `q` (J,) are an arm's joint positions there.
        """
        context = self._context
        for joint in (self._rail, self._mount):
            joint.Unlock(context)
        self._slider.set_translation(context, 0.0)
        X_WR = make_pose(rotation_to_x(direction).T)
        self._rail.SetPose(context, _rigid(X_WR))
        self._mount.SetPose(context, _rigid(inverse_pose(X_WR) @ X_WB))
        self._rail.Lock(context)
        self._mount.Lock(context)

    def start(self, travelled: float, speed: float) -> None:
        """Set the hand `travelled` [m] along its motion, at a speed [m/s], without lag."""
        self._slider.set_translation(self._context, travelled)
        self._slider.set_translation_rate(self._context, speed)
        self.command(travelled, speed)

    def command(self, travelled: float, speed: float) -> None:
        """Command a position [m] along the motion and a speed [m/s].

        It stops where the line began: what is behind is not known to be free.
        """
        behind = travelled < 0.0
        self._port.FixValue(self._context, [0.0, 0.0] if behind else [travelled, speed])

    def check(self) -> None:
        """Do nothing: a rail has no limits to exceed."""


class ProbeArm:
    """An arm that carries the hand on probes, as `ProbeRail` does.

    Differential inverse kinematics: in each step the joints get the positions and rates of the
    palm's line, and the efforts of inverse dynamics. The arm stops where the line began: what is
    behind is not known to be free. The plant is not finalized yet. What is demanded of the arm is
    added to `use`.
    """

    def __init__(
        self, plant: MultibodyPlant, hand: HandInPlant, station: Station, use: ArmUse | None
    ) -> None:
        posture = next(iter(station.hand.probe_postures.values())).joint_positions
        self._plant, self._use = plant, use
        self._arm = add_arm(plant, station, hand, posture)

    def connect(self, scene: PlantScene) -> None:
        """Take the scene of the finalized plant."""
        self._context = scene.context
        self._fingers = self._plant.get_actuation_input_port(self._arm.hand.instance)
        self._watch = ArmWatch(scene, self._arm, stage="touch", use=self._use)

    def place(self, X_WB: FloatArray, direction: FloatArray, q: FloatArray | None) -> None:
        """Begin at a pose X_WB (4, 4) of the base link, with the joints near q (J,)."""
        assert q is not None
        self._X_WH = X_WB @ self._arm.hand.hand.X_LH
        self._direction = direction
        self._q = self._posture(q, 0.0)

    def start(self, travelled: float, speed: float) -> None:
        """Set the arm to where the hand has travelled so far [m], at a speed [m/s]."""
        for part in np.linspace(0.0, travelled, int(np.ceil(travelled / _SPACING)) + 1)[1:]:
            self._q = self._posture(self._q, float(part))
        self._travelled, self._speed = travelled, speed
        self._qd = self._rates(self._q, speed)
        self._arm.place(self._context, self._q, self._qd)
        efforts = self._arm.hand.weight_efforts(self._plant, self._context)
        self._fingers.FixValue(self._context, efforts)

    def command(self, travelled: float, speed: float) -> None:
        """Command the next step of a motion at a speed [m/s]; the arm reverses within its means.

        It stops where the line began.
        """
        step = self._plant.time_step()
        change = _ACCELERATION * step
        speed = float(np.clip(speed, self._speed - change, self._speed + change))
        speed = max(speed, -float(np.sqrt(2.0 * _ACCELERATION * max(self._travelled, 0.0))))
        # Nearly stretched, a joint moves fast for a slow palm.
        rates = np.abs(self._rates(self._q, 1.0)) / self._arm.arm.velocity_limits
        fastest = _LARGEST_SPEED / float(rates.max())
        speed = float(np.clip(speed, -fastest, fastest))
        self._travelled, self._speed = self._travelled + step * speed, speed
        self._q = self._posture(self._q, self._travelled)
        before, self._qd = self._qd, self._rates(self._q, speed)
        self._arm.command(self._context, self._q, self._qd, (self._qd - before) / step)

    def check(self) -> None:
        """Check the time step that was just taken; raise `ArmStoppedError` if the motion ends."""
        self._watch.check()

    def _posture(self, q: FloatArray, travelled: float) -> FloatArray:
        X_WH = self._X_WH.copy()
        X_WH[:3, 3] += travelled * self._direction
        posture = posture_near(self._arm.dynamics, q, X_WH)
        if posture is None or not self._arm.arm.within_limits(posture):
            raise ArmStoppedError("out_of_arm_reach")
        return posture

    def _rates(self, q: FloatArray, speed: float) -> FloatArray:
        velocity = np.append(speed * self._direction, np.zeros(3))
        return joint_rates(self._arm.dynamics, q, velocity)


def _rigid(X: FloatArray) -> RigidTransform:
    return RigidTransform(RotationMatrix(X[:3, :3]), X[:3, 3])
