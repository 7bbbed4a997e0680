"""Motion of the object in the report: against a known motion, and in words."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Exploration, Observation, Probe, ProbeOutcome, begin
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.pipeline import RunConfig, Scenario
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.results.report import motion_facts
from lis_grasp.results.summary import motion_line
from lis_grasp.stages.touch import (
    make_perception,
    make_prober,
    make_strategy,
    make_tracker,
    touch_steps,
    true_pose,
)

BOX = shapes.build("box", 0.06)
FIXED = Scenario.from_config(RunConfig(), BOX)
FREE = Scenario.from_config(RunConfig(free=True), BOX)
SIDE = float(BOX.mesh.bounds[1, 0])
PROBE = Probe([SIDE, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.02, 0.02)
SHIFT = planar_pose(np.array([0.002, 0.0, 0.0]))


def explored(belief: PoseBelief | None) -> Exploration:
    contacts = Contacts([[SIDE, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    outcome = ProbeOutcome(PROBE, "touched", contacts, moved=0.003)
    return Exploration(contacts, (Observation(outcome, belief),))


def facts_of(X_EO: np.ndarray, belief: PoseBelief | None) -> dict[str, Any]:
    """Return the facts of a free object that touches moved to a true pose."""
    exploration = explored(belief)
    return motion_facts(FREE.after(exploration, X_EO), exploration)


def test_a_fixed_object_has_no_motion() -> None:
    after = FIXED.after(explored(None), None)
    assert motion_facts(after, explored(None)) is None
    assert after.truth.shape_now is BOX


def test_an_unnoticed_motion_is_an_error() -> None:
    facts = facts_of(SHIFT, None)
    assert facts["displacement"] == pytest.approx(0.002)
    # The two faces across the motion are 2 mm off, the four others lie in themselves.
    assert 0.0002 < facts["tracking_error"] < 0.001
    assert facts["contact_error"] == pytest.approx(0.002)
    error = 1e3 * facts["tracking_error"]
    said = f"tracking error {error:.2f} mm; contact error 2.00 mm; not tracked"
    assert said in motion_line(facts)
    moved = FREE.after(explored(None), SHIFT).truth.shape_now
    np.testing.assert_allclose(moved.mesh.bounds, BOX.mesh.bounds + [0.002, 0.0, 0.0])


def test_a_tracked_motion_is_no_error() -> None:
    belief = replace(PoseBelief.start(), X_WE=SHIFT, repeated=True)
    facts = facts_of(np.eye(4), belief)
    assert facts["displacement"] == pytest.approx(0.002)
    assert facts["tracking_error"] == pytest.approx(0.0, abs=1e-9)
    assert facts["repeated_probes"] == 1
    assert "tracking error 0.00 mm; contact error 0.00 mm" in motion_line(facts)


def test_after_a_loss_only_contacts_have_an_error() -> None:
    belief = replace(PoseBelief.start(), trust="lost")
    facts = facts_of(SHIFT, belief)
    assert facts["tracking_error"] is None
    assert "lost 1 time" in motion_line(facts)


@pytest.mark.slow
def test_an_object_that_was_knocked_away_is_found_on_its_map() -> None:
    # Turned by 180 degrees a box would fit as well; the mallet does not.
    config = RunConfig("mallet", **{**UNKNOWN, "free": True}, mass=0.05, touches=20, seed=13)
    scenario = Scenario.from_config(config)
    prober, knocked = make_prober(scenario), False
    for state in touch_steps(scenario, prober):
        if len(state.contacts) >= 12 and not knocked:
            knocked, X_EO = True, true_pose(prober)
            X = planar_pose(np.array([0.0, 0.0, 1.2])) @ X_EO
            X[:3, 3] = X_EO[:3, 3] + [0.04, -0.03, 0.0]
            prober.place_object(X)
    assert any(observation.is_joined for observation in state.observations)
    facts = motion_facts(scenario.after(state.result, true_pose(prober)), state.result)
    assert max(facts["tracking_error"], facts["contact_error"]) < 5e-3  # of 50 mm and 70 degrees
    # What is read from the log is the same state.
    perception = make_perception(scenario.agent.perception)
    perception = replace(perception, tracker=make_tracker(scenario, prober))
    again = begin(perception, make_strategy(scenario.agent), state.observations)
    np.testing.assert_array_equal(again.contacts.points, state.contacts.points)
