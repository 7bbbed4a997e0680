"""Tactile sensor: reported touches against the configured statistics."""

from dataclasses import replace

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    Exploration,
    HandPose,
    Observation,
    Probe,
    ProbeOutcome,
    TactileSensor,
)
from lis_grasp.exploration.tactile_sensor import UNKNOWN

COUNT = 20_000
UP = np.array([0.0, 0.0, 1.0])
PLANE = Contacts(np.zeros((COUNT, 3)), np.tile(UP, (COUNT, 1)), forces=np.linspace(0, 1, COUNT))


def sense(sensor: TactileSensor, seed: int = 0) -> Contacts:
    return sensor.sense(PLANE, rng=np.random.default_rng(seed))


def test_a_perfect_sensor_reports_what_there_is() -> None:
    reported = sense(TactileSensor())
    np.testing.assert_array_equal(reported.points, PLANE.points)
    np.testing.assert_array_equal(reported.normals, PLANE.normals)


def test_noise_is_as_large_as_it_is_said_to_be() -> None:
    reported = sense(TactileSensor(position_noise=0.002, normal_noise=0.05))
    # 60 000 and 40 000 draws: known to 0.3 and 0.35 %; three times that. tan is 0.1 % above.
    assert reported.points.std() == pytest.approx(0.002, rel=0.01)
    tilts = reported.normals[:, :2] / reported.normals[:, 2:]
    assert tilts.std() == pytest.approx(0.05, rel=0.012)


def test_contacts_carry_the_noise_of_their_sensor() -> None:
    reported = sense(TactileSensor(position_noise=0.002, normal_noise=0.05))
    np.testing.assert_array_equal(reported.position_noise, np.full(COUNT, 0.002))
    np.testing.assert_array_equal(reported.normal_noise, np.full(COUNT, 0.05))
    only_positions = sense(TactileSensor(position_noise=0.002))
    assert only_positions.normal_noise is None
    assert sense(TactileSensor()).position_noise is None


def test_taxels_move_contacts_along_the_surface_within_half_a_pitch() -> None:
    reported = sense(TactileSensor(taxel_pitch=0.004))
    np.testing.assert_array_equal(reported.points[:, 2], 0.0)
    assert np.abs(reported.points).max() <= 0.002
    # The deviation of an even spread over a pitch.
    assert reported.points[:, :2].std() == pytest.approx(0.004 / np.sqrt(12.0), rel=0.01)


def test_weak_touches_are_not_felt_and_some_are_missed() -> None:
    assert len(sense(TactileSensor(force_threshold=0.25))) == COUNT * 3 // 4
    rate = len(sense(TactileSensor(miss_rate=0.3))) / COUNT
    # A rate of 0.7 in 20 000 draws has a standard deviation of 0.3 %.
    assert rate == pytest.approx(0.7, abs=0.01)
    unknown = Contacts(PLANE.points, PLANE.normals)
    sensor = TactileSensor(force_threshold=10.0)
    assert len(sensor.sense(unknown, rng=np.random.default_rng(0))) == COUNT


def test_two_contacts_across_an_edge_share_the_force_on_a_pad() -> None:
    rng = np.random.default_rng(0)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    both = Contacts(np.zeros((2, 3)), normals, forces=np.array([0.03, 0.04]), fingers=("a", "a"))
    sensor = TactileSensor(force_threshold=0.05)
    assert len(sensor.sense(both, rng=rng)) == 2
    assert len(sensor.sense(replace(both, fingers=("a", "b")), rng=rng)) == 0
    assert len(sensor.sense(replace(both, fingers=()), rng=rng)) == 0


def test_the_same_draws_give_the_same_report() -> None:
    sensor = TactileSensor(position_noise=0.001, normal_noise=0.02, miss_rate=0.1)
    np.testing.assert_array_equal(sense(sensor, 3).points, sense(sensor, 3).points)
    assert not np.array_equal(sense(sensor, 3).points, sense(sensor, 4).points)


PROBE = Probe([0.0, 0.0, 0.0], -UP, 0.03, 0.02)
FREE = np.array([[0.0, 0.0, 0.03], [0.0, 0.0, 0.02]])
TOUCHED = ProbeOutcome(PROBE, "touched", Contacts([[0.0, 0.0, 0.0]], [UP]), FREE)
MISSED = ProbeOutcome(PROBE, "missed", free_points=FREE)


def report(outcome: ProbeOutcome, sensor: TactileSensor) -> ProbeOutcome:
    return sensor.report(outcome, rng=np.random.default_rng(0))


def test_an_undetected_touch_blocks_the_probe() -> None:
    outcome = report(TOUCHED, TactileSensor(miss_rate=1.0))
    assert outcome.status == "blocked"
    assert not len(outcome.contacts)
    np.testing.assert_array_equal(outcome.free_points, FREE)  # free up to the touch


def test_a_reported_touch_keeps_the_hand_pose() -> None:
    pose = HandPose(np.eye(4), np.zeros(2))
    sensed = report(replace(TOUCHED, hand_pose=pose), TactileSensor(position_noise=0.001))
    assert sensed.hand_pose is pose
    assert report(MISSED, TactileSensor(false_rate=1.0)).hand_pose is None


def test_a_false_touch_is_on_the_path_and_faces_the_finger() -> None:
    outcome = report(MISSED, TactileSensor(false_rate=1.0))
    assert outcome.status == "touched"
    np.testing.assert_array_equal(outcome.contacts.normals, [UP])
    x, y, z = outcome.contacts.points[0]
    assert x == y == 0.0
    assert -0.02 <= z <= 0.03
    assert report(MISSED, TactileSensor()).status == "missed"


def test_a_false_touch_keeps_the_columns_of_true_ones() -> None:
    sensor = TactileSensor(false_rate=1.0, force_threshold=0.2, position_noise=0.001)
    false = report(MISSED, sensor)
    np.testing.assert_array_equal(false.contacts.position_noise, [0.001])
    known = Contacts([[0.0, 0.0, 0.0]], [UP], forces=[0.3], fingers=("tip",), times=[0.5])
    true = ProbeOutcome(PROBE, "touched", contacts=known, duration=2.0)
    later = replace(true, contacts=replace(known, points=[[0.1, 0.0, 0.0]]))
    contacts = Exploration.replay(list(map(Observation, (true, false, later)))).contacts
    np.testing.assert_array_equal(contacts.forces, [0.3, 0.2, 0.3])
    assert contacts.fingers == ("tip", UNKNOWN, "tip")
    assert np.all(np.diff(contacts.times) >= 0.0)
    # The hand stops there, so free space ends there.
    stop = (false.contacts.points[0] - PROBE.target) @ PROBE.direction
    beyond = (FREE - PROBE.target) @ PROBE.direction > stop
    np.testing.assert_array_equal(false.free_points, FREE[~beyond])


def test_a_blocked_probe_is_reported_as_it_is() -> None:
    blocked = ProbeOutcome(PROBE, "blocked")
    assert report(blocked, TactileSensor(false_rate=1.0)) is blocked


@pytest.mark.parametrize(
    ("option", "value"),
    [("position_noise", -1e-3), ("taxel_pitch", float("nan")), ("miss_rate", 1.5)],
)
def test_an_invalid_sensor_is_refused(option: str, value: float) -> None:
    with pytest.raises(InvalidOptionError) as error:
        TactileSensor(**{option: value})
    assert error.value.option == option
