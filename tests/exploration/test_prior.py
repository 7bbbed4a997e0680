"""Prior knowledge beside touches: what was seen and guessed is no touch."""

from dataclasses import dataclass, replace

import numpy as np
from analytic_surfaces import Analytic, cube_bounds, sphere
from numpy.testing import assert_array_equal
from random_directions import random_directions

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Probe, ProbeOutcome, TactilePerception, Workspace, advance, begin
from lis_grasp.exploration.calibrating import calibrating_target
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.prior import NOTHING, PriorKnowledge, as_prior, estimated_from
from lis_grasp.exploration.targets import Targets
from lis_grasp.records import Record
from lis_grasp.surfaces.carved_implicit_surface import Balls, BelowTable
from lis_grasp.typing import FloatArray

RADIUS = 0.04
BALL = Analytic(sphere(RADIUS), cube_bounds(0.08))


def on_ball(count: int, seed: int) -> Contacts:
    directions = random_directions(count, np.random.default_rng(seed))
    return Contacts(RADIUS * directions, directions)


@dataclass(frozen=True, slots=True, eq=False)
class Counting(Record):
    """Knows as many seen contacts as there are touches, and one more."""

    def given(self, touches: Contacts) -> PriorKnowledge:
        return PriorKnowledge(seen=on_ball(len(touches) + 1, 1), guesses=on_ball(3, 2))


def touched(direction: FloatArray) -> ProbeOutcome:
    contact = Contacts(RADIUS * direction[None], direction[None])
    return ProbeOutcome(Probe(contact.points[0], -direction, 0.05, 0.02), "touched", contact)


def test_contacts_known_beforehand_are_judged_with_the_touches() -> None:
    cloud = on_ball(5, 0)
    assert as_prior(None) is NOTHING
    assert as_prior(cloud).given(Contacts.empty()).touched == cloud
    calls = []
    estimated_from(lambda contacts: calls.append(contacts) or BALL, cloud, PriorKnowledge(cloud))
    assert calls == [cloud]


def test_an_estimator_gets_what_was_seen_apart_from_what_was_touched() -> None:
    seen, before, touches = on_ball(4, 0), on_ball(3, 1), on_ball(2, 2)
    prior = PriorKnowledge(touched=before, seen=seen, guesses=on_ball(6, 3))
    known = prior.contacts.append(touches)
    calls = []

    def make(contacts: Contacts, prior: PriorKnowledge) -> Analytic:
        calls.append((contacts, prior))
        return BALL

    DeferredEstimate(make, known, prior=prior).evaluate(np.zeros(3))
    assert calls == [(before.append(touches), prior)]


def test_knowledge_follows_the_touches_and_is_no_part_of_the_result() -> None:
    perception = TactilePerception(lambda contacts, prior: BALL, prior=Counting())
    state = begin(perception)
    assert (len(state.known), len(state.touched), len(state.contacts)) == (1, 0, 0)
    for number, direction in enumerate(np.eye(3), start=1):
        state = advance(perception, state, touched(direction))
        assert (len(state.known), len(state.touched)) == (2 * number + 1, number)
    assert_array_equal(state.result.contacts.points, RADIUS * np.eye(3))
    again = begin(perception, recorded=state.observations)
    assert again.known == state.known


def test_targets_are_far_from_what_was_measured_and_not_from_guesses() -> None:
    space, everywhere = Workspace(0.02, np.zeros(3), 2.0 * RADIUS), on_ball(200, 0)
    is_seen = everywhere.points[:, 2] > -0.5 * RADIUS
    seen, guessed = everywhere.subset(is_seen), everywhere.subset(~is_seen)
    prior = PriorKnowledge(seen=seen, guesses=guessed)
    estimate = DeferredEstimate(lambda contacts, prior: BALL, seen, prior=prior)
    targets = Targets.find(space, seen, estimate, ())
    assert targets.points[np.argmax(targets.nearest), 2] < -0.9 * RADIUS


def test_space_that_was_seen_to_be_free_has_no_targets_and_is_carved_off() -> None:
    space = Workspace(0.02, np.zeros(3), 2.0 * RADIUS)
    seen = on_ball(50, 0)
    free = Balls(np.array([[RADIUS, 0.0, 0.0]]), np.array([0.02]))
    prior = PriorKnowledge(seen=seen, free=(free,))
    estimate = DeferredEstimate(lambda contacts, prior: BALL, seen, prior=prior)
    targets = Targets.find(space, seen, estimate, ())
    inside = np.linalg.norm(targets.points - free.centers, axis=1) < 0.015
    assert inside.any()
    assert not targets.eligible[inside].any()
    left = estimate.without_free_space(seen)
    assert left.evaluate(np.array([RADIUS - 0.005, 0, 0])) > 0.0
    assert left.uncertainty(np.array([RADIUS - 0.02, 0, 0])) > 0.015


def test_the_depth_below_a_table_is_that_of_a_half_space() -> None:
    depths, slopes = BelowTable(0.1).depths(np.array([[1.0, 2.0, 0.07], [0.0, 0.0, 0.2]]))
    np.testing.assert_allclose(depths, [0.03, -0.1])
    assert_array_equal(slopes, [[0, 0, -1], [0, 0, -1]])


def seen_from_above(noise: float) -> Contacts:
    seen = on_ball(400, 0)
    seen = seen.subset(seen.points[:, 2] > -0.2 * RADIUS)
    aside = np.abs(seen.normals[:, 0])  # the camera's place is uncertain along x
    return replace(seen, position_noise=noise * aside + 2e-4, normal_noise=np.full(len(seen), 0.1))


def first_target(noise: float, touches: int) -> FloatArray | None:
    space, seen = Workspace(0.02, np.zeros(3), 2.0 * RADIUS), seen_from_above(noise)
    estimate = DeferredEstimate(lambda contacts, prior: BALL, seen, prior=PriorKnowledge(seen=seen))
    targets = Targets.find(space, seen, estimate, ())
    i = calibrating_target(targets, seen, touches)
    return None if i is None else targets.points[i]


def test_the_first_touches_are_where_the_place_of_what_was_seen_is_least_certain() -> None:
    place = first_target(0.003, 0)
    assert place is not None
    assert abs(place[0]) > 0.8 * RADIUS
    assert first_target(0.003, 1) is first_target(0.003, 2) is None  # for what was not seen
    assert first_target(0.003, 3) is not None
    assert first_target(0.003, 6) is not None
    assert first_target(0.003, 9) is None  # enough
    assert first_target(0.0005, 0) is None  # a touch is no better
