"""Lifts with an arm: held within its limits, and stopped for the right reasons."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.trajectory import JointTrajectory
from lis_grasp.arms.use import violations
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.setup import ArmLift, LiftSetup, plan_arm_lift
from lis_grasp.motion import arm_body
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.lift import simulate_lift

BOX = trimesh.creation.box(extents=[0.05, 0.06, 0.10])
HEIGHT = -0.05
QUICK = LiftOptions(hold_time=0.3, shake_accelerations=(9.81,))
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def station() -> Station:
    return choose_base(Arm.load("iiwa14"), Hand.load("wsg50"), table=Table(HEIGHT))


@pytest.fixture(scope="module")
def grasp(station: Station) -> Grasp:
    sampler = ForceClosureSampler(station.hand, station=station, candidates=300)
    rng = np.random.default_rng(0)
    return sampler.sample(BOX, rng=rng, support_height=HEIGHT, count=1).grasps[0]


@pytest.fixture(scope="module")
def planned(station: Station, grasp: Grasp) -> ArmLift:
    lift = plan_arm_lift(station, grasp, BOX, time_step=QUICK.time_step)
    assert isinstance(lift, ArmLift)
    return lift


def lifted(grasp: Grasp, arm: ArmLift, **conditions: np.ndarray) -> LiftOutcome:
    hand = arm.station.hand
    return simulate_lift(LiftSetup(BOX, hand, grasp, HEIGHT, options=QUICK, arm=arm, **conditions))


def test_an_arm_lifts_and_holds_within_its_limits(grasp: Grasp, planned: ArmLift) -> None:
    outcome = lifted(grasp, planned)
    assert outcome.reason == "held"
    use = outcome.arm
    assert use.steps == round(outcome.duration / QUICK.time_step)
    assert use.effort < 1.0
    assert use.speed < 1.0
    assert use.palm_error < 0.005
    assert use.contacts == {}
    assert [shake.asked for shake in use.shakes] == [9.81] * 6
    assert all(0.0 < shake.by_motion <= shake.asked for shake in use.shakes)
    # The arm cannot make 1 g along every axis: its acceleration limits are below.
    assert min(shake.by_motion for shake in use.shakes) < 9.0
    # The recorded arm is rigid with the hand: the flange carries the base link.
    station = planned.station
    flange = outcome.motion.poses[arm_body(station.arm.flange)]
    base = outcome.motion.poses[station.hand.base_link]
    expected = flange @ station.arm.X_LF @ station.mount.X_FB
    np.testing.assert_allclose(base, expected, atol=1e-6)


def test_a_weak_arm_stops_at_its_torque_limit(grasp: Grasp, planned: ArmLift) -> None:
    arm = planned.station.arm
    weak = replace(planned.station, arm=replace(arm, effort_limits=0.15 * arm.effort_limits))
    lift = replace(planned, station=weak)
    outcome = lifted(grasp, lift)
    assert outcome.reason == "torque_limit"
    assert outcome.arm.effort == pytest.approx(1.0, abs=1e-3)


def test_an_arm_that_hits_the_table_stops(grasp: Grasp, planned: ArmLift) -> None:
    home = planned.transit.positions[0]
    down = home.copy()
    down[1] += 1.9  # the shoulder bends over, and the hand's mount goes into the table
    parts = np.linspace(0.0, 1.0, 401)[:, None]
    rates = np.tile((down - home) / 2.0, (401, 1))
    times, q = QUICK.time_step * np.arange(401), home + parts * (down - home)
    path = JointTrajectory(planned.transit.joint_names, times, q, rates, np.zeros((401, 7)))
    far = np.eye(4)
    far[:3, 3] = 0.0, 0.5, 0.0  # the object is out of the way
    outcome = lifted(grasp, replace(planned, transit=path), X_WO=far)
    assert outcome.reason in ("arm_collision", "torque_limit")
    assert any("table" in pair for pair in outcome.arm.contacts)


def test_a_hand_that_comes_too_near_is_a_violation(station: Station, grasp: Grasp) -> None:
    X_OH = np.array(grasp.X_OH)
    X_OH[:3, 3] += 0.03 * np.asarray(grasp.approach_O)  # deeper than planned
    deeper = replace(grasp, X_OH=X_OH)
    lift = plan_arm_lift(station, deeper, None, time_step=QUICK.time_step)
    assert isinstance(lift, ArmLift)
    outcome = lifted(deeper, lift)
    assert any("object" in pair for pair in outcome.arm.contacts)
    assert any("object" in said for said in violations([asdict(outcome.arm)]))


def test_a_grasp_that_is_given_up_ends_at_home(grasp: Grasp, planned: ArmLift) -> None:
    station = planned.station
    outcome = simulate_lift(
        LiftSetup(BOX, station.hand, grasp, support_height=HEIGHT, options=QUICK, arm=planned),
        lambda measured: False,
    )
    assert outcome.reason == "aborted"
    assert outcome.arm.contacts == {}
    assert outcome.arm.speed < 1.0
    flange = outcome.motion.poses[arm_body(station.arm.flange)]
    np.testing.assert_allclose(flange[-1], flange[0], atol=5e-3)
