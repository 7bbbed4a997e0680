"""Course of a hand on a probe up to its first contact, and the paths of the arm that carries it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from lis_grasp.arms.trajectory import JointTrajectory, joined
from lis_grasp.exploration.probe_motions import SLIDE_SPEED, TRANSIT_SPEED
from lis_grasp.geometry import make_pose
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.collision import NearestLink
from lis_grasp.typing import FloatArray

FREE_POINT_SPACING = 0.01
"""Distance between recorded points of free space along the motion [m]."""

# The palm starts and stops with this acceleration on straight legs [m/s^2].
_ACCELERATION = 1.5
# Shorter legs are left out [m].
_LEAST = 1e-6
# Of a fraction of an arm's limits.
_ROUNDING = 1e-3
# Places along a leg between which the palm's acceleration is constant.
_PLACES = 200


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """Straight motion of a hand: its approach to a probe, or the probe's motion."""

    X_OH: FloatArray  # (4, 4): pose of the palm at the start
    direction: FloatArray  # (3,), unit, in O
    planned: float  # length as planned [m]
    speed: float  # guarded, where something may be touched [m/s]
    free: float = 0.0  # length of the part before, in which nothing is expected [m]
    fast: float = TRANSIT_SPEED  # speed there [m/s]
    q_arm: FloatArray | None = None  # (S, J): an arm's positions at even places along this length
    length: float = 0.0  # up to its end or a contact [m]
    remaining: float = 0.0  # the part after a contact [m]

    @property
    def places(self) -> FloatArray:
        """Places of the palm on the leg, its end among them, shape (K, 3) [m]."""
        steps = np.append(np.arange(0.0, self.length, FREE_POINT_SPACING), self.length)
        return np.asarray(self.X_OH[:3, 3] + steps[:, None] * self.direction)

    @property
    def speed_at_end(self) -> float:
        """Speed at the leg's end [m/s]: where nothing was expected, it is not guarded."""
        return self.speed if self.length >= self.free else self.fast

    @property
    def durations(self) -> tuple[float, float]:
        """Times of the free and of the guarded part up to its end [s]."""
        if self.length < _LEAST:
            return 0.0, 0.0
        free = min(self.free, self.length)
        if self.q_arm is None:
            return free / self.fast, (self.length - free) / self.speed
        places, times, _ = _profile(self, keeps_speed=False)
        before = float(np.interp(free, places, times))
        return before, float(times[-1]) - before

    @property
    def back(self) -> float:
        """Time of the way back along it [s]."""
        return sum(self.passed.durations)

    @property
    def passed(self) -> Leg:
        """The leg as it is known after the motion: everything is free."""
        return replace(self, free=self.length, fast=TRANSIT_SPEED)


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
class ArmWay:
    """Motion of an arm to an approach, with the hand that it carries."""

    motion: JointTrajectory  # of the arm, with N times
    q_hand: FloatArray  # (N, K): joint positions of the hand at these times

    @classmethod
    def changing(
        cls,
        motion: JointTrajectory,
        q_before: FloatArray,
        q_hand: FloatArray,
        between: tuple[float, float],
    ) -> ArmWay:
        """Return the way on which the hand gets from (K,) to (K,) between two times [s]."""
        begin, end = between
        part = np.clip((motion.times - begin) / max(end - begin, 1e-9), 0.0, 1.0)[:, None]
        return cls(motion, q_before + part * (q_hand - q_before))


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Motion of a hand on a probe up to the first contact, by geometry alone."""

    finger: str  # the leading one
    joint_positions: FloatArray  # (J,) of the hand
    legs: tuple[Leg, ...]  # the approach, and the probe's motion if the hand arrived at its start
    touched: NearestLink | None  # the touching link and its contact
    at_table: bool = False  # whether the table ended the motion before the probe's target
    way: ArmWay | None = None  # of an arm to the approach
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
    def seconds(self) -> dict[str, float]:
        """Time of each kind of motion [s]: free or guarded, as something may be touched on it."""
        parts = np.array([leg.durations for leg in self.legs])  # (L, 2)
        return {
            "transit": 0.0 if self.way is None else self.way.motion.duration,
            "free": float(parts[:, 0].sum()),
            "guarded": float(parts[:, 1].sum()),
            "slide": 0.0 if self.slide is None else self.slide.duration,
            "retreat": sum(leg.back for leg in self.legs),
        }

    @property
    def until_contact(self) -> float:
        """Time up to the end of the motion [s]."""
        seconds = self.seconds
        return seconds["transit"] + seconds["free"] + seconds["guarded"]

    @property
    def duration(self) -> float:
        """Time of the motion and of the retreat along it [s]."""
        return sum(self.seconds.values())

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
    """Return the path to the end of a course, or to `before` [m] ahead of its contact.

    The path has the transit as planned, then the straight legs at the course's speeds, or slower
    where the arm's limits, times its `speed_fraction`, need it. There is a point each `step` [s].
    Ahead of a contact the palm keeps its speed.
    """
    assert course.way is not None
    *approach, last = _shortened(course, before)
    parts = [_path(arm, leg, step) for leg in approach]
    parts.append(_path(arm, last, step, keeps_speed=course.touched is not None))
    return joined([course.way.motion, *parts])


def path_back(arm: Arm, course: Course, before: float, step: float) -> JointTrajectory:
    """Return the path from where `path_out` ends to where its legs began, from rest to rest."""
    legs = reversed(_shortened(course, before))
    return joined([_path(arm, leg.passed, step).reversed() for leg in legs])


def _shortened(course: Course, before: float) -> list[Leg]:
    """Return the legs of a course, the last one `before` [m] shorter if it ends at a contact."""
    *approach, last = course.legs
    length = max(last.length - (0.0 if course.touched is None else before), 0.0)
    return [*approach, replace(last, length=length)]


def _path(arm: Arm, leg: Leg, step: float, *, keeps_speed: bool = False) -> JointTrajectory:
    """Return the motion along a leg at its palm speeds, from rest, within the arm's limits."""
    assert leg.q_arm is not None
    if leg.length < _LEAST or len(leg.q_arm) < 2:
        rest = np.zeros((1, leg.q_arm.shape[1]))
        return JointTrajectory(arm.joint_names, np.zeros(1), leg.q_arm[:1], rest, rest)
    slower = 1.0
    made = _timed(arm, leg, step, keeps_speed=keeps_speed)
    while (over := _use_of_limits(arm, made)) > 1.0 + _ROUNDING:  # the peak is between two points
        slower *= over
        made = _timed(arm, leg, step, slower=slower, keeps_speed=keeps_speed)
    return made


def _use_of_limits(arm: Arm, made: JointTrajectory) -> float:
    """Return by how much a motion is too fast for the arm's limits, at most 1 if it is not."""
    speeds = np.abs(made.velocities) / arm.velocity_limits
    pulls = np.abs(made.accelerations) / arm.acceleration_limits
    return float(max(speeds.max(), np.sqrt(arm.speed_fraction * pulls.max())) / arm.speed_fraction)


def _timed(
    arm: Arm, leg: Leg, step: float, *, slower: float = 1.0, keeps_speed: bool
) -> JointTrajectory:
    """Return the motion along a leg that takes `slower` times as long as at its speeds."""
    assert leg.q_arm is not None
    along = CubicSpline(np.linspace(0.0, leg.planned, len(leg.q_arm)), leg.q_arm, axis=0)
    places, ends, squares = _profile(leg, keeps_speed=keeps_speed)
    # The last point is at the end, so the whole motion takes slightly longer.
    count = max(int(np.ceil(slower * ends[-1] / step)), 1)
    slower = count * step / ends[-1]
    times: FloatArray = step * np.arange(count + 1, dtype=np.float64)
    cell = np.clip(np.searchsorted(ends, times / slower, side="right") - 1, 0, len(ends) - 2)
    since = times / slower - ends[cell]
    pull = (np.diff(squares) / (2.0 * np.diff(places)))[cell]
    speed = np.sqrt(squares[cell])
    s = np.clip(places[cell] + speed * since + 0.5 * pull * since**2, 0.0, leg.length)
    rate, pull = (speed + pull * since) / slower, pull / slower**2
    first = along(s, 1)
    accelerations = along(s, 2) * rate[:, None] ** 2 + first * pull[:, None]
    return JointTrajectory(arm.joint_names, times, along(s), first * rate[:, None], accelerations)


def _profile(leg: Leg, *, keeps_speed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places [m] along a leg, when the palm gets there [s], and its squared speeds.

    It starts from rest and ends at rest, unless it `keeps_speed`, and is at the guarded speed where
    the free part ends.
    """
    s = np.linspace(0.0, leg.length, _PLACES + 1)
    if 0.0 < leg.free < leg.length:
        s = np.union1d(s, [leg.free])
    braking = 2.0 * _ACCELERATION
    fastest = np.minimum(leg.speed**2 + braking * np.maximum(leg.free - s, 0.0), leg.fast**2)
    squares = np.minimum(fastest, braking * s)
    if not keeps_speed:
        squares = np.minimum(squares, braking * (leg.length - s))
    speeds = np.sqrt(squares)
    spans = 2.0 * np.diff(s) / (speeds[1:] + speeds[:-1])
    return s, np.append(0.0, np.cumsum(spans)), squares
