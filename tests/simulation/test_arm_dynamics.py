"""The arm's dynamics in Drake against the package's own kinematics and statics."""

import numpy as np
import pytest

from lis_grasp.arms.check import gravity_efforts
from lis_grasp.arms.station import Station, Table
from lis_grasp.lifting.wrist_path import (
    PalmPath,
    joint_path_along,
    line,
    rest_at,
    shake_about,
    use_of_limits,
)
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.arm_plant import ArmDynamics

STEP = 0.005


@pytest.fixture(scope="module")
def station() -> Station:
    X_WA = np.eye(4)
    X_WA[:3, 3] = -0.5, 0.05, 0.1
    return Station.make(Arm.load("iiwa14"), Hand.load("wsg50"), X_WA, table=Table())


@pytest.fixture(scope="module")
def dynamics(station: Station) -> ArmDynamics:
    posture = next(iter(station.hand.pregrasps.values()))
    return ArmDynamics(station, posture)


def _postures(station: Station, count: int) -> np.ndarray:
    return np.random.default_rng(2).uniform(station.arm.lower, station.arm.upper, (count, 7))


def test_drakes_palm_kinematics_are_those_of_the_product_of_exponentials(
    station: Station, dynamics: ArmDynamics
) -> None:
    for q in _postures(station, 5):
        for drakes, ours in zip(dynamics.jacobians(q), station.jacobians(q), strict=True):
            np.testing.assert_allclose(drakes, ours, atol=1e-9)


def test_efforts_at_rest_are_the_derivative_of_the_potential_energy(
    station: Station, dynamics: ArmDynamics
) -> None:
    for q in _postures(station, 5):
        expected = gravity_efforts(station, q[None])[0]
        rest = np.zeros(7)
        # The standard gravity of the two differs by 4e-5 of itself at the most.
        np.testing.assert_allclose(dynamics.efforts(q, rest, rest), expected, atol=0.01)


def test_efforts_do_the_work_of_a_motion(station: Station, dynamics: ArmDynamics) -> None:
    q, qd, qdd = _postures(station, 3)
    rest = np.zeros(7)
    base = dynamics.efforts(q, rest, rest)
    inertia = np.array([dynamics.efforts(q, rest, e) - base for e in np.eye(7)])
    np.testing.assert_allclose(inertia, inertia.T, atol=1e-9)  # the mass matrix is symmetric
    np.testing.assert_allclose(np.diag(inertia), dynamics.inertias(q), atol=1e-9)
    assert np.linalg.eigvalsh(inertia).min() > 0.0
    np.testing.assert_allclose(dynamics.efforts(q, rest, qdd) - base, inertia @ qdd, atol=1e-8)
    assert np.isfinite(qd).all()


def _path(station: Station, dynamics: ArmDynamics, path: object, duration: float, **options: float):
    arm, hand = station.arm, station.hand
    X_WB = station.palm_poses(arm.home) @ np.linalg.inv(hand.X_LH)
    palm = PalmPath(X_WB, hand.X_LH, path)
    made = joint_path_along(dynamics, arm, arm.home, palm, duration=duration, step=STEP, **options)
    return palm, made


def test_a_joint_path_keeps_the_palm_on_a_shake_with_turns(
    station: Station, dynamics: ArmDynamics
) -> None:
    direction = np.array([1.0, 0.5, -0.3, 0.4, -0.8, 1.0])
    shake = shake_about(np.zeros(6), direction, 2.0, frequency=4.0, cycles=2)
    palm, made = _path(station, dynamics, shake, 0.5)
    for n in range(0, len(made.positions), 9):
        X_WH, velocity = palm.at(n * STEP)
        np.testing.assert_allclose(station.palm_poses(made.positions[n]), X_WH, atol=1e-5)
        _, J = station.jacobians(made.positions[n])
        np.testing.assert_allclose(J @ made.velocities[n], velocity, atol=1e-3)
    # The rates are those of the positions: differences of second order in the step.
    differences, rates = np.gradient(made.positions, STEP, axis=0), made.velocities
    np.testing.assert_allclose(differences[1:-1], rates[1:-1], atol=0.02 * np.abs(rates).max())


def test_a_stretched_path_is_slower_in_proportion(station: Station, dynamics: ArmDynamics) -> None:
    down = line(np.zeros(6), np.array([0.0, 0.0, -0.1, 0.0, 0.0, 0.0]), 0.5)
    _, fast = _path(station, dynamics, down, 0.5)
    _, slow = _path(station, dynamics, down, 0.5, stretch=2.0)
    assert slow.duration == pytest.approx(2.0 * fast.duration)
    slow_use, fast_use = use_of_limits(slow, station.arm), use_of_limits(fast, station.arm)
    assert slow_use[0] == pytest.approx(fast_use[0] / 2.0, rel=0.01)
    assert slow_use[1] == pytest.approx(fast_use[1] / 4.0, rel=0.05)


def test_a_path_beyond_the_reach_is_none(station: Station, dynamics: ArmDynamics) -> None:
    away = line(np.zeros(6), np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1.0)
    assert _path(station, dynamics, away, 1.0)[1] is None
    assert _path(station, dynamics, rest_at(np.zeros(6)), 0.1)[1] is not None
