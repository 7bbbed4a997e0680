"""Guarded motion of a hand through the true scene, up to the first contact of any link."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.placement import home_of
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory, time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.exceptions import InvalidMeshError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import (
    ARM_APPROACH_SPEED,
    ARM_PROBE_SPEED,
    PROBE_SPEED,
    TRANSIT_SPEED,
)
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.probing.approach_planner import (
    NO_FREE_APPROACH,
    NO_FREE_START,
    OUT_OF_ARM_REACH,
    Approach,
    ApproachPlanner,
    leading_center,
)
from lis_grasp.probing.course import Course, Leg
from lis_grasp.robots.collision import HandCollisionChecker, NearestLink
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.pose_filter import balls_inside
from lis_grasp.robots.robot_model import ProbePosture
from lis_grasp.shapes.winding_number import any_inside
from lis_grasp.typing import FloatArray

TOUCHING = 2e-5
"""Distance below which two bodies touch [m]."""

# An arm keeps the hand off the table by this [m]: it sags by a part of that.
_ARM_ERROR = 0.003

NO_ARM_TRANSIT = "the arm has no collision-free path from its home to the approach"
AT_TABLE = "the table ended the motion"


class GuardedMotion:
    """Moves a hand through the true scene until a link touches.

    Conservative advancement (Mirtich 1996): move as far as the distance between links and object
    allows, repeatedly. Distances are python-fcl's, on the exact mesh: the true object in O [m]. A
    hand without probe posture and a mesh that is not watertight are refused.

    Probes, obstacles and courses are in the frame E in which the hand is commanded. It is O until
    `place_object` moves the object. With a `station`, probes are within the reach of its arm.
    """

    def __init__(
        self,
        hand: Hand,
        mesh: trimesh.Trimesh,
        station: Station | None = None,
        *,
        probe_speed: float = PROBE_SPEED,
    ) -> None:
        self._probe_speed = probe_speed
        self._planner = ApproachPlanner(hand, station)
        self._transits = None if station is None else ArmTransits(station)
        self._blocked = NO_FREE_APPROACH if station is None else OUT_OF_ARM_REACH
        if not mesh.is_watertight:
            raise InvalidMeshError("touching needs a watertight mesh: load it with `shapes.load`")
        self._mesh = mesh
        self._checker = HandCollisionChecker(hand, mesh)
        self._poses = {
            name: self._checker.poses_in_hand(posture.joint_positions)
            for name, posture in hand.probe_postures.items()
        }
        self._balls = {
            name: _balls_in_hand(hand, posture) for name, posture in hand.probe_postures.items()
        }
        self._X_OE: FloatArray | None = None  # None for the identity

    def place_object(self, X_EO: FloatArray) -> None:
        """Place the true object at a pose, shape (4, 4)."""
        moved = not np.array_equal(X_EO, np.eye(4))
        self._X_OE = inverse_pose(X_EO) if moved else None

    def place_station(self, station: Station) -> None:
        """Place the station of the arm in the frame E."""
        self._planner.place_station(station)
        self._transits = ArmTransits(station)

    def run(self, probe: Probe, obstacles: ObstacleModel | None = None) -> Course | str:
        """Move up to the first contact; return the course, or the reason that blocks the probe.

        With `obstacles`, the hand approaches from outside of the object's ball, avoids the known
        object, and stops above the table. Without, it starts where no link touches the object.
        """
        way = None
        if obstacles is not None and self._transits is not None:
            obstacles = _with_higher_table(obstacles)
        if obstacles is None:
            approach = self._free_start(probe)
            if approach is None:
                return NO_FREE_START
        else:
            approach = self._planner.plan(probe, obstacles)
            if approach is None:
                return self._blocked
            if self._place(approach, approach.X_OH_outside):
                return NO_FREE_START
            if self._transits is not None and approach.arm is not None:
                begin, q_hand = approach.arm.approach[0], approach.posture.joint_positions
                way = self._transits.plan(begin, q_hand, obstacles.space)
                if way is None:
                    return NO_ARM_TRANSIT
        way_in, ahead = self._legs(approach, probe)
        posture, touched = approach.posture, None
        if way_in.planned > 0.0:
            way_in, touched = self._moved(way_in, way_in.planned)
        legs: tuple[Leg, ...] = (way_in,)
        at_table = False
        if touched is None:
            self._place(approach, approach.X_OH)
            end = min(ahead.planned, self._above_table(approach, probe, obstacles))
            ahead, touched = self._moved(ahead, end)
            legs, at_table = (way_in, ahead), touched is None and end < probe.standoff
        return Course(posture.finger, posture.joint_positions, legs, touched, at_table, way)

    def _legs(self, approach: Approach, probe: Probe) -> tuple[Leg, Leg]:
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

    def _moved(self, leg: Leg, end: float) -> tuple[Leg, NearestLink | None]:
        """Move the placed hand along a leg up to `end` [m]; return its part, and what touched."""
        touched, length = self._advance(leg.direction, end)
        return replace(leg, length=length, remaining=end - length), touched

    def outcome(
        self, probe: Probe, obstacles: ObstacleModel | None
    ) -> tuple[ProbeOutcome, Course | None]:
        """Return the outcome of a probe as if no link touched, and its course if it has one."""
        course = self.run(probe, obstacles)
        if isinstance(course, str):
            return ProbeOutcome(probe, "blocked", reason=course), None
        free_points, free_radii = self._free_space(course, obstacles)
        missed = ProbeOutcome(
            probe,
            "blocked" if course.at_table else "missed",
            free_points=free_points,
            duration=course.duration,
            reason=AT_TABLE if course.at_table else "",
            free_radii=free_radii,
        )
        return missed, course

    def _free_space(
        self, course: Course, obstacles: ObstacleModel | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return a course's free balls, the leader's first: centres (K, 3) in O, radii (K,)."""
        balls = self._balls[course.finger]
        X_OH = course.poses()
        centers = apply_pose(X_OH, balls[:, :3])
        tip, others = centers[:, 0], centers[:, 1:].reshape(-1, 3)
        radii = np.tile(balls[1:, 3], len(X_OH))
        if obstacles is not None:
            distances = np.linalg.norm(others - obstacles.space.center, axis=1)
            overlapping = distances < obstacles.space.radius + radii
            others, radii = others[overlapping], radii[overlapping]
        return (
            np.vstack([tip, others]),
            np.concatenate([np.full(len(tip), balls[0, 3]), radii]),
        )

    def _above_table(
        self, approach: Approach, probe: Probe, obstacles: ObstacleModel | None
    ) -> float:
        """Return how far the hand can move before it would enter the table [m]."""
        height = None if obstacles is None else obstacles.space.support_height
        if height is None or probe.direction[2] >= 0.0:
            return np.inf
        lowest = float(self._checker.lowest(approach.X_OH @ self._poses[approach.posture.finger]))
        return max(lowest - height, 0.0) / -float(probe.direction[2])

    def _place(self, approach: Approach, X_OH: FloatArray) -> bool:
        """Place the hand; return whether a link touches the object's surface."""
        X_OH = X_OH if self._X_OE is None else self._X_OE @ X_OH
        return self._checker.place(X_OH, self._poses[approach.posture.finger])

    def _free_start(self, probe: Probe) -> Approach | None:
        inside: dict[float, bool] = {}  # by the tip's radius
        for approach in self._planner.starts(probe):
            radius = approach.posture.radius
            if radius not in inside:
                # A hand that does not cross the surface is all inside or all outside.
                center = probe.start - radius * probe.direction
                if self._X_OE is not None:
                    center = apply_pose(self._X_OE, center)
                inside[radius] = any_inside(self._mesh, center[None])
            if not inside[radius] and not self._place(approach, approach.X_OH):
                return approach
        return None

    def _advance(self, direction: FloatArray, length: float) -> tuple[NearestLink | None, float]:
        """Move the placed hand until a link touches; return the link and the distance [m]."""
        travelled = 0.0
        if self._X_OE is not None:
            direction = rotate(self._X_OE, direction)
        while True:
            nearest = self._checker.nearest(travelled * direction)
            if nearest.distance < TOUCHING:
                return nearest, travelled
            if travelled >= length:
                return None, length
            travelled = min(travelled + nearest.distance, length)


def _with_higher_table(obstacles: ObstacleModel) -> ObstacleModel:
    """Return obstacles with a table that is higher by what an arm may err."""
    height = obstacles.space.support_height
    if height is None:
        return obstacles
    space = replace(obstacles.space, support_height=height + _ARM_ERROR)
    return replace(obstacles, space=space)


def _balls_in_hand(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return balls inside the links, centres in H and radii [m], shape (S, 4); the leader first."""
    links = hand.forward_kinematics(np.eye(4), posture.joint_positions)
    balls = [np.append(leading_center(hand, posture), posture.radius)[None]]
    for geometry in hand.link_geometries:
        centers, radii = balls_inside(geometry)
        centers_H = apply_pose(links[geometry.link] @ geometry.X_LG, centers)
        inside = np.column_stack([centers_H, radii])
        balls.append(inside[np.linalg.norm(inside - balls[0], axis=1) > TOUCHING])
    return np.concatenate(balls)


# The leading fingertip of an approach begins at the ball that contains the object: transits keep
# off a ball that is smaller by these [m], and where the hand begins inside, by fractions of it.
_INSIDE = (0.015, 0.03)
_FRACTIONS = (0.6, 0.3)
# The same transit is planned for the same probe.
_SEED = 0


class ArmTransits:
    """Plans an arm's way from home to the approach of each probe, outside of the object's ball.

    What is in the ball is unknown, and only approach and probe enter it. The arm returns the same
    way, so that a probe does not depend on the one before.
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
        radii = [space.radius - inside for inside in _INSIDE]
        for radius in [*radii, *(fraction * radii[-1] for fraction in _FRACTIONS)]:
            planner = self._planner(space, radius)
            rng = np.random.default_rng(_SEED)
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
            station = replace(self._station, table=None) if in_air else self._station
            self._planners[key] = TransitPlanner(station, ball)
        return self._planners[key]
