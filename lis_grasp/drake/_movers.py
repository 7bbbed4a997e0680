"""Motions of a hand to probes and back: of a free hand, and of one on an arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import PiecewisePolynomial, PiecewisePose
from scipy.spatial.transform import Rotation

from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import TIME_STEP, JointTrajectory, joined, minimum_jerk
from lis_grasp.drake._hand_motion import LEVER, HandMotion
from lis_grasp.exploration.probe_motions import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.exploration.states import NextProbe
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose, relative_rotation
from lis_grasp.probing.bodies_beside import BodiesBeside
from lis_grasp.probing.course import Course, path_back, path_out
from lis_grasp.probing.probe_planner import NO_ARM_TRANSIT, ProbePlanner, home_of, transit_radii
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.robot_model import by_joint_kind
from lis_grasp.simulation.drake.plant_parts import rigid
from lis_grasp.typing import FloatArray

NO_TRANSIT = "the hand has no collision-free way to the approach"

_POINTS = 9  # on a smooth leg
_CHECKED = 0.02  # distance between checked poses of a transit [m]
# Sides on which a transit may pass the object; above is first.
_SIDES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]], float)


class FreeMover:
    """Moves a free hand: around the object in transit, straight on approach and probe.

    A transit keeps out of the object's ball, off the table and off the planner's known bodies:
    straight if possible, else above the ball, else around it. Where bodies leave no such way, the
    hand goes back as it came, above all of them, and by the approach's own way in.
    """

    def __init__(
        self,
        hand: Hand,
        planner: ProbePlanner,
        X_WE: RigidTransform,
        home: tuple[RigidTransform, FloatArray],
        probe_speed: float,
    ) -> None:
        self._hand, self._planner, self._speed = hand, planner, probe_speed
        self._X_WE = X_WE.GetAsMatrix4()
        self._home = home
        self._levers = by_joint_kind(hand, revolute=LEVER, prismatic=1.0)

    def home(self) -> HandMotion:
        """Return the motion that rests where the exploration begins."""
        X_WG, q = self._home
        X_EH = inverse_pose(self._X_WE) @ X_WG.GetAsMatrix4() @ self._hand.X_LH
        return self._along([(X_EH, q), (X_EH, q)], [1.0])

    def out(self, chosen: NextProbe, before: HandMotion) -> HandMotion | str:
        """Return the motion to a probe's end, or why there is none."""
        probe, obstacles = chosen.probe, chosen.obstacles
        assert obstacles is not None
        approach = self._planner.approach(probe, obstacles)
        if isinstance(approach, str):
            return approach
        q = approach.posture.joint_positions
        X_EH, q_before = self._at(before, before.duration)
        points = self._planner.points(q_before, q)
        beside = self._planner.beside
        known = None if beside is None else OffBodies(beside, np.stack([q_before, q]))
        leave: Sequence[FloatArray] = []
        enter: Sequence[FloatArray] = []
        way = transit(X_EH, approach.X_OH_outside, points, obstacles.space, known)
        if way is None and approach.way:
            *leave, start = before.way[::-1] or [X_EH]
            first, *enter = approach.way
            way = transit(start, first, points, obstacles.space, known)
        if way is None:
            return NO_TRANSIT
        planned = probe.standoff + probe.overshoot
        length = min(planned, self._planner.above_table(approach, probe, obstacles))
        length = min(length, self._planner.before_bodies(approach, probe))
        parts = np.linspace(0.0, 1.0, len(way))[:, None]
        knots = [(X, q_before) for X in leave]
        knots += zip(way, q_before + parts * (q - q_before), strict=True)
        knots += [(X, q) for X in enter]
        speeds = [TRANSIT_SPEED] * (len(knots) - 1)
        end = approach.X_OH.copy()
        end[:3, 3] += length * probe.direction
        motion = self._along(
            [*knots, (approach.X_OH, q), (end, q)], [*speeds, PROBE_SPEED, self._speed]
        )
        return replace(
            motion,
            guarded=self._along(knots, speeds).duration,
            slow=motion.duration - length / self._speed,
            at_table=length < probe.standoff,
            way=approach.way,
        )

    def back(self, motion: HandMotion, time: float) -> HandMotion:
        """Return the straight motion back out of the object's ball."""
        times = [time, *(t for t in (motion.slow, motion.guarded) if t < time)]
        knots = [self._at(motion, t) for t in times]
        return replace(self._along(knots, [TRANSIT_SPEED] * (len(knots) - 1)), way=motion.way)

    def _at(self, motion: HandMotion, time: float) -> tuple[FloatArray, FloatArray]:
        X_WG, q = motion.X_WG(time).GetAsMatrix4(), motion.joints.value(time)[:, 0]
        return inverse_pose(self._X_WE) @ X_WG @ self._hand.X_LH, q

    def _along(
        self, knots: Sequence[tuple[FloatArray, FloatArray]], speeds: Sequence[float]
    ) -> HandMotion:
        """Return the motion along palm poses in E and postures, at speeds of the legs [m/s].

        Legs at the speed of transits begin and end smoothly.
        """
        to_base = inverse_pose(self._hand.X_LH)
        times, poses, postures = [0.0], [knots[0][0]], [knots[0][1]]
        for (X, q), (Y, p), speed in zip(knots[:-1], knots[1:], speeds, strict=True):
            length = max(_distance(X, Y), float(np.abs(self._levers * (p - q)).max(initial=0.0)))
            if length < 1e-9:
                continue
            parts = np.linspace(0.0, 1.0, _POINTS)[1:] if speed == TRANSIT_SPEED else np.ones(1)
            begin = times[-1]
            for part in parts:
                moved = minimum_jerk(float(part))[0]
                times.append(begin + float(part) * length / speed)
                poses.append(_between(X, Y, moved))
                postures.append(q + moved * (p - q))
        if len(times) == 1:
            times, poses, postures = [0.0, TIME_STEP], poses * 2, postures * 2
        base = [rigid(self._X_WE @ X @ to_base) for X in poses]
        return HandMotion(
            PiecewisePose.MakeLinear(times, base),
            PiecewisePolynomial.FirstOrderHold(times, np.array(postures).T),
            times[-1],
        )


class OffBodies(NamedTuple):
    """Known bodies, off which a hand in postures (N, J) keeps."""

    beside: BodiesBeside
    postures: FloatArray

    def are_hit(self, path: FloatArray) -> bool:
        """Return whether the hand hits a body at one of the palm poses (W, 4, 4)."""
        return self.beside.are_hit(self.postures, path)


def transit(
    X: FloatArray,
    Y: FloatArray,
    points_H: FloatArray,
    space: Workspace,
    known: OffBodies | None = None,
) -> list[FloatArray] | None:
    """Return palm poses (4, 4) from X to Y around an object's ball; None if there is no path.

    The hand's points (P, 3), in H, keep out of the ball, above the table and off known bodies.
    """
    reach = float(np.linalg.norm(points_H, axis=1).max())
    far = space.radius + reach
    heights = [space.center[2] + far, *([] if known is None else [known.beside.top + reach])]
    away = [_moved_off(Z, space.center, far) for Z in (X, Y)]
    ways = [[X, Y], *([X, *(_raised(Z, h) for Z in (X, Y)), Y] for h in heights), [X, *away, Y]]
    for side in _SIDES:
        around = away[1].copy()
        around[:3, 3] = space.center + far * side
        ways.append([X, away[0], around, away[1], Y])
    for radius in transit_radii(space):
        for way in ways:
            legs = list(pairwise(way))
            if all(_is_free(*leg, points_H, space, radius) for leg in legs) and not (
                known and any(known.are_hit(_poses_between(*leg)) for leg in legs)
            ):
                return way
    return None


def _is_free(
    X: FloatArray, Y: FloatArray, points_H: FloatArray, space: Workspace, radius: float
) -> bool:
    """Return whether a hand's points keep out of a ball and above the table between two poses."""
    for pose in _poses_between(X, Y):
        points = apply_pose(pose, points_H)
        if space.support_height is not None and points[:, 2].min() < space.support_height:
            return False
        if np.linalg.norm(points - space.center, axis=1).min() < radius:
            return False
    return True


def _poses_between(X: FloatArray, Y: FloatArray) -> FloatArray:
    """Return the checked poses (W, 4, 4) of a straight path, both ends included."""
    count = max(int(np.ceil(_distance(X, Y) / _CHECKED)), 1)
    return np.stack([_between(X, Y, float(part)) for part in np.linspace(0.0, 1.0, count + 1)])


def _distance(X: FloatArray, Y: FloatArray) -> float:
    """Return the motion between two poses [m], a turn at a lever."""
    turn = Rotation.from_matrix(relative_rotation(X, Y)).magnitude()
    return max(float(np.linalg.norm(Y[:3, 3] - X[:3, 3])), LEVER * float(turn))


def _between(X: FloatArray, Y: FloatArray, part: float) -> FloatArray:
    """Return the pose at a fraction of the straight path from X to Y, turning evenly."""
    turn = Rotation.from_matrix(relative_rotation(X, Y)).as_rotvec()
    R = X[:3, :3] @ Rotation.from_rotvec(part * turn).as_matrix()
    return make_pose(R, X[:3, 3] + part * (Y[:3, 3] - X[:3, 3]))


def _raised(X: FloatArray, height: float) -> FloatArray:
    raised = X.copy()
    raised[2, 3] = max(raised[2, 3], height)
    return raised


def _moved_off(X: FloatArray, center: FloatArray, distance: float) -> FloatArray:
    moved = X.copy()
    offset = X[:3, 3] - center
    length = max(float(np.linalg.norm(offset)), 1e-9)
    moved[:3, 3] = center + max(1.0, distance / length) * offset
    return moved


class ArmMover:
    """Moves a hand on an arm: from its home by a collision-free path, and back to it."""

    def __init__(self, station: Station, planner: ProbePlanner, X_WE: RigidTransform) -> None:
        self._station, self._planner = station, planner
        self._X_WE, self._home = X_WE.GetAsMatrix4(), home_of(station)
        self._levers = by_joint_kind(station.hand, revolute=LEVER, prismatic=1.0)

    def home(self) -> HandMotion:
        """Return the motion that rests where the exploration begins."""
        q = next(iter(self._station.hand.probe_postures.values())).joint_positions
        return self._on(self._resting(TIME_STEP), q, q, TIME_STEP)

    def out(self, chosen: NextProbe, before: HandMotion) -> HandMotion | str:
        """Return the motion to a probe's end, or why there is none."""
        assert chosen.obstacles is not None
        probe, obstacles = chosen.probe, self._planner.kept_off(chosen.obstacles)
        approach = self._planner.approach(probe, obstacles)
        if isinstance(approach, str):
            return approach
        way = self._planner.transit(approach, obstacles.space)
        if isinstance(way, str) or way is None:
            return way or NO_ARM_TRANSIT
        way_in, ahead = self._planner.legs(approach, probe, obstacles)
        end = min(ahead.planned, self._planner.above_table(approach, probe, obstacles))
        end = min(end, self._planner.before_bodies(approach, probe))
        legs = replace(way_in, length=way_in.planned), replace(ahead, length=end)
        finger, q = approach.posture.finger, approach.posture.joint_positions
        course = Course(finger, q, legs, None, way=way)
        q_before = before.joints.value(before.duration)[:, 0]
        change = float(np.abs(self._levers * (q - q_before)).max()) / TRANSIT_SPEED
        change = max(np.ceil(change / TIME_STEP), 1.0) * TIME_STEP  # at home, before the arm moves
        arm = self._station.arm
        path = joined([self._resting(change), path_out(arm, course, 0.0, TIME_STEP)])
        inside = path_out(arm, replace(course, legs=legs[:1]), 0.0, TIME_STEP)
        return replace(
            self._on(path, q_before, q, change),
            guarded=change + way.motion.duration,
            slow=change + inside.duration,
            at_table=end < probe.standoff,
            course=course,
        )

    def back(self, motion: HandMotion, time: float) -> HandMotion:
        """Return the motion back home."""
        assert motion.course is not None
        legs = motion.course.legs[: 2 if time >= motion.slow else 1]
        to_palm = self._station.hand.X_LH
        X_EH = inverse_pose(self._X_WE) @ motion.X_WG(time).GetAsMatrix4() @ to_palm
        last = legs[-1]
        travelled = float((X_EH[:3, 3] - last.X_OH[:3, 3]) @ last.direction)
        last = replace(last, length=float(np.clip(travelled, 0.0, last.length)))
        course = replace(motion.course, legs=(*legs[:-1], last))
        q, way = course.joint_positions, course.way
        assert way is not None
        path = joined([path_back(self._station.arm, course, 0.0, TIME_STEP), way.motion.reversed()])
        return self._on(path, q, q, TIME_STEP)

    def _resting(self, duration: float) -> JointTrajectory:
        """Return the trajectory that stays at home for a duration [s]."""
        rest = np.zeros((2, len(self._home)))
        at = np.array([self._home, self._home])
        names = self._station.arm.joint_names
        return JointTrajectory(names, np.array([0.0, duration]), at, rest, rest)

    def _on(self, path: JointTrajectory, q: FloatArray, p: FloatArray, change: float) -> HandMotion:
        """Return the motion on an arm's path; the hand's joints go from q to p at its beginning."""
        from_palm = inverse_pose(self._station.hand.X_LH)
        bases = self._X_WE @ self._station.palm_poses(path.positions) @ from_palm
        times = [0.0, change, max(path.duration, 2.0 * change)]
        return HandMotion(
            PiecewisePose.MakeLinear(path.times, [rigid(X) for X in bases]),
            PiecewisePolynomial.FirstOrderHold(times, np.array([q, p, p]).T),
            path.duration,
            PiecewisePolynomial.CubicHermite(path.times, path.positions.T, path.velocities.T),
        )
