"""The true object stays apart: nothing that decides for the robot can reach it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from reachable import reachable

from lis_grasp import Contacts, Task, World
from lis_grasp.exploration import (
    Exploration,
    ExplorationState,
    ExplorationStrategy,
    LoggedProbe,
    NextProbe,
    Observation,
    Probe,
    ProbeOutcome,
    SimulatedProber,
    TactilePerception,
    TouchLog,
    Workspace,
    explore_steps,
)
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.pipeline import Scenario, Truth
from lis_grasp.service.touch_service import TouchService
from lis_grasp.shapes import Shape
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.next_touch import ObjectPlace
from lis_grasp.stages.touch import (
    exploration_rng,
    make_perception,
    make_policy,
    make_prober,
    make_strategy,
    make_tracker,
    true_pose,
)
from lis_grasp.stages.touching_again import touch_more
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface
from lis_grasp.typing import FloatArray

# A ball of 50 g rolls at every touch.
CONFIG = Task.of("sphere", known=True, hand="wsg50", free=True, mass=0.05, friction=0.5, touches=2)


@dataclass
class Watch:
    """A policy, an estimator and a stop rule that keep what they are given."""

    given: list[Any] = field(default_factory=list)

    def policy(self, space: Workspace) -> Peeking:
        return Peeking(self, space)

    def estimate(self, contacts: Contacts) -> ImplicitSurface:
        self.given.append(contacts)
        return ESTIMATORS["gpis"](contacts)

    def stop(self, *given: Any) -> None:
        self.given.extend(given)

    def watched(self, scenario: Scenario) -> Scenario:
        agent = scenario.agent.deciding(policy=self.policy, estimator=self.estimate)
        return replace(scenario, agent=agent)


@dataclass
class Peeking:
    """A plug-in policy that keeps all it can get."""

    watch: Watch
    space: Workspace

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        self.watch.given.extend((contacts, surface, outcomes, rng))
        policy = make_policy("spread", self.space, CONFIG.robot.sensor)
        return policy.next_probe(contacts, surface, outcomes=outcomes, rng=rng)


def assert_without_truth(given: Sequence[Any], truth: Truth, poses: Sequence[FloatArray]) -> None:
    """Assert that nothing of the given is true of the object, by its type and by its value.

    `poses` (4, 4) are true ones of the object. A believed one is off by far more than rounding.
    """
    true = [X for X in poses if not np.allclose(X, np.eye(4), atol=1e-6)]
    true += [np.linalg.inv(X) for X in true]
    vertices, checked = truth.shape.mesh.vertices, 0
    assert true
    for part in reachable(*given):
        checked += 1
        assert not isinstance(part, Truth | World | Task | Scenario | Shape | SimulatedProber), (
            type(part)
        )
        if isinstance(part, np.ndarray) and part.dtype == np.float64:
            assert part.shape != vertices.shape or not np.allclose(part, vertices)
            for X in part.reshape(-1, 4, 4) if part.shape[-2:] == (4, 4) else ():
                assert not any(np.allclose(X, one, rtol=0.0, atol=1e-9) for one in true)
    assert checked > 20


@dataclass
class Explored:
    """An exploration of a free object, what decided for the robot was given, and true poses."""

    scenario: Scenario  # after it
    states: list[ExplorationState]
    given: list[Any]
    poses: list[FloatArray]


@pytest.fixture(scope="module")
def explored() -> Explored:
    watch = Watch()
    scenario = watch.watched(Scenario.from_config(CONFIG))
    prober, agent = make_prober(scenario), scenario.agent
    perception = replace(make_perception(agent.perception), tracker=make_tracker(scenario, prober))
    strategy = replace(make_strategy(agent), stop=[watch.stop])
    states, poses = [], []
    steps = explore_steps(prober, perception, strategy, rng=exploration_rng(agent))
    for state in steps:
        X_EO, X_WE = true_pose(prober), np.eye(4) if state.belief is None else state.belief.X_WE
        states.append(state)
        poses += [X_EO, X_WE @ X_EO]
    after = scenario.after(states[-1].result, X_EO)
    return Explored(after, states, watch.given, poses)


def test_what_decides_for_the_robot_cannot_reach_the_true_object(explored: Explored) -> None:
    # What policy, estimator and stop rule get, all states, and what plans grasps.
    scenario, result = explored.scenario, explored.states[-1].result
    given = [*explored.given, *explored.states, result, scenario.agent]
    assert_without_truth(given, scenario.truth, explored.poses)
    for leak in (explored.poses[-1], scenario.truth, scenario.truth.shape.mesh.vertices.copy()):
        with pytest.raises(AssertionError):
            assert_without_truth([*given, [lambda leak=leak: leak]], scenario.truth, explored.poses)


def test_the_touch_service_cannot_reach_the_true_object(explored: Explored, tmp_path: Path) -> None:
    task = Task.of(known=True, hand="wsg50", estimator="gpis")
    log, place = TouchLog(tmp_path / "touches.jsonl", {}), ObjectPlace(size=0.12, support=-0.06)
    recorded, hand = explored.states[-1].observations, explored.scenario.agent.hand
    service = TouchService(Agent.of(task, 0.0, hand=hand), place, tmp_path, log, recorded=recorded)
    given = [service, service.answer({"request": "next"})]
    assert_without_truth(given, explored.scenario.truth, explored.poses)


@pytest.mark.slow
def test_touches_after_a_grasp_cannot_reach_the_true_object(
    explored: Explored, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lis_grasp.stages.touching_again._MORE_TOUCHES", 1)
    watch, contacts = Watch(), explored.states[-1].known
    again = watch.watched(explored.scenario)
    found, contacts, lesson = touch_more(again, contacts, moved=False)
    assert lesson.touched
    given, poses = [*watch.given, found.agent, contacts], [again.truth.X_EO, found.truth.X_EO]
    assert_without_truth(given, again.truth, poses)


def test_no_record_of_the_robot_has_a_field_of_the_true_object() -> None:
    roots = (
        ExplorationState,
        Exploration,
        NextProbe,
        TactilePerception,
        ExplorationStrategy,
        Agent,
    )
    records, seen = list[Any](roots), set[Any]()
    while records:
        record = records.pop()
        if record in seen:
            continue
        seen.add(record)
        assert record not in (Truth, World, Task, Scenario, Shape, LoggedProbe, SimulatedProber)
        for name, hint in get_type_hints(record).items():
            assert not {"true", "truth", "simulated"} & set(name.split("_")), f"{record}: {name}"
            records += _classes_in(hint)
    assert {Observation, ProbeOutcome, ObstacleModel, PoseBelief} <= seen


def _classes_in(hint: Any) -> list[Any]:
    """Return the record classes that a type names."""
    if is_dataclass(hint):
        return [hint]
    return [record for part in get_args(hint) for record in _classes_in(part)]


def test_what_is_true_is_found_where_it_is() -> None:
    # The walk that finds none in what the robot gets finds it in a simulator's prober.
    scenario = Scenario.from_config(CONFIG).moved(planar_pose(np.array([0.1, 0.2, 0.3])))
    prober, X_EO = make_prober(scenario), scenario.truth.X_EO
    parts = list(reachable({"prober": [lambda: prober]}))
    assert any(isinstance(part, SimulatedProber) for part in parts)
    assert any(isinstance(part, np.ndarray) and np.array_equal(part, X_EO) for part in parts)


def test_a_log_keeps_the_truth_beside_what_was_observed(explored: Explored, tmp_path: Path) -> None:
    X_EO, log = planar_pose(np.array([0.1, 0.2, 0.3])), TouchLog(tmp_path / "touches.jsonl", {})
    for observation in explored.states[-1].observations:
        log.append(observation, X_EO)
    probes = log.read().probes
    assert all(np.array_equal(probe.X_EO, X_EO) for probe in probes)
    for part in reachable([probe.observation for probe in probes], log.read().observations):
        assert not (isinstance(part, np.ndarray) and np.array_equal(part, X_EO))
