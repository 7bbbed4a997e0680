"""Pace of touches: quick only where the object resisted, and on ways that were passed before."""

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.pace import pace_of
from lis_grasp.exploration.probe import PassedWay, Probe, ProbeOutcome
from lis_grasp.geometry import make_pose

X, Y, DOWN = np.eye(3)[0], np.eye(3)[1], -np.eye(3)[2]


def touched(direction: np.ndarray, resisted: bool | None) -> ProbeOutcome:
    """Return the outcome of a probe that met a face square to its motion."""
    contacts = Contacts([[0.0, 0.0, 0.0]], [-direction])
    probe = Probe(np.zeros(3), direction, 0.02, 0.02)
    return ProbeOutcome(probe, "touched", contacts, resisted=resisted)


def turned(degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def test_a_direction_without_an_answer_is_tested() -> None:
    assert pace_of(X, []) == "tested"
    assert pace_of(X, [touched(Y, True), touched(X, None)]) == "tested"


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_resists_one_way_is_touched_quickly_both_ways(way: float) -> None:
    assert pace_of(way * X, [touched(X, True)]) == "quick"


def test_what_yielded_once_is_touched_gently_though_it_resisted_too() -> None:
    assert pace_of(X, [touched(X, True), touched(X, False), touched(X, True)]) == "gentle"


def test_a_cylinder_on_its_side_is_quick_along_its_axis_alone() -> None:
    outcomes = [touched(X, True), touched(Y, False)]
    assert (pace_of(X, outcomes), pace_of(Y, outcomes)) == ("quick", "gentle")


@pytest.mark.parametrize(("degrees", "pace"), [(29.0, "quick"), (31.0, "tested"), (151.0, "quick")])
def test_directions_within_thirty_degrees_are_one(degrees: float, pace: str) -> None:
    assert pace_of(turned(degrees), [touched(X, True)]) == pace


@pytest.mark.parametrize(
    ("answers", "pace"), [((), "gentle"), ((True,), "quick"), ((True, False), "gentle")]
)
def test_a_steep_probe_is_quick_if_every_touch_was_resisted(
    answers: tuple[bool, ...], pace: str
) -> None:
    outcomes = [touched(one, answer) for one, answer in zip((X, Y), answers, strict=False)]
    assert pace_of(DOWN, outcomes) == pace


def test_a_touch_from_above_says_nothing_of_level_pushes() -> None:
    assert pace_of(X, [touched(DOWN, True)]) == "tested"


def test_a_touch_whose_contact_was_dropped_says_nothing() -> None:
    probe = Probe(np.zeros(3), X, 0.02, 0.02)
    assert pace_of(X, [ProbeOutcome(probe, "blocked", resisted=True)]) == "tested"


def test_a_passed_way_ends_its_margin_before_the_touch() -> None:
    way = PassedWay(make_pose(np.eye(3), [0.3, 0.0, 0.1]), margin=0.012)
    start = make_pose(np.eye(3), [0.1, 0.0, 0.1])
    assert way.length_from(start, X) == pytest.approx(0.2 - 0.012, abs=1e-12)
    assert way.length_from(start, -X) == 0.0  # the touch is behind


@pytest.mark.parametrize(
    ("moved", "turn", "passes"), [(0.004, 0.0, True), (0.006, 0.0, False), (0.0, 5.0, False)]
)
def test_a_way_is_passed_again_only_by_the_same_hand_on_the_same_line(
    moved: float, turn: float, passes: bool
) -> None:
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    way = PassedWay(make_pose(np.eye(3), [0.3, 0.0, 0.1]), margin=0.0)
    assert (way.length_from(make_pose(R, [0.1, moved, 0.1]), X) > 0.0) is passes


def test_a_passed_way_moves_with_its_probe() -> None:
    way = PassedWay(make_pose(np.eye(3), [0.3, 0.0, 0.1]), margin=0.01)
    probe = Probe(np.array([0.3, 0.0, 0.1]), X, 0.2, 0.0, passed=way)
    c, s = np.cos(0.3), np.sin(0.3)
    X_EF = make_pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), [0.02, -0.01, 0.0])
    there = probe.in_frame(X_EF)
    assert there.passed is not None
    start = np.linalg.inv(X_EF) @ make_pose(np.eye(3), [0.1, 0.0, 0.1])
    length = way.length_from(make_pose(np.eye(3), [0.1, 0.0, 0.1]), X)
    assert there.passed.length_from(start, there.direction) == pytest.approx(length, abs=1e-12)


def test_a_negative_margin_is_refused() -> None:
    with pytest.raises(InvalidOptionError, match="margin"):
        PassedWay(np.eye(4), margin=-0.01)
