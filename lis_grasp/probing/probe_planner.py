"""Plan of a probe from what is known: approach, path of an arm, and legs that end at a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.placement import home_of
from lis_grasp.arms.reach import ArmPlace
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory, joined, time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.probe_motions import (
    ARM_APPROACH_SPEED,
    ARM_PROBE_SPEED,
    PROBE_SPEED,
    QUICK_SPEED,
    TRANSIT_SPEED,
)
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.geometry import apply_pose
from lis_grasp.probing.approach_planner import Approach, ApproachPlanner, points_on_links
from lis_grasp.probing.bodies_beside import BodiesBeside
from lis_grasp.probing.course import ArmWay, Leg
from lis_grasp.probing.keep_out import KeepOut, keep_out_of
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

# An arm keeps the hand this far off the table [m], because it sags a little.
_ARM_ERROR = 0.003

NO_ARM_TRANSIT = "the arm has no collision-free path to the approach"

# Postures of a hand that are checked on a way on which it changes, and the least time of that [s].
_BETWEEN, _CHANGE = 4, 0.5
# Spacing of the poses of a hand at which it is seen how far its way is free [m].
_LOOK = 0.005

# The leading fingertip of an approach begins at the ball that contains the object. Transits keep
# off a ball smaller by these lengths [m]; where the hand begins inside, by these fractions.
_INSIDE = (0.015, 0.03)
_FRACTIONS = (0.6, 0.3)


class ProbePlanner:
    """Plans probes of a hand, free or on a station's arm, from what is known of the object.

    `known` are the bodies beside it, in the frame of the first probe.

    Without a probe posture, raises InvalidHandError.
    """

    def __init__(
        self,
        hand: Hand,
        station: Station | None = None,
        *,
        probe_speed: float = PROBE_SPEED,
        known: Surroundings = ALONE,
    ) -> None:
        self.hand, self._probe_speed = hand, probe_speed
        self.beside = BodiesBeside(hand, known) if len(known) else None  #: None without any
        self._approaches = ApproachPlanner(hand, station, beside=self.beside)
        self._asked: tuple[object, ...] = (None, None, None)  # the last probe between bodies
        self._found: Approach | str = ""
        self._transits = None if station is None else ArmTransits(station)
        self._checker = HandCollisionChecker(hand)
        self._poses = {
            name: self._checker.poses_in_hand(posture.joint_positions)
            for name, posture in hand.probe_postures.items()
        }
        self._points = {
            name: self.points(posture.joint_positions)
            for name, posture in hand.probe_postures.items()
        }

    def place_station(self, station: Station) -> None:
        """Place the station of the arm in the frame of the probes."""
        self._approaches.place_station(station)
        self._transits = ArmTransits(station)

    def place_frame(self, X_WE: FloatArray) -> None:
        """Give later probes in the frame E with pose X_WE (4, 4): bodies stay in W."""
        if self.beside is not None:
            self.beside.place_frame(X_WE)
            self._asked = (None, None, None)

    def place_known(self, poses: Mapping[str, FloatArray]) -> None:
        """Place the known bodies at poses (4, 4) in W, by their names."""
        if self.beside is not None:
            self.beside.place(poses)
            self._asked = (None, None, None)

    def kept_off(self, obstacles: ObstacleModel) -> ObstacleModel:
        """Return obstacles with the table raised by the error of an arm."""
        height = obstacles.space.support_height
        if height is None or self._transits is None:
            return obstacles
        space = replace(obstacles.space, support_height=height + _ARM_ERROR)
        return replace(obstacles, space=space)

    def approach(
        self, probe: Probe, obstacles: ObstacleModel, start: ArmPlace | None = None
    ) -> Approach | str:
        """Return the approach to a probe, or the reason why there is none.

        An arm comes from its home, or from another `start`.
        """
        if self.beside is None:
            return self._approaches.find(probe, obstacles, start)
        asked = (probe, obstacles.contacts, obstacles.surface)
        if any(now is not before for now, before in zip(asked, self._asked, strict=True)):
            self._asked, self._found = asked, self._approaches.find(probe, obstacles, start)
        return self._found

    def before_bodies(self, approach: Approach, probe: Probe) -> float:
        """Return how far the hand can move from a probe's start before it would hit a body."""
        if self.beside is None:
            return np.inf
        length = probe.standoff + probe.overshoot
        return self.beside.free_length(approach.posture, approach.X_OH, probe.direction, length)

    def starts(self, probe: Probe) -> Iterator[Approach]:
        """Yield every hand at the start of a probe, without an approach and without a check."""
        return self._approaches.starts(probe)

    def transit(
        self, approach: Approach, space: Workspace, start: ArmPlace | None = None
    ) -> ArmWay | str | None:
        """Return an arm's way to an approach, or why there is none; None without arm.

        It is from home, or from another `start`.
        """
        if self._transits is None or approach.arm is None:
            return None
        begin, q_hand = approach.arm.approach[0], approach.posture.joint_positions
        return self._transits.between(start, begin, q_hand, space) or NO_ARM_TRANSIT

    def arm_place(self, left_at: FloatArray) -> ArmPlace:
        """Return where an arm rests at joint positions of arm and hand, (J + K,)."""
        ahead = len(left_at) - len(self.hand.joint_names)
        return ArmPlace(left_at[:ahead], left_at[ahead:])

    def way_home(self, start: ArmPlace, space: Workspace) -> JointTrajectory | None:
        """Return an arm's path home, or None."""
        return None if self._transits is None else self._transits.way_home(start, space)

    def legs(
        self, approach: Approach, probe: Probe, obstacles: ObstacleModel | None
    ) -> tuple[Leg, Leg]:
        """Return the approach and the probe's motion as planned, without a contact.

        They are slow where the hand may touch something, and faster there until the first contact.
        """
        begin, axis, distance = approach.X_OH_outside, approach.axis, approach.distance
        X_OH, along, length = approach.X_OH, probe.direction, probe.standoff + probe.overshoot
        speed, searching, fast = self._probe_speed, PROBE_SPEED, TRANSIT_SPEED
        q_in, q_ahead = None, None
        if approach.arm is not None:
            speed, searching, fast = ARM_PROBE_SPEED, ARM_APPROACH_SPEED, ARM_APPROACH_SPEED
            q_in, q_ahead = approach.arm.approach, approach.arm.motion
        if probe.pace == "quick":
            speed = max(speed, min(QUICK_SPEED, fast))
        way_in = Leg(begin, axis, distance, speed, fast=fast, q_arm=q_in)
        ahead = Leg(X_OH, along, length, speed, fast=fast, q_arm=q_ahead)
        if obstacles is None:
            return way_in, ahead
        keep_out = keep_out_of(obstacles)
        points = self._points[approach.posture.finger]
        if not len(obstacles.contacts):
            way_in, ahead = (_searching(leg, searching) for leg in (way_in, ahead))
        way_in, ahead = (
            replace(leg, free=_free_length(leg, points, keep_out)) for leg in (way_in, ahead)
        )
        if probe.passed is not None:
            passed = min(probe.passed.length_from(X_OH, along), ahead.planned)
            ahead = replace(ahead, free=max(ahead.free, passed))
        return way_in, ahead

    def points(self, *postures: FloatArray) -> FloatArray:
        """Return points on the links in postures (J,), at most 15 mm apart, (P, 3), in H [m]."""
        return np.vstack(points_on_links(self.hand, postures))

    def above_table(
        self, approach: Approach, probe: Probe, obstacles: ObstacleModel | None
    ) -> float:
        """Return how far the hand can move from a probe's start before it would enter the table."""
        height = None if obstacles is None else obstacles.space.support_height
        if height is None or probe.direction[2] >= 0.0:
            return np.inf
        lowest = float(self._checker.lowest(approach.X_OH @ self._poses[approach.posture.finger]))
        return max(lowest - height, 0.0) / -float(probe.direction[2])

    def ended_before(
        self, approach: Approach, probe: Probe, obstacles: ObstacleModel | None
    ) -> Probe:
        """Return the probe with its end where the hand would enter the table or a known body.

        A robot gets no motion that only its contact would keep out of them.
        """
        length = self.above_table(approach, probe, obstacles)
        length = min(length, self.before_bodies(approach, probe))
        if length >= probe.standoff + probe.overshoot:
            return probe
        if length >= probe.standoff:
            return replace(probe, overshoot=length - probe.standoff)
        target = probe.start + length * probe.direction
        return replace(probe, target=target, standoff=length, overshoot=0.0)


def _searching(leg: Leg, speed: float) -> Leg:
    """Return a leg at the speed of a search [m/s]: the table yields to no push, so down is slow."""
    steep = max(abs(float(leg.direction[2])), leg.speed / speed)
    return replace(leg, speed=max(leg.speed, min(speed, leg.speed / steep)))


def _free_length(leg: Leg, points: FloatArray, keep_out: KeepOut) -> float:
    """Return how far a hand with points (P, 3) in H goes on a leg before it may touch [m]."""
    steps = np.append(np.arange(0.0, leg.planned, _LOOK), leg.planned)
    places = apply_pose(leg.X_OH, points) + steps[:, None, None] * leg.direction  # (S, P, 3)
    near = keep_out.may_touch(places).any(axis=1)
    return leg.planned if not near.any() else float(steps[max(int(np.argmax(near)) - 1, 0)])


def transit_radii(space: Workspace) -> list[float]:
    """Return the radii [m] of balls about an object that a transit keeps out of, in turn."""
    radii = [space.radius - inside for inside in _INSIDE]
    return [*radii, *(fraction * radii[-1] for fraction in _FRACTIONS)]


class ArmTransits:
    """Plans an arm's paths from probe to probe, outside of the object's ball.

    The content of the ball is unknown, and only approach and probe enter it. The hand changes its
    posture on the way where every posture between is free, else at home.
    """

    def __init__(self, station: Station) -> None:
        self._station, self._home = station, home_of(station)
        self._planners: dict[tuple[float, ...], TransitPlanner] = {}

    def between(
        self, start: ArmPlace | None, goal: FloatArray, q_hand: FloatArray, space: Workspace
    ) -> ArmWay | None:
        """Return the way to a posture (J,) of the arm with the hand at (K,); None if none.

        It begins at home, or at another start.
        """
        if start is not None:
            direct = self._plan(start.q_arm, goal, q_hand, space, start.q_hand)
            if direct is not None:
                return ArmWay.changing(direct, start.q_hand, q_hand, (0.0, direct.duration))
        onward = self._plan(self._home, goal, q_hand, space)
        if onward is None:
            return None
        if start is None:
            return ArmWay.changing(onward, q_hand, q_hand, (0.0, 0.0))
        home = self.way_home(start, space)
        if home is None:
            return None
        at_home = home.duration - 0.5 * _CHANGE, home.duration + 0.5 * _CHANGE
        return ArmWay.changing(joined([home, onward]), start.q_hand, q_hand, at_home)

    def way_home(self, start: ArmPlace, space: Workspace) -> JointTrajectory | None:
        """Return the motion home; None if there is no path."""
        return self._plan(start.q_arm, self._home, start.q_hand, space)

    def _plan(
        self,
        start: FloatArray,
        goal: FloatArray,
        q_hand: FloatArray,
        space: Workspace,
        q_before: FloatArray | None = None,
    ) -> JointTrajectory | None:
        """Return the motion from posture to posture (J,); None if there is no path.

        The hand gets from another posture `q_before` (K,) to `q_hand` (K,) on the way.
        """
        for radius in transit_radii(space):
            planner = self._planner(space, radius)
            rng = np.random.default_rng(0)  # equal calls, equal transits
            corners = planner.plan(start, goal, q_hand, rng=rng)
            if corners is not None:
                keeps_off = planner.keeps_off(corners[[0, -1]], q_hand)
                kept = planner.keeps_off if keeps_off else planner.is_free
                is_free = partial(kept, q_hand=q_hand)
                motion = time_path(self._station.arm, corners, is_free=is_free)
                if q_before is None:
                    return motion
                # A way between two places low above the table would stay low: it goes home first.
                if not keeps_off:
                    return None
                if np.array_equal(q_before, q_hand):
                    return motion
                parts = np.linspace(0.0, 1.0, _BETWEEN, endpoint=False)[:, None]
                between = q_before + parts * (q_hand - q_before)
                if motion.duration >= _CHANGE and all(
                    planner.keeps_off(motion.positions, q) for q in between
                ):
                    return motion
                return None
        return None

    def _planner(self, space: Workspace, radius: float) -> TransitPlanner:
        in_air = space.support_height is None
        key = (*space.center, radius, in_air)
        if key not in self._planners:
            if len(self._planners) >= len(_INSIDE) + len(_FRACTIONS):
                self._planners.clear()
            ball = None
            if radius > 0.0:
                ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
                ball.apply_translation(space.center)
            # An object that is held in the air is touched without a table.
            station = _without_table(self._station) if in_air else self._station
            self._planners[key] = TransitPlanner(station, ball)
        return self._planners[key]


def _without_table(station: Station) -> Station:
    """Return a station without its table; the bodies beside the object remain."""
    table = station.table
    if table is None or not len(table.surroundings):
        return replace(station, table=None)
    return replace(station, table=replace(table, height=-np.inf))
