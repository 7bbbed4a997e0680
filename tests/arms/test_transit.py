"""Transits: paths free at fine sampling, limits kept, and times of known motions."""

import numpy as np
import pytest
import trimesh
from stations import positions_between, station_with

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.station import Station
from lis_grasp.arms.trajectory import JointTrajectory, joined, time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.robots.arm import Arm

_SHARE = 0.5


@pytest.fixture(scope="module")
def station() -> Station:
    return station_with("wsg50")


@pytest.fixture(scope="module")
def wall() -> trimesh.Trimesh:
    return trimesh.creation.box([0.3, 0.04, 0.4]).apply_translation([0.05, 0.0, 0.2])


def _beside(station: Station, y: float) -> np.ndarray:
    """Return joint positions with the jaw pointing down, low beside the wall."""
    X_WH = np.eye(4)
    X_WH[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X_WH[:3, 3] = 0.0, y, 0.15
    found = station.solve_ik(X_WH[None], seeds=8, first=station.arm.home)
    return found.q[0][found.solved[0]][0]


def test_a_path_leads_around_a_wall(station: Station, wall: trimesh.Trimesh) -> None:
    q_hand = station.hand.pregrasps["narrow"]
    start, goal = _beside(station, -0.2), _beside(station, 0.2)
    checker = StationChecker(station, wall)
    line = start + np.linspace(0.0, 1.0, 200)[:, None] * (goal - start)
    assert not checker.free(line, q_hand).all()
    planner = TransitPlanner(station, wall)
    corners = planner.plan(start, goal, q_hand, rng=np.random.default_rng(0))
    assert corners is not None
    np.testing.assert_array_equal(corners[[0, -1]], [start, goal])
    again = planner.plan(start, goal, q_hand, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(corners, again)
    motion = time_path(station.arm, corners, is_free=lambda q: planner.is_free(q, q_hand))
    fine = positions_between(motion, 0.002)
    assert checker.free(fine, q_hand).all()
    assert station.arm.within_limits(fine).all()
    _assert_consistent(station.arm, motion)


def test_a_goal_in_an_obstacle_has_no_path(station: Station, wall: trimesh.Trimesh) -> None:
    planner = TransitPlanner(station, wall)
    inside = _beside(station, 0.0)
    q_hand, rng = station.hand.pregrasps["narrow"], np.random.default_rng(0)
    assert planner.plan(station.arm.home, inside, q_hand, rng=rng) is None


def test_a_long_straight_motion_takes_the_time_of_a_trapezoid(station: Station) -> None:
    arm = station.arm
    start, goal = np.zeros(7), np.zeros(7)
    goal[0] = 2.5
    speed, acceleration = _SHARE * arm.velocity_limits[0], _SHARE * arm.acceleration_limits[0]
    motion = time_path(arm, np.array([start, goal]), fraction=_SHARE)
    # Closed form: distance / speed + speed / acceleration; up to one step longer.
    expected = 2.5 / speed + speed / acceleration
    assert expected - 1e-3 <= motion.duration <= 1.01 * expected + 0.01
    assert np.abs(motion.velocities).max() == pytest.approx(speed, rel=0.01)
    _assert_consistent(arm, motion)


def test_a_short_motion_is_limited_by_acceleration(station: Station) -> None:
    goal = np.zeros(7)
    goal[3] = -0.05
    motion = time_path(station.arm, np.array([np.zeros(7), goal]), fraction=_SHARE)
    # Closed form of a triangle of speed: 2 sqrt(distance / acceleration).
    expected = 2.0 * np.sqrt(0.05 / (_SHARE * station.arm.acceleration_limits[3]))
    assert expected - 1e-3 <= motion.duration <= 1.02 * expected + 0.01


def test_rounded_corners_are_faster_than_stops(station: Station) -> None:
    corners = station.arm.home + np.array(
        [[0.0] * 7, [0.5, 0, 0, 0, 0, 0, 0], [0.5, 0.5, 0, 0, 0, 0, 0], [0.2, 0.8, 0, 0.3, 0, 0, 0]]
    )
    smooth = time_path(station.arm, corners)
    stopping = time_path(station.arm, corners, is_free=lambda q: False)
    assert smooth.duration < 0.9 * stopping.duration
    for motion in (smooth, stopping):
        np.testing.assert_allclose(motion.positions[[0, -1]], corners[[0, -1]], atol=1e-9)
        _assert_consistent(station.arm, motion)
    for corner in corners:  # the one that stops goes through every corner
        assert np.abs(stopping.positions - corner).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_random_paths_keep_the_limits(station: Station, seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = station.arm.home + np.cumsum(rng.normal(scale=0.15, size=(6, 7)), axis=0)
    motion = time_path(station.arm, corners)
    _assert_consistent(station.arm, motion)
    fastest = (np.abs(motion.velocities) / station.arm.velocity_limits).max()
    assert fastest <= station.arm.speed_fraction * (1.0 + 1e-9)


def test_no_motion_takes_no_time(station: Station) -> None:
    motion = time_path(station.arm, np.tile(station.arm.home, (3, 1)))
    assert motion.duration == 0.0
    np.testing.assert_array_equal(motion.positions, [station.arm.home])


def test_joined_trajectories_follow_each_other(station: Station) -> None:
    home = station.arm.home
    there = time_path(station.arm, np.array([home, home + 0.2]))
    back = time_path(station.arm, np.array([home + 0.2, home]))
    both = joined([there, back])
    assert both.duration == pytest.approx(there.duration + back.duration)
    assert (np.diff(both.times) > 0.0).all()
    np.testing.assert_allclose(both.positions[[0, -1]], [home, home], atol=1e-12)
    np.testing.assert_allclose(both.positions[len(there.times) - 1], home + 0.2, atol=1e-9)


def _assert_consistent(arm: Arm, motion: JointTrajectory) -> None:
    """Require the limits, rest at both ends, and velocities that are those of the positions."""
    fraction = arm.speed_fraction
    # Limits hold on the grid of the path, between whose points curvature is constant.
    assert (np.abs(motion.velocities) <= 1.01 * fraction * arm.velocity_limits).all()
    assert (np.abs(motion.accelerations) <= 1.02 * fraction * arm.acceleration_limits).all()
    assert not motion.velocities[0].any()
    assert not motion.velocities[-1].any()
    steps = np.diff(motion.times)[:, None]
    assert (steps > 0.0).all()
    measured = np.diff(motion.positions, axis=0) / steps
    mean = 0.5 * (motion.velocities[1:] + motion.velocities[:-1])
    # Within a step the acceleration may jump from one limit to the other once: a quarter of a step.
    slack = 0.5 * fraction * arm.acceleration_limits * steps.max()
    assert (np.abs(measured - mean) <= 1.05 * slack + 1e-9).all()
