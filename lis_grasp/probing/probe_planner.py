"""Plan of a probe from what is known: approach, path of an arm, and legs that end at a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.placement import home_of
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory, time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.probe_motions import (
    ARM_APPROACH_SPEED,
    ARM_PROBE_SPEED,
    PROBE_SPEED,
    TRANSIT_SPEED,
)
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.probing.approach_planner import Approach, ApproachPlanner, points_on_links
from lis_grasp.probing.bodies_beside import BodiesBeside
from lis_grasp.probing.course import Leg
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray
from lis_grasp.world import ALONE, Surroundings

# An arm keeps the hand this far off the table [m], because it sags a little.
_ARM_ERROR = 0.003

NO_ARM_TRANSIT = "the arm has no collision-free path from its home to the approach"

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

    def approach(self, probe: Probe, obstacles: ObstacleModel) -> Approach | str:
        """Return the approach to a probe, or the reason why there is none."""
        if self.beside is None:
            return self._approaches.find(probe, obstacles)
        asked = (probe, obstacles.contacts, obstacles.surface)
        if any(now is not before for now, before in zip(asked, self._asked, strict=True)):
            self._asked, self._found = asked, self._approaches.find(probe, obstacles)
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

    def transit(self, approach: Approach, space: Workspace) -> JointTrajectory | str | None:
        """Return an arm's path from home to an approach, or why there is none; None without arm."""
        if self._transits is None or approach.arm is None:
            return None
        begin, q_hand = approach.arm.approach[0], approach.posture.joint_positions
        return self._transits.plan(begin, q_hand, space) or NO_ARM_TRANSIT

    def legs(self, approach: Approach, probe: Probe) -> tuple[Leg, Leg]:
        """Return the approach and the probe's motion as planned, without a contact."""
        begin, axis, distance = approach.X_OH_outside, approach.axis, approach.distance
        X_OH, along, length = approach.X_OH, probe.direction, probe.standoff + probe.overshoot
        if approach.arm is None:
            slow = self._probe_speed
            return Leg(begin, axis, distance, TRANSIT_SPEED), Leg(X_OH, along, length, slow)
        q_in, q_ahead = approach.arm.approach, approach.arm.motion
        return (
            Leg(begin, axis, distance, ARM_APPROACH_SPEED, q_in),
            Leg(X_OH, along, length, ARM_PROBE_SPEED, q_ahead),
        )

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


def transit_radii(space: Workspace) -> list[float]:
    """Return the radii [m] of balls about an object that a transit keeps out of, in turn."""
    radii = [space.radius - inside for inside in _INSIDE]
    return [*radii, *(fraction * radii[-1] for fraction in _FRACTIONS)]


class ArmTransits:
    """Plans an arm's path from home to the approach of each probe, outside of the object's ball.

    The content of the ball is unknown, and only approach and probe enter it. The arm returns along
    the same path, so that a probe does not depend on the one before.
    """

    def __init__(self, station: Station) -> None:
        self._station, self._home = station, home_of(station)
        self._planners: dict[tuple[float, ...], TransitPlanner] = {}

    def plan(
        self, goal: FloatArray, q_hand: FloatArray, space: Workspace
    ) -> JointTrajectory | None:
        """Return the motion from home to a posture (J,); None if there is no path.

        `q_hand` (K,) are the hand's joint positions.
        """
        for radius in transit_radii(space):
            planner = self._planner(space, radius)
            rng = np.random.default_rng(0)  # equal calls, equal transits
            corners = planner.plan(self._home, goal, q_hand, rng=rng)
            if corners is not None:
                return time_path(
                    self._station.arm,
                    corners,
                    is_free=partial(planner.is_free, q_hand=q_hand),
                )
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
