"""Motions of a hand on an arm to probes and back, as joint trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import PiecewisePolynomial, PiecewisePose

from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import TIME_STEP, JointTrajectory, joined
from lis_grasp.drake._hand_motion import LEVER, HandMotion
from lis_grasp.drake._ports import rigid
from lis_grasp.exploration.probe_motions import TRANSIT_SPEED
from lis_grasp.exploration.states import NextProbe
from lis_grasp.geometry import inverse_pose
from lis_grasp.probing.course import Course, path_back, path_out
from lis_grasp.probing.probe_planner import NO_ARM_TRANSIT, ProbePlanner, home_of
from lis_grasp.robots.robot_model import by_joint_kind
from lis_grasp.typing import FloatArray


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
        way_in, ahead = self._planner.legs(approach, probe)
        end = min(ahead.planned, self._planner.above_table(approach, probe, obstacles))
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
            guarded=change + way.duration,
            slow=change + inside.duration,
            at_table=end < probe.standoff,
            course=course,
        )

    def back(self, motion: HandMotion, time: float) -> HandMotion:
        """Return the way back home."""
        assert motion.course is not None
        legs = motion.course.legs[: 2 if time >= motion.slow else 1]
        to_palm = self._station.hand.X_LH
        X_EH = inverse_pose(self._X_WE) @ motion.X_WG(time).GetAsMatrix4() @ to_palm
        last = legs[-1]
        travelled = float((X_EH[:3, 3] - last.X_OH[:3, 3]) @ last.direction)
        last = replace(last, length=float(np.clip(travelled, 0.0, last.length)))
        course = replace(motion.course, legs=(*legs[:-1], last))
        q = motion.course.joint_positions
        return self._on(path_back(self._station.arm, course, 0.0, TIME_STEP), q, q, TIME_STEP)

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
