"""Arm as the carrier of a hand: joint paths along palm paths, with feedforward efforts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import CollisionFilterManager, GeometryId
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context

from lis_grasp.geometry import cross
from lis_grasp.lifting.arm_lift import ArmLift
from lis_grasp.lifting.arm_use import ArmShake, ArmUse
from lis_grasp.lifting.joint_path import JointPath, PalmPath, joint_path_along
from lis_grasp.lifting.wrist_trajectory import WristPath, minimum_jerk
from lis_grasp.motion import arm_body
from lis_grasp.simulation.drake.arm_dynamics import ArmDynamics
from lis_grasp.simulation.drake.arm_plant import add_arm, ignore_mounting
from lis_grasp.simulation.drake.arm_watch import ArmStoppedError, ArmWatch
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

# Peak acceleration [m/s^2] -> path that shakes with it.
ShakeWith = Callable[[float], WristPath]

# A shake uses at most this fraction of the arm's speed, acceleration and effort limits.
_SHAKE_FRACTION, _LESS = 0.9, 0.98


@dataclass(frozen=True, slots=True, eq=False)
class ArmMotion:
    """Motion of an arm along a joint path, with forces on the object for what it does not make."""

    carrier: ArmCarrier
    path: JointPath
    missing: WristPath | None = None  # the acceleration that the arm does not make

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return self.path.duration

    def command(self, time: float) -> None:
        """Command the sample at a time since the start [s]."""
        path = self.path
        n = min(round(time / path.step), len(path.q) - 1)
        self.carrier.command(path.q[n], path.qd[n], path.qdd[n])
        if self.missing is None:
            self.carrier.release_object()
        else:
            self.carrier.accelerate_object(*_acceleration(self.missing, time, path.step))


class ArmCarrier:
    """An arm that carries the hand of a lift; see `Carrier`.

    Palm paths become joint paths beforehand. The joints get positions, rates, and the efforts of
    inverse dynamics. Paths take longer where the arm's limits, times `speed_fraction`, need it. A
    shake is scaled down to the limits; the rest of its acceleration acts as forces on the object.

    Parameters
    ----------
    plant
        The plant, not finalized yet.
    added
        The hand in it.
    lift
        The arm, and its transit to where the approach begins.
    X_WB
        Shape (4, 4): the hand's base link in the grasp.
    q_hand
        Posture of the hand, shape (J,), in which the control's model has its mass.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        added: HandInPlant,
        lift: ArmLift,
        X_WB: FloatArray,
        q_hand: FloatArray,
    ) -> None:
        station = lift.station
        arm, X_FB = station.arm, station.mount.X_FB
        self._plant, self._X_WB, self._transit = plant, X_WB, lift.transit
        self._dynamics = ArmDynamics(arm, added.hand, station.X_WA, X_FB, q_hand)
        self._arm = add_arm(
            plant,
            arm,
            added,
            X_WA=station.X_WA,
            X_FB=X_FB,
            dynamics=self._dynamics,
        )
        self._q = lift.transit.q[0]
        self._limits = arm.velocity_limits, arm.acceleration_limits

    def connect(
        self,
        plant_context: Context,
        filters: CollisionFilterManager,
        carried: RigidBody,
        table: GeometryId,
    ) -> None:
        """Take the context of the finalized plant, its collision filters, object and table."""
        plant, instance = self._plant, self._arm.instance
        self._context, self._carried = plant_context, carried
        self._states = plant.get_desired_state_input_port(instance)
        self._efforts = plant.get_actuation_input_port(instance)
        self._forces = plant.get_applied_spatial_force_input_port()
        self._forces.FixValue(plant_context, [])
        self._pushing = False
        ignore_mounting(filters, self._arm, table)
        self._watch = ArmWatch(plant, plant_context, self._arm, table=table)

    @property
    def use(self) -> ArmUse:
        """What was demanded of the arm so far."""
        return self._watch.use

    def place(self, displacement: FloatArray) -> None:
        """Set the arm to its home, the start of the transit, at rest."""
        zero = np.zeros(len(self._q))
        self._plant.SetPositions(self._context, self._arm.instance, self._q)
        self._plant.SetVelocities(self._context, self._arm.instance, zero)
        self.command(self._q, zero, zero)

    def rest(self, duration: float) -> ArmMotion:
        """Return the motion that stays at the posture that was commanded last."""
        zero = np.zeros((2, len(self._q)))
        return ArmMotion(self, JointPath(duration, np.array([self._q, self._q]), zero, zero))

    def bring(self) -> ArmMotion:
        """Return the transit from the home posture to where the approach begins."""
        return ArmMotion(self, self._transit)

    def go_home(self) -> ArmMotion:
        """Return the motion from where the approach begins back to the home posture."""
        transit = self._transit
        # A redundant arm may have come back in a posture a little off: that is made up on the way.
        left = 1.0 - np.array([minimum_jerk(part)[0] for part in np.linspace(0, 1, len(transit.q))])
        q = transit.q[::-1] + left[:, None] * (self._q - transit.q[-1])
        return ArmMotion(self, JointPath(transit.step, q, -transit.qd[::-1], transit.qdd[::-1]))

    def follow(self, path: WristPath, duration: float) -> ArmMotion:
        """Return the motion along a path, slower where the arm's limits need it."""
        joints = self._track(path, duration)
        speed, acceleration = joints.use_of(*self._limits) / self._arm.arm.speed_fraction
        slower = max(speed, np.sqrt(acceleration))
        return ArmMotion(self, joints if slower <= 1.0 else self._track(path, duration, slower))

    def shake(
        self, shake_with: ShakeWith, acceleration: float, duration: float, direction: str
    ) -> ArmMotion:
        """Return the motion of a shake, and forces on the object for what the arm cannot make."""
        fraction = 1.0
        while True:  # nearly linear in the amplitude, so that two rounds suffice
            joints = self._track(shake_with(fraction * acceleration), duration)
            use = max(*joints.use_of(*self._limits), self._effort_of(joints))
            if use <= _SHAKE_FRACTION:
                break
            fraction *= _LESS * _SHAKE_FRACTION / use
        self._watch.use.shakes.append(ArmShake(direction, acceleration, fraction * acceleration))
        missing = None if fraction == 1.0 else shake_with((1.0 - fraction) * acceleration)
        return ArmMotion(self, joints, missing)

    def expect_contact(self, expected: bool) -> None:
        """Say whether fingertips may touch the object from now on; see `ArmWatch`."""
        self._watch.free = not expected

    def check(self) -> None:
        """Check the step that was just taken."""
        commanded, _ = self._dynamics.jacobians(self._q)
        error = commanded[:3, 3] - self._arm.hand.X_WH(self._context)[:3, 3]
        use = self._watch.use
        use.palm_error = max(use.palm_error, float(np.linalg.norm(error)))
        self._watch.check()

    def poses(self) -> dict[str, FloatArray]:
        """Return the poses (4, 4) of the arm's links, by the names of `arm_body`."""
        arm = self._arm
        return {arm_body(link): arm.X_WL(self._context, link) for link in arm.arm.links}

    def command(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> None:
        """Command joint positions, rates and accelerations, shapes (J,)."""
        self._q = q
        self._states.FixValue(self._context, np.concatenate([q, qd]))
        self._efforts.FixValue(self._context, self._dynamics.efforts(q, qd, qdd))

    def accelerate_object(self, acceleration: FloatArray, rate: FloatArray) -> None:
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

    def release_object(self) -> None:
        """End the inertial forces on the object."""
        if self._pushing:
            self._forces.FixValue(self._context, [])
            self._pushing = False

    def _track(self, path: WristPath, duration: float, stretch: float = 1.0) -> JointPath:
        arm = self._arm.arm
        palm = PalmPath(self._X_WB, self._arm.hand.hand.X_LH, path)
        joints = joint_path_along(
            self._dynamics,
            self._q,
            arm.lower,
            arm.upper,
            palm,
            duration=duration,
            step=self._plant.time_step(),
            stretch=stretch,
        )
        if joints is None:
            raise ArmStoppedError("out_of_arm_reach")
        return joints

    def _effort_of(self, path: JointPath) -> float:
        """Return the largest fraction of the effort limits that a joint path needs."""
        efforts = [self._dynamics.efforts(*s) for s in zip(path.q, path.qd, path.qdd, strict=True)]
        return float(np.max(np.abs(efforts) / self._arm.arm.effort_limits))


def _acceleration(path: WristPath, time: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return a path's acceleration, by differences of its rate, and its rate, shapes (6,)."""
    before, after = path(time - 0.5 * step)[1], path(time + 0.5 * step)[1]
    return (after - before) / step, 0.5 * (before + after)
