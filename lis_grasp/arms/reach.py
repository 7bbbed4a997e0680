"""Reach of an arm for grasps and probes: inverse kinematics, straight motions and collisions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.mounted_hand import MountedHand
from lis_grasp.geometry import rotate
from lis_grasp.grasping.grasps import LIFT, STANDOFF
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.pose_ik import ArmSolutions
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

STEP = 0.02
"""Largest distance between tracked poses of the palm [m]."""
JUMP = 0.35
"""Largest motion of a joint in one step [rad or m]; more is a jump to another branch."""

SEEDS, KEPT = 4, 2
"""Seeds of the inverse kinematics of a pose, and its solutions that are tried."""

_SAME = 0.1  # solutions with joints this near are one [rad or m]
_FAR = 0.1  # worth of being near home, relative to being off the joint limits [1]
_CHECKED = 2  # of the poses along a straight motion, every second is checked for collisions

# Points (P, 3) -> which are inside of what is known, (P,).
Occupied = Callable[[FloatArray], BoolArray]


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Joint positions that follow B straight motions."""

    q: FloatArray  # (B, S + 1, J): at the start, and after each of the S steps
    followed: BoolArray  # (B,): to the end, within limits and without a jump


def track(station: MountedHand, q: FloatArray, X_WH: FloatArray, moved: FloatArray) -> Tracked:
    """Track straight motions of the palm without turning, by translations (3,) or (B, 3) in W [m].

    They start at the joint positions q (B, J), with the palm at X_WH (B, 4, 4).
    """
    moved = np.broadcast_to(moved, (len(q), 3))
    longest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    steps = max(int(np.ceil(longest / STEP)), 1)
    positions = np.repeat(np.asarray(q, np.float64)[:, None], steps + 1, axis=1)  # (B, S + 1, J)
    followed = np.ones(len(q), dtype=bool)
    for step in range(1, steps + 1):
        active = np.flatnonzero(followed)
        if not len(active):
            break
        target = X_WH[active].copy()
        target[:, :3, 3] += step / steps * moved[active]
        before = positions[active, step - 1]
        # Going on as before is near the next position.
        guess = before if step == 1 else 2.0 * before - positions[active, step - 2]
        q_next, solved = station.follow(station.arm.clipped(guess), target)
        positions[active, step:] = q_next[:, None]
        followed[active] = solved & (np.abs(q_next - before).max(axis=1) <= JUMP)
    return Tracked(positions, followed)


@dataclass(frozen=True, slots=True, eq=False)
class ArmGrasp:
    """Joint positions of an arm for one grasp, J joints."""

    approach: FloatArray  # (S, J): straight, from the standoff to the grasp
    lift: FloatArray  # (L, J): straight up, from the grasp

    @property
    def standoff(self) -> FloatArray:
        """Joint positions (J,) where the approach begins."""
        return self.approach[0]


class ReachFilter:
    """Finds which grasps an arm can carry out, and how.

    A grasp is kept if the arm reaches it, approaches it and lifts from it straight, within joint
    limits and on one branch, and collides with nothing on the way. Every other grasp gets a reason:

    - ``out_of_arm_reach``: no joint positions;
    - ``no_straight_arm_motion``: a joint limit or a jump ends the approach or the lift;
    - ``arm_hits_object``, ``_table``, ``_obstacle``, ``_self``: a link of the arm collides on the
      way. The filter of grasp candidates checks the hand's contacts with these.

    The object is the closed mesh of its estimate in W [m]; None for none.
    """

    def __init__(self, station: MountedHand, mesh: trimesh.Trimesh | None = None) -> None:
        self._station = station
        self._checker = StationChecker(station, mesh, arm_only=True)

    def plan(
        self, X_WH: FloatArray, q_open: FloatArray, q_closed: FloatArray
    ) -> list[ArmGrasp | str]:
        """Return the arm's motion for each of N grasps, or the reason that there is none.

        `X_WH` (N, 4, 4) are the palm's poses, `q_open` and `q_closed` (N, K) the hand's joint
        positions on the approach, and at the grasp and lift.
        """
        solutions = self._station.solve_ik(X_WH, seeds=SEEDS, first=self._station.arm.home)
        pose, q = best_solutions(self._station, solutions, kept=KEPT)
        forward = rotate(X_WH[pose], self._station.hand.approach_H)
        away = track(self._station, q, X_WH[pose], -STANDOFF * forward)
        up = track(self._station, q, X_WH[pose], np.array([0.0, 0.0, LIFT]))
        motions: list[ArmGrasp | str] = [
            "no_straight_arm_motion" if reached else "out_of_arm_reach"
            for reached in solutions.reached
        ]
        for i in np.flatnonzero(away.followed & up.followed):
            n = int(pose[i])
            if isinstance(motions[n], ArmGrasp):
                continue
            approach, lift = away.q[i, ::-1], up.q[i]
            hit = self._first_hit(approach, q_open[n]) or self._first_hit(lift, q_closed[n])
            motions[n] = ArmGrasp(approach, lift) if hit is None else f"arm_hits_{hit}"
        return motions

    def rejections(
        self, X_WH: FloatArray, q_open: FloatArray, q_closed: FloatArray
    ) -> list[str | None]:
        """Return why the arm cannot carry out each of N grasps, None if it can; see `plan`."""
        motions = self.plan(X_WH, q_open, q_closed)
        return [motion if isinstance(motion, str) else None for motion in motions]

    def _first_hit(self, path: FloatArray, q_hand: FloatArray) -> str | None:
        """Return what a path of joint positions (S, J) collides with; None if it is free."""
        checked = path[np.unique(np.r_[0 : len(path) : _CHECKED, len(path) - 1])]
        bad = np.flatnonzero(~self._checker.free(checked, q_hand))
        if not len(bad):
            return None
        hit = self._checker.first_hit(checked[bad[0]], q_hand)
        assert hit is not None
        return hit[0]


def best_solutions(
    station: MountedHand, solutions: ArmSolutions, *, kept: int
) -> tuple[IndexArray, FloatArray]:
    """Return up to `kept` different solutions of each target, the best first.

    Solutions off the joint limits and near the arm's home are better: they are on its branch.
    Returns, of M solutions in all, the index of the target (M,), in order, and joint positions (M,
    J).
    """
    arm = station.arm
    targets: list[int] = []
    chosen: list[FloatArray] = []
    for n in np.flatnonzero(solutions.reached):
        q = _turned_to(arm.home, solutions.q[n][solutions.solved[n]], arm)
        spare = np.minimum(q - arm.lower, arm.upper - q).min(axis=1)
        worth = spare - _FAR * np.abs(q - arm.home).max(axis=1)
        best: list[FloatArray] = []
        for solution in q[np.argsort(-worth, kind="stable")]:
            if len(best) < kept and all(np.abs(solution - b).max() > _SAME for b in best):
                best.append(solution)
        targets += [int(n)] * len(best)
        chosen += best
    joints = len(arm.joint_names)
    return np.array(targets, dtype=np.intp), np.array(chosen).reshape(-1, joints)


def _turned_to(home: FloatArray, q: FloatArray, arm: Arm) -> FloatArray:
    """Return positions (B, J), joints that can turn farther than once moved by turns to home."""
    turns = np.array([joint.kind == "revolute" for joint in arm.joints if joint.is_actuated])
    moved = q - 2.0 * np.pi * np.round((q - home) / (2.0 * np.pi))
    within = (moved >= arm.lower) & (moved <= arm.upper) & turns
    return np.where(within, moved, q)


@dataclass(frozen=True, slots=True, eq=False)
class ArmProbe:
    """Joint positions of an arm for one probe, J joints."""

    approach: FloatArray  # (S, J): straight, up to the start of the probe
    motion: FloatArray  # (M, J): the guarded motion, from there to its end


@dataclass(frozen=True, slots=True, eq=False)
class ArmPlace:
    """Where an arm with a hand rests: their joint positions."""

    q_arm: FloatArray  # (J,)
    q_hand: FloatArray  # (K,)

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions of arm and hand, shape (J + K,)."""
        return np.concatenate([self.q_arm, self.q_hand])


class ProbeReach:
    """Finds which poses of the hand at the start of a probe an arm can carry out, and how.

    The arm has to follow the straight approach and the guarded motion within joint limits, and to
    collide neither with the table, nor with itself, nor with the known object.
    """

    def __init__(self, station: MountedHand) -> None:
        self._station = station
        self._checker = StationChecker(station, arm_only=True)

    def first(
        self,
        X_WH: FloatArray,
        q_hand: FloatArray,
        *,
        approach: FloatArray,
        motion: FloatArray,
        occupied: Occupied,
        start: ArmPlace | None = None,
    ) -> tuple[int, ArmProbe] | None:
        """Return one of R poses that the arm can carry out, with its joint positions.

        It is the one that takes the arm least time from its `start`; None for its home.

        The palm is at `X_WH` (R, 4, 4) at the start of the probe, the hand's joints at `q_hand`
        (R, K); it comes by the translations `approach` (R, 3), and probes by `motion` (3,), in W
        [m]. The arm, not the hand, avoids the points that are `occupied`.
        """
        station = self._station
        solutions = station.solve_ik(X_WH, seeds=SEEDS, first=station.arm.home)
        pose, q = best_solutions(station, solutions, kept=KEPT)
        if not len(q):
            return None
        back = track(station, q, X_WH[pose], -approach[pose])
        ahead = track(station, q, X_WH[pose], motion)
        followed = np.flatnonzero(back.followed & ahead.followed)
        times = self._travel_times(start, back.q[followed, -1])
        for i in followed[np.argsort(times, kind="stable")]:
            probe = ArmProbe(back.q[i, ::-1], ahead.q[i])
            ends = np.array([probe.approach[0], probe.motion[0], probe.motion[-1]])
            path = np.concatenate([ends, probe.approach[1:-1:3], probe.motion[1:-1:3]])
            if not self._checker.free(path, q_hand[pose[i]]).all():
                continue
            if not occupied(self._checker.arm_points(path)).any():
                return int(pose[i]), probe
        return None

    def _travel_times(self, start: ArmPlace | None, q: FloatArray) -> FloatArray:
        """Return the times (N,) [s] to postures (N, J), with joints at their largest speeds."""
        arm = self._station.arm
        begin = arm.home if start is None else start.q_arm
        return np.asarray((np.abs(q - begin) / arm.velocity_limits).max(axis=1))
