"""After a lift, bodies are where it pushed them, and the robot looks again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from worlds import blocks

from lis_grasp.contacts import Contacts
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.results.report import world_facts
from lis_grasp.stages.regrasp import Attempt
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task

ERROR = 0.002  # [m]


@pytest.fixture
def scenario() -> Scenario:
    bodies = blocks(0.03, table=-0.06)
    made = Scenario.from_config(Task.of("box", hand="wsg50", body_error=ERROR))
    return replace(
        made, truth=replace(made.truth, surroundings=bodies), agent=made.agent.knowing(bodies)
    )


def pushed(scenario: Scenario, by: float) -> LiftOutcome:
    """Return the outcome of a lift that pushed the eastern block along x [m] with 5 N."""
    free = scenario.truth.surroundings.free
    X_EB = {body.name: np.array(body.X_EB) for body in free}
    X_EB["block_east"][0, 3] += by
    not_begun = LiftOutcome.not_begun("hit_body", np.eye(4))
    return replace(not_begun, forces={"block_east": 5.0}, X_EB=X_EB)


def test_bodies_stay_where_a_lift_pushed_them(scenario: Scenario) -> None:
    outcome = pushed(scenario, 0.03)
    after = scenario.after_lift(outcome)
    for body in after.truth.surroundings:
        assert np.array_equal(body.X_EB, outcome.X_EB[body.name])


def test_the_robot_looks_again_with_the_error_of_the_start(scenario: Scenario) -> None:
    first, second = (scenario.after_lift(pushed(scenario, by)) for by in (0.0, 0.03))
    for before, after in zip(first.agent.surroundings, second.agent.surroundings, strict=True):
        moved = after.X_EB[:3, 3] - before.X_EB[:3, 3]
        wanted = [0.03 * (after.name == "block_east"), 0.0, 0.0]
        assert moved == pytest.approx(wanted, abs=1e-12)
    for true, seen in zip(second.truth.surroundings, second.agent.surroundings, strict=True):
        assert 0.0 < np.linalg.norm(seen.X_EB[:3, 3] - true.X_EB[:3, 3]) <= ERROR


def test_a_lift_alone_leaves_what_is_known_as_it_is() -> None:
    scenario = Scenario.from_config(Task.of("box", hand="wsg50"))
    after = scenario.after_lift(LiftOutcome.not_begun("dropped", np.eye(4)))
    assert after.agent is scenario.agent
    assert not len(after.truth.surroundings)


def _attempt(scenario: Scenario, outcome: LiftOutcome | None) -> Attempt:
    mesh = trimesh.creation.box()
    return Attempt(scenario, Contacts.empty(), mesh, GraspSearch(()), 0, outcome)


def test_the_report_sums_what_attempts_did_to_bodies(scenario: Scenario) -> None:
    first = pushed(scenario, 0.03)
    second = scenario.after_lift(first)
    attempts = [
        _attempt(scenario, first),
        _attempt(second, replace(pushed(second, 0.01), forces={"block_east": 3.0})),
        _attempt(second, None),
    ]
    facts = world_facts(attempts)["world"]["lift"]
    assert facts["forces"] == {"block_east": 5.0}
    assert facts["moved"] == pytest.approx({"block_east": 40.0, "block_west": 0.0})  # [mm]


def test_a_run_without_bodies_reports_none() -> None:
    alone = Scenario.from_config(Task.of("box", hand="wsg50"))
    assert world_facts([_attempt(alone, None)]) == {}
