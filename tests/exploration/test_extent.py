"""Extent of an object on a table: its ends are found, named while they are sought, and closed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import HALF_SPACE, Contacts
from lis_grasp.exploration import (
    Exploration,
    ExplorationStrategy,
    Landmark,
    Observation,
    Probe,
    ProbeOutcome,
    Region,
    TactilePerception,
    TactileSensor,
    begin,
    explore,
)
from lis_grasp.exploration.extent import End, ends_of, extent_probe, open_ends, unseen_ends
from lis_grasp.exploration.strategy import choose
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.touch import make_policy
from lis_grasp.surfaces import ESTIMATORS, carved

REGION = Region(tip_radius=0.004)
X, Y, UP = np.eye(3)
AXES = np.vstack([np.eye(3), -np.eye(3)])


def touched(point: np.ndarray, normal: np.ndarray) -> ProbeOutcome:
    """Return a touch against a normal."""
    contacts = Contacts(np.array([point]), np.array([normal]))
    return ProbeOutcome(Probe(point, -normal, 0.1, 0.05), "touched", contacts)


def replayed(outcomes: list[ProbeOutcome]) -> Exploration:
    return Exploration.replay(list(map(Observation, outcomes)))


def probe_after(outcomes: list[ProbeOutcome]) -> Probe | None:
    contacts = replayed(outcomes).contacts
    return extent_probe(REGION.fitted_to(contacts), contacts, outcomes)


def explored(mesh: trimesh.Trimesh, seed: int, touches: int = 8) -> Exploration:
    """Explore an object in a region."""
    strategy = ExplorationStrategy(
        make_policy("spread", Region(), TactileSensor()), touches, Region()
    )
    prober = KinematicProber(Hand.load("allegro"), mesh)
    return explore(prober, TactilePerception(ESTIMATORS["gpis"]), strategy, rng=seed)


def bar_on_table() -> trimesh.Trimesh:
    bar = trimesh.creation.box((0.24, 0.03, 0.03))
    return bar.apply_translation([0.0, 0.0, 0.015])


@pytest.mark.parametrize(
    "yaw",
    [pytest.param(0.0, marks=pytest.mark.slow), 0.6, pytest.param(2.1, marks=pytest.mark.slow)],
)
def test_both_ends_of_a_bar_are_touched_first(yaw: float) -> None:
    bar = bar_on_table()
    turn = trimesh.transformations.rotation_matrix(yaw, UP)
    bar.apply_transform(turn)
    exploration = explored(bar, 1)
    # Eight touches a step apart on one side would reach over less: a step is at most 60 mm.
    assert np.ptp(exploration.contacts.points @ turn[:3, 0]) > 0.23


def test_space_beyond_a_closed_end_is_free_and_carved_off_the_estimate() -> None:
    exploration = explored(bar_on_table(), 1)
    contacts = exploration.contacts
    is_half_space = contacts.free_radii == HALF_SPACE
    # Free space begins 3 mm beyond each end that a motion found, and beyond no contact.
    assert 2 <= np.count_nonzero(is_half_space) <= 4
    depths = HALF_SPACE - np.linalg.norm(
        contacts.points[:, None] - contacts.free_points[is_half_space], axis=2
    )
    assert depths.max(axis=0) == pytest.approx(-0.003, abs=1e-9)
    ball = ESTIMATORS["gpis"](Contacts(0.2 * np.vstack([np.eye(3), -np.eye(3)]), AXES))
    outside = np.array([0.125, 0.0, 0.0])
    assert ball.evaluate(outside) < 0.0 < carved(ball, contacts).evaluate(outside)


def test_after_the_first_contact_height_and_far_side_are_probed_then_the_ends() -> None:
    outcomes = [touched(np.array([0.0, -0.02, 0.02]), -Y)]
    down = probe_after(outcomes)
    np.testing.assert_allclose(down.direction, -UP)
    np.testing.assert_allclose(down.target[:2], [0.0, -0.008])
    outcomes.append(touched(np.array([0.0, -0.008, 0.04]), UP))
    far = probe_after(outcomes)
    np.testing.assert_allclose(far.direction, -Y, atol=1e-12)
    outcomes.append(touched(np.array([0.0, 0.02, 0.02]), Y))
    end = probe_after(outcomes)
    assert abs(end.direction @ X) == pytest.approx(1.0)
    assert end.target[2] == pytest.approx(0.02)  # half of the height


def test_a_motion_down_that_cannot_begin_begins_higher_and_tall_objects_need_no_sweeps() -> None:
    first = touched(np.array([0.0, -0.02, 0.02]), -Y)
    blocked = ProbeOutcome(probe_after([first]), "blocked", reason="no start")
    again = probe_after([first, blocked])
    np.testing.assert_allclose(again.direction, -UP)
    assert again.start[2] > blocked.probe.start[2]
    top = touched(np.array([0.0, -0.008, 0.22]), UP)
    assert probe_after([first, blocked, top]).target[2] == pytest.approx(0.11)
    ends = [touched(np.array([x, 0.0, 0.1]), np.sign(x) * X) for x in (-0.04, 0.04)]
    far = touched(np.array([0.0, 0.02, 0.1]), Y)
    assert probe_after([first, top, far, *ends]) is None


def test_an_end_is_sought_until_a_contact_faces_out_or_three_motions_failed() -> None:
    sides = [touched(np.array([0.0, y, 0.02]), np.sign(y) * Y) for y in (-0.02, 0.02)]
    near = touched(np.array([-0.1, 0.0, 0.02]), -X)
    contacts = replayed([*sides, near]).contacts
    space = REGION.fitted_to(contacts)
    assert [bool(e.is_open) for e in ends_of(space, contacts, [*sides, near])].count(True) == 1
    assert "x = 0," in open_ends(space, contacts, [*sides, near])
    missed = ProbeOutcome(Probe(np.array([0.0, 0.0, 0.02]), -X, 0.1, 0.05), "missed")
    assert open_ends(space, contacts, [*sides, near, missed, missed, missed]) == ""
    both = replayed([*sides, near, touched(np.array([0.1, 0.0, 0.02]), X)])
    assert open_ends(space, both.contacts, both.outcomes) == ""


def test_an_end_without_contact_and_without_free_space_may_displace_the_centre_of_mass() -> None:
    # Both long sides of a bar along x from 0 to 80 mm, and its end at x = 0.
    places = [np.array([x, side * 0.01, 0.02]) for x in (0.01, 0.04, 0.08) for side in (-1.0, 1.0)]
    sides = Contacts(np.array(places), np.array([np.sign(p[1]) * Y for p in places]))
    known = sides.append(Contacts(np.array([[0.0, 0.0, 0.02]]), -X[None]))
    (end,) = unseen_ends(REGION.fitted_to(known), known)
    assert "x = 80," in str(end)
    np.testing.assert_allclose(end.displacement, [0.25 * 0.08, 0.0, 0.0], atol=1e-3)
    assert len(unseen_ends(REGION.fitted_to(sides), sides)) == 2
    beyond = np.array([[0.1, 0.0, 0.02]])
    passed = replace(known, free_points=beyond, free_radii=np.array([0.015]))
    assert unseen_ends(REGION.fitted_to(passed), passed) == ()


def test_a_sweep_beyond_the_end_of_a_long_object_opens_it_again_where_it_touches() -> None:
    outcomes = [
        touched(np.array([0.0, -0.02, 0.02]), -Y),
        touched(np.array([0.0, 0.0, 0.04]), UP),
        touched(np.array([0.0, 0.02, 0.02]), Y),
        touched(np.array([0.1, 0.0, 0.02]), X),
        touched(np.array([-0.1, 0.0, 0.02]), -X),
    ]
    sweep = probe_after(outcomes)
    assert abs(sweep.direction @ Y) == pytest.approx(1.0)
    side = np.sign(sweep.target[0])
    assert abs(sweep.target[0]) > 0.12
    jaw = np.array([1.25 * side * 0.1, 0.01, 0.02])
    met = ProbeOutcome(sweep, "touched", Contacts(jaw[None], -sweep.direction[None]))
    again = probe_after([*outcomes, met])
    np.testing.assert_allclose(again.direction, -side * X, atol=0.1)
    free = ProbeOutcome(sweep, "missed")
    other = probe_after([*outcomes, free])
    assert np.sign(other.target[0]) == -side
    assert probe_after([*outcomes, free, ProbeOutcome(other, "missed")]) is None


@pytest.mark.slow
def test_a_stop_rule_waits_for_the_ends_and_the_reason_names_them() -> None:
    bar = trimesh.creation.box((0.24, 0.03, 0.03)).apply_translation([0.0, 0.0, 0.015])
    perception = TactilePerception(ESTIMATORS["gpis"])
    strategy = ExplorationStrategy(
        make_policy("spread", Region(), TactileSensor()),
        20,
        Region(),
        stop=[lambda contacts, surface, outcomes: "at once"],
    )
    prober = KinematicProber(Hand.load("allegro"), bar)
    ended = explore(prober, perception, strategy, rng=1)
    assert ended.ended == "at once"
    assert np.ptp(ended.contacts.points[:, 0]) > 0.23
    found = explored(bar, 1, touches=2)
    assert "not found: the end beyond" in found.ended
    missed = ProbeOutcome(Probe(5.0 * UP, -UP, 0.1, 0.05), "missed")  # before the first contact
    space = Region(tip_radius=0.004)
    nothing_left = SimpleNamespace(next_probe=lambda *_, **__: None)
    probes = 32 + len(found.observations)
    for count, ended in ((0, "the policy has no probe left; not"), (32, f"{probes} probes made; ")):
        strategy = ExplorationStrategy(nothing_left, 3, space)
        recorded = [Observation(missed)] * count + list(found.observations)
        state = begin(perception, strategy, recorded)
        assert str(choose(strategy, state, rng=np.random.default_rng(0))).startswith(ended)


def test_landmarks_count_as_motions_inward_and_show_where_an_end_was_touched() -> None:
    sides = [touched(np.array([0.0, y, 0.02]), np.sign(y) * Y) for y in (-0.02, 0.02)]
    far = touched(np.array([0.1, 0.01, 0.02]), np.array([0.6, 0.0, 0.8]))  # closes no end
    contacts = replayed([*sides, far]).contacts
    space = REGION.fitted_to(contacts)
    elsewhere = touched(np.array([0.05, 0.03, 0.02]), X)
    landmarks = [Landmark(elsewhere.probe, elsewhere.contacts)] * 3
    for count, is_open in ((0, True), (2, True), (3, False)):
        end = End(X, space, contacts, (), landmarks[:count])
        assert end.met == ["touched"] * count
        assert end.is_open is is_open
        # Where nothing inward was met, a motion goes along the middle of what is known.
        assert end.inward().target[1] == pytest.approx(0.01 if count else 0.0)
