"""Joint paths of an arm in free space on a probe: from home to the contact, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from lis_grasp.arms.joint_trajectory import JointTrajectory
from lis_grasp.arms.time_scaling import joined
from lis_grasp.exploration.probe_motions import ARM_RETREAT_SPEED
from lis_grasp.probing.guarded_motion import Course
from lis_grasp.robots.arm import Arm
from lis_grasp.typing import FloatArray

# The palm starts and stops with this acceleration on straight legs [m/s^2].
_ACCELERATION = 0.5
# A shorter leg is none [m].
_LEAST = 1e-6


def path_out(arm: Arm, course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path from home to the end of a course, or to `before` [m] ahead of its contact.

    The transit as planned, then the straight legs at the course's speeds, or slower where the arm's
    limits, times its `speed_fraction`, need it. There is a point each `step` [s].
    Ahead of a contact the palm keeps its speed.
    """
    assert course.way is not None
    lines = _lines(course, before)
    parts = [course.way]
    for n, line in enumerate(lines):
        keeps_speed = n == len(lines) - 1 and course.touched is not None
        parts.append(_leg(arm, line, course.speeds[n], step, keeps_speed=keeps_speed))
    return joined(parts)


def path_back(arm: Arm, course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path home from where `path_out` ends, from rest to rest."""
    assert course.way is not None
    lines = reversed(_lines(course, before))
    parts = [_leg(arm, line, ARM_RETREAT_SPEED, step).reversed() for line in lines]
    return joined([*parts, course.way.reversed()])


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Joint positions (S, J) at even places of a straight motion, of which a part is made."""

    points: FloatArray
    whole: float  # [m]
    length: float  # of the part [m]


def _lines(course: Course, before: float) -> list[_Line]:
    """Return the straight legs of a course."""
    arm, probe = course.approach.arm, course.probe
    assert arm is not None
    end = max(course.travelled - (0.0 if course.touched is None else before), 0.0)
    approach = course.approach.distance
    lines = [_Line(arm.approach, approach, approach if course.arrived else end)]
    if course.arrived:
        lines.append(_Line(arm.motion, probe.standoff + probe.overshoot, end))
    return lines


def _leg(
    arm: Arm, line: _Line, speed: float, step: float, *, keeps_speed: bool = False
) -> JointTrajectory:
    """Return the motion along a line at a palm speed [m/s], from rest, within the arm's limits."""
    if line.length < _LEAST or len(line.points) < 2:
        rest = np.zeros((1, line.points.shape[1]))
        return JointTrajectory(arm.joint_names, np.zeros(1), line.points[:1], rest, rest)
    made = _timed(arm, line, speed, step, 1.0, keeps_speed=keeps_speed)
    speeds = np.abs(made.velocities) / arm.velocity_limits
    pulls = np.abs(made.accelerations) / arm.acceleration_limits
    slower = max(speeds.max() / arm.speed_fraction, np.sqrt(pulls.max() / arm.speed_fraction))
    if slower <= 1.0:
        return made
    return _timed(arm, line, speed, step, float(slower), keeps_speed=keeps_speed)


def _timed(
    arm: Arm, line: _Line, speed: float, step: float, slower: float, *, keeps_speed: bool
) -> JointTrajectory:
    """Return the motion along a line that takes `slower` times as long as at a speed [m/s]."""
    places = np.linspace(0.0, line.whole, len(line.points))
    along, length = CubicSpline(places, line.points, axis=0), line.length
    speed = min(speed, float(np.sqrt((2.0 if keeps_speed else 1.0) * _ACCELERATION * length)))
    ramp = speed / _ACCELERATION  # [s]
    duration = length / speed + (0.5 if keeps_speed else 1.0) * ramp
    # The last point is at the end: the whole motion takes that little longer.
    count = max(int(np.ceil(slower * duration / step)), 1)
    slower = count * step / duration
    times: FloatArray = step * np.arange(count + 1, dtype=np.float64)
    t: FloatArray = times / slower
    left = np.maximum(duration - t, 0.0)
    begins, ends = t < ramp, (left < ramp) & (not keeps_speed)
    s = np.where(begins, 0.5 * _ACCELERATION * t**2, speed * (t - 0.5 * ramp))
    s = np.clip(np.where(ends, length - 0.5 * _ACCELERATION * left**2, s), 0.0, length)
    rate = np.where(begins, _ACCELERATION * t, np.where(ends, _ACCELERATION * left, speed)) / slower
    pull = _ACCELERATION * (begins.astype(np.float64) - ends) / slower**2
    first = along(s, 1)
    accelerations = along(s, 2) * rate[:, None] ** 2 + first * pull[:, None]
    return JointTrajectory(arm.joint_names, times, along(s), first * rate[:, None], accelerations)
