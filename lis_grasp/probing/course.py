"""Course of a hand on a probe up to its first contact, and the paths of the arm that carries it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from lis_grasp.arms.trajectory import JointTrajectory, joined
from lis_grasp.exploration.probe_motions import ARM_RETREAT_SPEED, SLIDE_SPEED, TRANSIT_SPEED
from lis_grasp.geometry import make_pose
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.collision import NearestLink
from lis_grasp.typing import FloatArray

FREE_POINT_SPACING = 0.01
"""Distance between recorded points of free space along the motion [m]."""

# The palm starts and stops with this acceleration on straight legs [m/s^2].
_ACCELERATION = 0.5
# Shorter legs are left out [m].
_LEAST = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """Straight motion of a hand: its approach to a probe, or the probe's motion."""

    X_OH: FloatArray  # (4, 4): pose of the palm at the start
    direction: FloatArray  # (3,), unit, in O
    planned: float  # length as planned [m]
    speed: float  # [m/s]
    q_arm: FloatArray | None = None  # (S, J): an arm's positions at even places along this length
    length: float = 0.0  # up to its end or a contact [m]
    remaining: float = 0.0  # the part after a contact [m]

    @property
    def places(self) -> FloatArray:
        """Places of the palm on the leg, its end among them, shape (K, 3) [m]."""
        steps = np.append(np.arange(0.0, self.length, FREE_POINT_SPACING), self.length)
        return np.asarray(self.X_OH[:3, 3] + steps[:, None] * self.direction)


@dataclass(frozen=True, slots=True, eq=False)
class Slide:
    """Motion of a hand that keeps a fingertip on the surface after its first contact."""

    places: FloatArray  # (K, 3): of the palm, where the tip touched, then lifted at the end [m]
    length: float  # of the tip's path [m]
    touched: NearestLink | None  # the contact at its end; None if it ended too early
    normal: FloatArray  # (3,), of the surface there
    before: float = 0.0  # time of earlier slides, which were too short, and back [s]

    @property
    def until_end(self) -> float:
        """Time from the first contact up to the end [s]."""
        return self.before + self.length / SLIDE_SPEED

    @property
    def duration(self) -> float:
        """Time of the slide and of the retreat along it [s]."""
        return self.until_end + self.length / TRANSIT_SPEED


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Motion of a hand on a probe up to the first contact, by geometry alone."""

    finger: str  # the leading one
    joint_positions: FloatArray  # (J,) of the hand
    legs: tuple[Leg, ...]  # the approach, and the probe's motion if the hand arrived at its start
    touched: NearestLink | None  # the touching link and its contact
    at_table: bool = False  # whether the table ended the motion before the probe's target
    way: JointTrajectory | None = None  # path of an arm from its home to the approach
    slide: Slide | None = None  # after the first contact

    @property
    def last(self) -> Leg:
        """The leg that ended the motion."""
        return self.legs[-1]

    @property
    def X_OH_end(self) -> FloatArray:
        """Pose (4, 4) of the palm where the motion ended."""
        leg = self.last
        X_OH = leg.X_OH.copy()
        X_OH[:3, 3] += leg.length * leg.direction
        return X_OH

    @property
    def until_contact(self) -> float:
        """Time up to the end of the motion [s]."""
        transit = 0.0 if self.way is None else self.way.duration
        return sum((leg.length / leg.speed for leg in self.legs), transit)

    @property
    def duration(self) -> float:
        """Time of the motion and of the retreat along it [s]."""
        back = sum(leg.length for leg in self.legs)
        if self.way is None:
            slide = 0.0 if self.slide is None else self.slide.duration
            return self.until_contact + back / TRANSIT_SPEED + slide
        return self.until_contact + back / ARM_RETREAT_SPEED + self.way.duration

    def poses(self) -> FloatArray:
        """Return poses of the palm along the motion, shape (K, 4, 4), with the end of each leg."""
        places = [leg.places for leg in self.legs]
        if self.slide is not None:
            places.append(self.slide.places)
        # The end of the approach is the start of the probe's motion.
        joint = np.concatenate([*(leg[:-1] for leg in places[:-1]), places[-1]])
        return make_pose(self.last.X_OH[:3, :3], joint)


PathOf = Callable[[Arm, Course, float, float], JointTrajectory]
"""Returns an arm's path from a course, its end's distance to the contact [m], and a step [s]."""


def path_out(arm: Arm, course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path from home to the end of a course, or to `before` [m] ahead of its contact.

    The path has the transit as planned, then the straight legs at the course's speeds, or slower
    where the arm's limits, times its `speed_fraction`, need it. There is a point each `step` [s].
    Ahead of a contact the palm keeps its speed.
    """
    assert course.way is not None
    *approach, last = _shortened(course, before)
    parts = [_path(arm, leg, leg.speed, step) for leg in approach]
    parts.append(_path(arm, last, last.speed, step, keeps_speed=course.touched is not None))
    return joined([course.way, *parts])


def path_back(arm: Arm, course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path home from where `path_out` ends, from rest to rest."""
    assert course.way is not None
    legs = reversed(_shortened(course, before))
    parts = [_path(arm, leg, ARM_RETREAT_SPEED, step).reversed() for leg in legs]
    return joined([*parts, course.way.reversed()])


def _shortened(course: Course, before: float) -> list[Leg]:
    """Return the legs of a course, the last one `before` [m] shorter if it ends at a contact."""
    *approach, last = course.legs
    length = max(last.length - (0.0 if course.touched is None else before), 0.0)
    return [*approach, replace(last, length=length)]


def _path(
    arm: Arm, leg: Leg, speed: float, step: float, *, keeps_speed: bool = False
) -> JointTrajectory:
    """Return the motion along a leg at a palm speed [m/s], from rest, within the arm's limits."""
    assert leg.q_arm is not None
    if leg.length < _LEAST or len(leg.q_arm) < 2:
        rest = np.zeros((1, leg.q_arm.shape[1]))
        return JointTrajectory(arm.joint_names, np.zeros(1), leg.q_arm[:1], rest, rest)
    made = _timed(arm, leg, speed, step, keeps_speed=keeps_speed)
    speeds = np.abs(made.velocities) / arm.velocity_limits
    pulls = np.abs(made.accelerations) / arm.acceleration_limits
    slower = max(speeds.max() / arm.speed_fraction, np.sqrt(pulls.max() / arm.speed_fraction))
    if slower <= 1.0:
        return made
    return _timed(arm, leg, speed, step, slower=float(slower), keeps_speed=keeps_speed)


def _timed(
    arm: Arm, leg: Leg, speed: float, step: float, *, slower: float = 1.0, keeps_speed: bool
) -> JointTrajectory:
    """Return the motion along a leg that takes `slower` times as long as at a speed [m/s]."""
    assert leg.q_arm is not None
    places = np.linspace(0.0, leg.planned, len(leg.q_arm))
    along, length = CubicSpline(places, leg.q_arm, axis=0), leg.length
    speed = min(speed, float(np.sqrt((2.0 if keeps_speed else 1.0) * _ACCELERATION * length)))
    ramp = speed / _ACCELERATION  # [s]
    duration = length / speed + (0.5 if keeps_speed else 1.0) * ramp
    # The last point is at the end, so the whole motion takes slightly longer.
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
