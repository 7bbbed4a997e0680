"""Collision-free paths of an arm, by two random trees with shortcuts; its timed grasp motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.placement import home_of
from lis_grasp.arms.reach import ArmGrasp, ReachFilter
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import (
    TIME_STEP,
    JointTrajectory,
    joined,
    minimum_jerk,
    time_path,
    without_repeats,
)
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

SPEED = 0.1
"""Largest speed of the palm on the straight approach and on the lift [m/s]."""

NO_PATH = "no_collision_free_arm_path"
"""Reason of a grasp whose approach begins where the arm cannot get."""

MARGIN = 0.01
"""Distance of a path from the object and the table [m], where its ends permit it."""

# The same of a path that begins or ends nearer [m].
_NARROW = 0.002
_COARSE = 0.15  # steps of a joint in which that motion is measured [rad or m]
_ITERATIONS = 1500  # postures that are tried, before planning is given up
_SHORTCUTS = 40  # that are tried
_CLOSING, _STEP = 1.0, 0.02  # time in which the hand closes, and between two points of it [s]


class TransitPlanner:
    """Plans paths from posture to posture around the object.

    The straight line is tried first, then two trees of random postures grow until both reach one
    (after RRT-Connect, Kuffner and LaValle, 2000), and random shortcuts shorten the path. The mesh
    of what is avoided, the object's estimate or a hull of unknown space, is closed and in W [m].
    """

    def __init__(self, station: Station, mesh: trimesh.Trimesh | None = None) -> None:
        self._station, self._mesh = station, mesh
        self._wide = StationChecker(station, mesh, margin=MARGIN)

    def plan(
        self, start: FloatArray, goal: FloatArray, q_hand: FloatArray, *, rng: np.random.Generator
    ) -> FloatArray | None:
        """Return the corners of a path from `start` to `goal`, (W, J); None if none is found.

        These are joint positions of the arm (J,) [rad or m]; the hand's are `q_hand` (K,) all the
        way. Trees and shortcuts draw from `rng`.
        """
        ends = np.array([start, goal])
        checker = self._wide
        if not checker.free(ends, q_hand).all():
            checker = self._close
            if not checker.free(ends, q_hand).all():
                return None
        edges = _Edges(checker, q_hand, MARGIN if checker is self._wide else _NARROW)
        if edges.free(start, goal):
            return ends
        path = _connect(edges, start, goal, self._station, rng)
        return None if path is None else _shortened(edges, path, rng)

    def keeps_off(self, ends: FloatArray, q_hand: FloatArray) -> bool:
        """Return whether postures (N, J) are free with the margin, so that paths have it, too."""
        return bool(self._wide.free(ends, q_hand).all())

    def is_free(self, path: FloatArray, q_hand: FloatArray) -> bool:
        """Return whether a densely sampled path (N, J) is free, without the margin."""
        return bool(self._close.free(path, q_hand).all())

    @cached_property
    def _close(self) -> StationChecker:
        return StationChecker(self._station, self._mesh)


class _Edges:
    """Checks straight lines in joint space."""

    def __init__(self, checker: StationChecker, q_hand: FloatArray, margin: float) -> None:
        self._checker, self._q_hand, self._margin = checker, q_hand, margin

    def free(self, start: FloatArray, end: FloatArray) -> bool:
        """Return whether the line between two postures is free; `start` is known to be."""
        coarse = np.linspace(0.0, 1.0, int(np.ceil(np.abs(end - start).max() / _COARSE)) + 1)[
            :, None
        ]
        travel = self._checker.travel(start + coarse * (end - start), self._q_hand)
        # No point moves farther between two checked postures than twice the margin.
        count = max(int(np.ceil(travel / (2.0 * self._margin))), 1)
        parts = np.arange(1, count + 1)[:, None] / count
        return bool(self._checker.free(start + parts * (end - start), self._q_hand).all())


def _connect(
    edges: _Edges, start: FloatArray, goal: FloatArray, station: Station, rng: np.random.Generator
) -> FloatArray | None:
    """Return a path (W, J) that two trees find, or None."""
    arm = station.arm
    low = np.maximum(arm.lower, np.minimum(start, goal) - np.pi)
    high = np.minimum(arm.upper, np.maximum(start, goal) + np.pi)
    trees = [_Tree(start), _Tree(goal)]
    for iteration in range(_ITERATIONS):
        # Every other sample is near the line, where the way round is often short.
        sample = rng.uniform(low, high)
        if iteration % 2:
            sample = arm.clipped(start + rng.random() * (goal - start) + 0.15 * (sample - start))
        tree, other = trees[iteration % 2], trees[1 - iteration % 2]
        if tree.extend(sample, edges) and other.extend(sample, edges):
            halves = [tree.path_to_last(), other.path_to_last()]
            if iteration % 2:
                halves.reverse()
            return np.vstack([halves[0], halves[1][::-1][1:]])
    return None


class _Tree:
    """A tree of postures, joined by free edges."""

    def __init__(self, root: FloatArray) -> None:
        self._nodes = [root]
        self._parents = [-1]

    def extend(self, target: FloatArray, edges: _Edges) -> bool:
        """Add a target if the edge from the nearest node is free, and return whether it is."""
        nearest = int(np.argmin(np.linalg.norm(np.array(self._nodes) - target, axis=1)))
        if not edges.free(self._nodes[nearest], target):
            return False
        self._nodes.append(target)
        self._parents.append(nearest)
        return True

    def path_to_last(self) -> FloatArray:
        """Return the nodes from the root to the last one, (W, J)."""
        path, node = [], len(self._nodes) - 1
        while node >= 0:
            path.append(self._nodes[node])
            node = self._parents[node]
        return np.array(path[::-1])


def _shortened(edges: _Edges, path: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return a path with free shortcuts between random points of it."""
    for _ in range(_SHORTCUTS):
        if len(path) < 3:
            break
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        low, high = np.sort(rng.uniform(0.0, ends[-1], size=2))
        i, j = (int(np.searchsorted(ends, place, side="right")) - 1 for place in (low, high))
        i, j = min(i, len(lengths) - 1), min(j, len(lengths) - 1)
        if i == j:
            continue
        a = path[i] + (low - ends[i]) / lengths[i] * (path[i + 1] - path[i])
        b = path[j] + (high - ends[j]) / lengths[j] * (path[j + 1] - path[j])
        if edges.free(a, b):
            path = without_repeats(np.vstack([path[: i + 1], a, b, path[j + 1 :]]))
    return path


@dataclass(frozen=True, slots=True, eq=False)
class GraspMotion:
    """Trajectories of an arm for one grasp; between them the hand closes."""

    approach: JointTrajectory  # from home to the grasp, the hand opened
    lift: JointTrajectory  # from the grasp straight up


def plan_grasp_motion(
    station: Station, mesh: trimesh.Trimesh | None, grasp: Grasp, *, rng: np.random.Generator
) -> GraspMotion | str:
    """Return the motion for a grasp, or the reason that there is none.

    The arm goes from home to the beginning of the approach around the object, whose estimate is a
    closed mesh in W [m], then straight to the grasp in W, and from there straight up. `rng` is for
    the path around the object.
    """
    planned = plan_transit(station, mesh, grasp, rng=rng)
    if isinstance(planned, str):
        return planned
    straight, transit = planned
    approach, lift = (_straight(station, path) for path in (straight.approach, straight.lift))
    return GraspMotion(joined([transit, approach]), lift)


def plan_transit(
    station: Station,
    mesh: trimesh.Trimesh | None,
    grasp: Grasp,
    *,
    rng: np.random.Generator,
    step: float = TIME_STEP,
) -> tuple[ArmGrasp, JointTrajectory] | str:
    """Return the straight paths of a grasp, and the motion from home to where they begin.

    Returns the reason instead if there are none. For arguments see `plan_grasp_motion`; the motion
    has a point each `step` [s].
    """
    q_open = grasp.pregrasp_positions
    (straight,) = ReachFilter(station, mesh).plan(
        grasp.X_OH[None], q_open[None], grasp.joint_positions[None]
    )
    if isinstance(straight, str):
        return straight
    planner = TransitPlanner(station, mesh)
    corners = planner.plan(home_of(station), straight.standoff, q_open, rng=rng)
    if corners is None:
        return NO_PATH
    return straight, time_path(
        station.arm, corners, is_free=lambda path: planner.is_free(path, q_open), step=step
    )


def _straight(station: Station, path: FloatArray) -> JointTrajectory:
    """Return the motion along a straight path of the palm (S, J), no faster than `SPEED`."""
    arm = station.arm
    fraction = arm.speed_fraction
    motion = time_path(arm, path)
    while (fastest := _palm_speed(station, motion)) > SPEED:
        fraction *= 0.98 * SPEED / fastest
        motion = time_path(arm, path, fraction=fraction)
    return motion


def _palm_speed(station: Station, motion: JointTrajectory) -> float:
    """Return the largest speed of the palm's origin [m/s]."""
    _, jacobians = station.jacobians(motion.positions)
    velocities = jacobians[:, :3] @ motion.velocities[..., None]
    return float(np.linalg.norm(velocities[..., 0], axis=1).max())


def closing_motion(hand: Hand, grasp: Grasp) -> JointTrajectory:
    """Return the motion of the hand's joints from opened to the grasp."""
    times = np.linspace(0.0, _CLOSING, round(_CLOSING / _STEP) + 1)
    parts = np.array([minimum_jerk(time / _CLOSING) for time in times])  # (T, 2)
    way = grasp.joint_positions - grasp.pregrasp_positions
    velocities = parts[:, 1:] / _CLOSING * way
    return JointTrajectory(
        hand.joint_names,
        times,
        grasp.pregrasp_positions + parts[:, :1] * way,
        velocities,
        np.gradient(velocities, times, axis=0),
    )
