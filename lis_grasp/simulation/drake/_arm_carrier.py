"""Arm as the carrier of a hand: joint paths along palm paths, with feedforward efforts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant

from lis_grasp.arms.trajectory import JointTrajectory, minimum_jerk
from lis_grasp.arms.use import ArmShake, ArmStoppedError, ArmUse
from lis_grasp.geometry import cross
from lis_grasp.lifting.scene import Carrier, CarrierMotion
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import PalmPath, WristPath, joint_path_along, use_of_limits
from lis_grasp.motion import arm_body
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.arm_plant import ArmWatch, add_arm
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

# A shake uses at most this fraction of the arm's speed, acceleration and effort limits.
_SHAKE_FRACTION = 0.9
_LESS = 0.98


class ArmCarrier(Carrier):
    """An arm that carries the hand of a lift.

    Palm paths become joint paths beforehand. The joints get positions, rates, and the efforts of
    inverse dynamics. Paths take longer where the arm's limits, times `speed_fraction`, need it. A
    shake is scaled down to the limits; the rest of its acceleration acts as forces on the object.
    The control's model has the hand's mass in the pregrasp. The plant is not finalized yet.
    """

    def __init__(self, plant: MultibodyPlant, hand: HandInPlant, setup: LiftSetup) -> None:
        assert setup.arm is not None
        self._plant, self._X_WB, self._transit = plant, setup.X_WB, setup.arm.transit
        self._arm = add_arm(plant, setup.arm.station, hand, setup.grasp.pregrasp_positions)
        self._q = self._transit.positions[0]
        self._slides = setup.slides_on_table

    def connect(self, scene: PlantScene) -> None:
        """Take the scene of the finalized plant."""
        self._context, self._carried = scene.context, scene.object.body
        self._forces = self._plant.get_applied_spatial_force_input_port()
        self._forces.FixValue(self._context, [])
        self._pushing = False
        self._watch = ArmWatch(scene, self._arm, stage="lift", slides=self._slides)

    @property
    def use(self) -> ArmUse:
        """What was demanded of the arm so far."""
        return self._watch.use

    def place(self, displacement: FloatArray) -> None:
        """Set the arm to its home, the start of the transit, at rest."""
        zero = np.zeros(len(self._q))
        self._arm.place(self._context, self._q, zero)
        self._command(self._q, zero, zero)

    def wait(self, displacement: FloatArray, duration: float) -> CarrierMotion:
        """Return the motion that stays at the posture that was commanded last."""
        times, rest = np.array([0.0, duration]), np.zeros((2, len(self._q)))
        q, names = np.array([self._q, self._q]), self._arm.arm.joint_names
        return self._motion(JointTrajectory(names, times, q, rest, rest))

    def bring(self) -> CarrierMotion:
        """Return the transit from the home posture to where the approach begins."""
        self._watch.free = True
        return self._motion(self._transit)

    def expect_contact(self) -> None:
        """Let fingertips and pads touch the object from now on."""
        self._watch.free = False

    def go_home(self) -> CarrierMotion:
        """Return the motion from where the approach begins back to the home posture."""
        self._watch.free = True
        back = self._transit.reversed()
        # A redundant arm may have come back in a posture a little off: that is made up on the way.
        parts = np.linspace(0.0, 1.0, len(back.times))
        left = 1.0 - np.array([minimum_jerk(part)[0] for part in parts])
        q = back.positions + left[:, None] * (self._q - back.positions[0])
        return self._motion(replace(back, positions=q))

    def follow(self, path: WristPath, duration: float) -> CarrierMotion:
        """Return the motion along a path, slower where the arm's limits need it."""
        joints = self._track(path, duration)
        arm = self._arm.arm
        speed, acceleration = use_of_limits(joints, arm) / arm.speed_fraction
        slower = max(speed, np.sqrt(acceleration))
        return self._motion(joints if slower <= 1.0 else self._track(path, duration, slower))

    def shake(
        self, path_at: Callable[[float], WristPath], acceleration: float, duration: float, name: str
    ) -> CarrierMotion:
        """Return the motion of a shake, and forces on the object for what the arm cannot make."""
        fraction = 1.0
        while True:  # nearly linear in the amplitude, so that two rounds suffice
            joints = self._track(path_at(fraction * acceleration), duration)
            use = max(*use_of_limits(joints, self._arm.arm), self._effort_of(joints))
            if use <= _SHAKE_FRACTION:
                break
            fraction *= _LESS * _SHAKE_FRACTION / use
        self._watch.use.shakes.append(ArmShake(name, acceleration, fraction * acceleration))
        missing = None if fraction == 1.0 else path_at((1.0 - fraction) * acceleration)
        return self._motion(joints, missing)

    def check(self) -> None:
        """Check the step that was just taken."""
        commanded, _ = self._arm.dynamics.jacobians(self._q)
        error = commanded[:3, 3] - self._arm.hand.X_WH(self._context)[:3, 3]
        use = self._watch.use
        use.palm_error = max(use.palm_error, float(np.linalg.norm(error)))
        self._watch.check()

    def poses(self) -> dict[str, FloatArray]:
        """Return the poses (4, 4) of the arm's links, by the names of `arm_body`."""
        arm = self._arm
        return {arm_body(link): arm.links.X_WL(self._context, link) for link in arm.arm.links}

    def _motion(self, path: JointTrajectory, missing: WristPath | None = None) -> CarrierMotion:
        """Return the motion along a joint path, with forces for what the arm does not make."""
        step = float(path.times[1])

        def command(time: float) -> None:
            n = min(round(time / step), len(path.times) - 1)
            self._command(path.positions[n], path.velocities[n], path.accelerations[n])
            if missing is not None:
                self._accelerate_object(*_acceleration(missing, time, step))
            elif self._pushing:
                self._forces.FixValue(self._context, [])
                self._pushing = False

        return CarrierMotion(path.duration, command)

    def _command(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> None:
        """Command joint positions, rates and accelerations, shapes (J,)."""
        self._q = q
        self._arm.command(self._context, q, qd, qdd)

    def _accelerate_object(self, acceleration: FloatArray, rate: FloatArray) -> None:
        """Push the object as if the palm accelerated, by inertial forces, until the next call.

        `acceleration` (6,) is that of the hand's base link, linear and angular, `rate` (6,) its
        velocity, all in W.
        """
        body = self._carried
        X = body.EvalPoseInWorld(self._context)
        inertia = body.default_spatial_inertia()
        arm_W = X.rotation() @ inertia.get_com()
        hand = self._arm.hand
        p_BC = X.translation() + arm_W - hand.X_WL(self._context, hand.hand.base_link)[:3, 3]
        alpha, omega = acceleration[3:], rate[3:]
        field = acceleration[:3] + cross(alpha, p_BC) + cross(omega, cross(omega, p_BC))
        central = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
        I_W = central.ReExpress(X.rotation()).CopyToFullMatrix3()
        load = ExternallyAppliedSpatialForce()
        load.body_index, load.p_BoBq_B = body.index(), inertia.get_com()
        moment = -(I_W @ alpha + cross(omega, I_W @ omega))
        load.F_Bq_W = SpatialForce(tau=moment, f=-inertia.get_mass() * field)
        self._forces.FixValue(self._context, [load])
        self._pushing = True

    def _track(self, path: WristPath, duration: float, stretch: float = 1.0) -> JointTrajectory:
        arm = self._arm.arm
        palm = PalmPath(self._X_WB, self._arm.hand.hand.X_LH, path)
        step = self._plant.time_step()
        joints = joint_path_along(
            self._arm.dynamics, arm, self._q, palm, duration=duration, step=step, stretch=stretch
        )
        if joints is None:
            raise ArmStoppedError("out_of_arm_reach")
        return joints

    def _effort_of(self, path: JointTrajectory) -> float:
        """Return the largest fraction of the effort limits that a joint path needs."""
        samples = zip(path.positions, path.velocities, path.accelerations, strict=True)
        efforts = [self._arm.dynamics.efforts(q, qd, qdd) for q, qd, qdd in samples]
        return float(np.max(np.abs(efforts) / self._arm.arm.effort_limits))


def _acceleration(path: WristPath, time: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return a path's acceleration, by differences of its rate, and its rate, shapes (6,)."""
    before, after = path(time - 0.5 * step)[1], path(time + 0.5 * step)[1]
    return (after - before) / step, 0.5 * (before + after)
