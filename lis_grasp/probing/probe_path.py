"""Joint paths of an arm in free space on a probe: from home to the contact, and back."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from lis_grasp.arms.joint_trajectory import JointTrajectory
from lis_grasp.arms.time_scaling import joined
from lis_grasp.exploration.probe import ARM_RETREAT_SPEED
from lis_grasp.probing.guarded_motion import Course
from lis_grasp.typing import FloatArray

# The palm starts and stops with this acceleration on straight legs [m/s^2].
_ACCELERATION = 0.5
# A shorter leg is none [m].
_LEAST = 1e-6


def path_out(course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path from home to the end of a course, or to `before` [m] ahead of its contact.

    The transit as planned, then the straight legs at the course's speeds, with a point each `step`
    [s]: that of the transit. Ahead of a contact the palm keeps its speed.
    """
    assert course.way is not None
    legs = _lines(course, before)
    parts = [course.way]
    for n, (points, length, whole) in enumerate(legs):
        keeps_speed = n == len(legs) - 1 and course.touched is not None
        speed = course.speeds[n]
        parts.append(_leg(course, points, length, whole, speed, step, keeps_speed=keeps_speed))
    return joined(parts)


def path_back(course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path home from where `path_out` ends, from rest to rest."""
    assert course.way is not None
    parts = [
        _leg(course, points, length, whole, ARM_RETREAT_SPEED, step).reversed()
        for points, length, whole in reversed(_lines(course, before))
    ]
    return joined([*parts, course.way.reversed()])


def _lines(course: Course, before: float) -> list[tuple[FloatArray, float, float]]:
    """Return the straight legs: joint positions (S, J) along a line, and two lengths [m].

    The first length is that of the part that is moved, the second that of the whole line.
    """
    arm, probe = course.approach.arm, course.probe
    assert arm is not None
    end = max(course.travelled - (0.0 if course.touched is None else before), 0.0)
    approach = course.approach.distance
    lines = [(arm.approach, approach if course.arrived else end, approach)]
    if course.arrived:
        lines.append((arm.motion, end, probe.standoff + probe.overshoot))
    return lines


def _leg(
    course: Course,
    points: FloatArray,
    length: float,
    whole: float,
    speed: float,
    step: float,
    *,
    keeps_speed: bool = False,
) -> JointTrajectory:
    """Return the motion along the first `length` [m] of a line at a palm speed [m/s], from rest."""
    assert course.way is not None
    names = course.way.joint_names
    if length < _LEAST or len(points) < 2:
        rest = np.zeros((1, points.shape[1]))
        return JointTrajectory(names, np.zeros(1), points[:1], rest, rest)
    along = CubicSpline(np.linspace(0.0, whole, len(points)), points, axis=0)
    speed = min(speed, float(np.sqrt((2.0 if keeps_speed else 1.0) * _ACCELERATION * length)))
    ramp = speed / _ACCELERATION  # [s]
    duration = length / speed + (0.5 if keeps_speed else 1.0) * ramp
    # The last point is at the end: the whole motion takes that little longer.
    count = max(int(np.ceil(duration / step)), 1)
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
    return JointTrajectory(names, times, along(s), first * rate[:, None], accelerations)
