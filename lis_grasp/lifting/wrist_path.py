"""Paths of the palm in a lift, minimum-jerk lines and shakes; joint paths of an arm along them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.arms.trajectory import JointTrajectory, minimum_jerk
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.pose_ik import damped_step, pose_error
from lis_grasp.typing import FloatArray

# Time [s] -> displacement (6,) and its rate (6,): x, y, z [m], roll, pitch, yaw [rad], in W.
WristPath = Callable[[float], tuple[FloatArray, FloatArray]]

# Newton steps a sample; two suffice from the sample before.
_NEWTON_STEPS = 3
# A sample this near its pose [m, and rad] is exact; one this far has none: it is out of reach.
_EXACT = 1e-9
_TOLERANCE = 1e-5
# Regularisation of the pseudoinverse, as a fraction of the squared singular values [1].
_DAMPING = 1e-6


def rest_at(place: FloatArray) -> WristPath:
    """Return a path that stays at a displacement, shape (6,)."""
    return lambda time: (place, np.zeros(6))


def line(start: FloatArray, end: FloatArray, duration: float) -> WristPath:
    """Return a straight path from rest at `start` to rest at `end`, shapes (6,)."""

    def path(time: float) -> tuple[FloatArray, FloatArray]:
        part, rate = minimum_jerk(time / duration)
        return start + part * (end - start), rate / duration * (end - start)

    return path


def shake_about(
    place: FloatArray, direction: FloatArray, acceleration: float, *, frequency: float, cycles: int
) -> WristPath:
    """Return a path that shakes about a displacement (6,) along a direction (6,).

    A sine of the given frequency [Hz], faded in and out over one period each: it is at rest before
    time 0 and after `cycles / frequency`. Scaled so that its peak acceleration along the direction
    is `acceleration`: [m/s^2] along a unit axis; for a rotation, a tangential acceleration if the
    direction is a unit axis over an arm [1/m]. There are at least 2 cycles.
    """
    amplitude = acceleration / (_unit_shake_acceleration(cycles) * frequency**2)

    def path(time: float) -> tuple[FloatArray, FloatArray]:
        displacement, velocity = _unit_shake(time * frequency, cycles)
        return (
            place + amplitude * displacement * direction,
            amplitude * frequency * velocity * direction,
        )

    return path


def _unit_shake(turns: float, cycles: int) -> tuple[float, float]:
    if not 0.0 < turns < cycles:
        return 0.0, 0.0
    rising = turns <= cycles / 2.0
    window, slope = minimum_jerk(turns if rising else cycles - turns)
    slope = slope if rising else -slope
    angle = 2.0 * np.pi * turns
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))
    return window * sine, slope * sine + 2.0 * np.pi * window * cosine


@lru_cache
def _unit_shake_acceleration(cycles: int) -> float:
    """Return the peak acceleration of the unit shake, by differences of its velocity."""
    turns = np.linspace(0.0, cycles, 2000 * cycles + 1)
    velocity = np.array([_unit_shake(float(u), cycles)[1] for u in turns])
    return float(np.abs(np.gradient(velocity, turns)).max())


class PalmJacobian(Protocol):
    """Forward kinematics of an arm that carries a hand."""

    def jacobians(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the poses X_WH (..., 4, 4) and Jacobians (..., 6, J) of the palm in W.

        Rows 0 to 2 are the velocity of H's origin, rows 3 to 5 the angular velocity.
        """
        ...


class PalmPath:
    """Poses and velocities of the palm along a wrist path, about the hand's base link.

    X_WB, shape (4, 4), is the pose of the base link at displacement 0, X_BH the pose of the palm in
    it.
    """

    def __init__(self, X_WB: FloatArray, X_BH: FloatArray, path: WristPath) -> None:
        self._X_WB, self._X_BH, self._path = X_WB, X_BH, path

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return the pose X_WH (4, 4) and the palm's velocity (6,): linear, angular, in W."""
        displacement, rate = self._path(time)
        X_WB = displaced(self._X_WB, displacement)
        X_WH = X_WB @ self._X_BH
        angular = _angular_velocity(displacement[3:], rate[3:])
        linear = rate[:3] + np.cross(angular, X_WH[:3, 3] - X_WB[:3, 3])
        return X_WH, np.concatenate([linear, angular])


def displaced(X_WB: FloatArray, displacement: FloatArray) -> FloatArray:
    """Return a pose (4, 4) displaced by (6,), see `WristPath`."""
    X = X_WB.copy()
    X[:3, 3] += displacement[:3]
    if displacement[3:].any():
        X[:3, :3] = Rotation.from_euler("xyz", displacement[3:]).as_matrix() @ X_WB[:3, :3]
    return X


def joint_path_along(
    kinematics: PalmJacobian,
    arm: Arm,
    q: FloatArray,
    palm: PalmPath,
    *,
    duration: float,
    step: float,
    stretch: float = 1.0,
) -> JointTrajectory | None:
    """Return the joint path along a palm path, from joint positions q (J,) at its start.

    Resolved-rate control (Whitney 1969) with Newton's correction at each sample. The rates are
    ``J^+ V``, the accelerations differences of the rates. With `stretch`, the path takes as many
    times longer. Returns None where the path leaves the reach or the arm's joint limits.
    """
    count = max(round(stretch * duration / step), 1)
    positions, rates = np.empty((count + 1, len(q))), np.empty((count + 1, len(q)))
    guess = q
    for n in range(count + 1):
        X, V = palm.at(n * step / stretch)
        posture = posture_near(kinematics, guess, X)
        if posture is None or np.any(posture < arm.lower) or np.any(posture > arm.upper):
            return None
        positions[n], rates[n] = posture, joint_rates(kinematics, posture, V / stretch)
        guess = posture + step * rates[n]
    accelerations = np.asarray(np.gradient(rates, step, axis=0))
    times: FloatArray = step * np.arange(count + 1, dtype=np.float64)
    return JointTrajectory(arm.joint_names, times, positions, rates, accelerations)


def use_of_limits(path: JointTrajectory, arm: Arm) -> FloatArray:
    """Return the largest fractions, shape (2,), of the arm's speed and acceleration limits."""
    speeds = np.abs(path.velocities) / arm.velocity_limits
    accelerations = np.abs(path.accelerations) / arm.acceleration_limits
    return np.array([np.max(speeds, initial=0.0), np.max(accelerations, initial=0.0)])


def posture_near(arm: PalmJacobian, q: FloatArray, X: FloatArray) -> FloatArray | None:
    """Return joint positions near q (J,) with the palm at X (4, 4), by Newton's method, or None."""
    for _ in range(_NEWTON_STEPS):
        X_WH, J = arm.jacobians(q)
        error = pose_error(X_WH, X)
        if np.abs(error).max() < _EXACT:
            return q
        q = q + _step(J, error)
    return q if np.abs(pose_error(arm.jacobians(q)[0], X)).max() <= _TOLERANCE else None


def joint_rates(arm: PalmJacobian, q: FloatArray, V: FloatArray) -> FloatArray:
    """Return joint rates (J,) with which the palm moves at V (6,), linear and angular, in W."""
    return _step(arm.jacobians(q)[1], V)


def _step(J: FloatArray, motion: FloatArray) -> FloatArray:
    return damped_step(J, motion, _DAMPING * np.trace(J @ J.T) / 6.0)


def _angular_velocity(rpy: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the angular velocity (3,) in W of fixed-axis roll, pitch, yaw and their rates."""
    _, pitch, yaw = rpy
    cp, sp, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    E = np.array([[cy * cp, -sy, 0.0], [sy * cp, cy, 0.0], [-sp, 0.0, 1.0]])
    return np.asarray(E @ rate)
