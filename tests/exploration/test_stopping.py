"""Stop rules, each on a surface of known measures."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from analytic_surfaces import Analytic, Ball, cube_bounds

from lis_grasp import Hand, shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    ExplorationState,
    ExplorationStrategy,
    Observation,
    Probe,
    ProbeOutcome,
    TactilePerception,
    Workspace,
    explore,
    stop_after,
    stop_when_certain,
    stop_when_covered,
    stop_when_graspable,
)
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.pipeline import RunConfig, Scenario
from lis_grasp.stages.touch import stop_rules
from lis_grasp.surfaces import GaussianProcessImplicitSurface

BOX, HAND = shapes.build("box"), Hand.load("allegro")
RADIUS = 0.05
SPACE = Workspace(0.025, np.zeros(3), 2.0 * RADIUS)


# A standard deviation of 1 mm below the centre and 3 mm above.
BALL = Ball(RADIUS, doubt=lambda p: np.where(p[..., 2] < 0.0, 0.001, 0.003))


def cap(fraction: float, count: int = 400) -> Contacts:
    """Return contacts all over the lowest fraction of the ball; area is proportional to height."""
    z = -1.0 + 2.0 * fraction * (np.arange(count) + 0.5) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    ring = np.sqrt(1.0 - z**2)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    return Contacts(RADIUS * normals, normals)


def test_coverage_is_the_fraction_of_the_estimate_within_a_step() -> None:
    # A cap of height h covers up to a chord of one step beyond its rim: 2 arcsin(1/4) of angle.
    contacts = cap(0.5)
    covered = 0.5 * (1.0 + np.sin(2.0 * np.arcsin(0.25)))
    for fraction, ends in ((covered - 0.03, True), (covered + 0.03, False)):
        reason = stop_when_covered(fraction, SPACE)(contacts, BALL, ())
        assert (reason is not None) == ends


def test_nearly_all_of_the_surface_must_be_certain() -> None:
    assert stop_when_certain(0.0035, SPACE)(cap(0.5), BALL, ()) is not None
    assert stop_when_certain(0.0025, SPACE)(cap(0.5), BALL, ()) is None


def test_time_is_that_of_the_probes() -> None:
    outcome = ProbeOutcome(Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1), "missed", duration=2.0)
    assert stop_after(4.0)(cap(0.5), BALL, [outcome]) is None
    assert "4 s" in str(stop_after(4.0)(cap(0.5), BALL, [outcome] * 2))


def test_an_estimate_without_surface_is_no_reason_to_stop() -> None:
    far = Contacts([[1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    surface = GaussianProcessImplicitSurface.from_contacts(far)
    assert stop_when_covered(0.5, SPACE)(far, surface, ()) is None
    assert stop_when_certain(0.1, SPACE)(far, surface, ()) is None


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("until_coverage", 1.2),
        ("until_uncertainty", 0.0),
        ("max_seconds", float("nan")),
        ("policy", "psychic"),
    ],
)
def test_invalid_rules_are_refused(option: str, value: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(**{option: value})  # type: ignore[arg-type]
    assert error.value.option == option


def test_a_good_grasp_ends_the_exploration_if_two_more_contacts_confirm_it() -> None:
    predictions = iter([0.9, 0.5, 0.9, 0.85])  # with 10, 12, 14 and 16 contacts
    rule = stop_when_graspable(0.8, lambda surface: next(predictions))
    reasons = []
    for count in range(1, 17):
        rule = rule.noted(cap(0.5, count), BALL)
        reasons.append(rule(cap(0.5, count), BALL, ()))
    assert [reason is not None for reason in reasons] == 15 * [False] + [True]
    assert not list(predictions)


@pytest.mark.slow
@pytest.mark.parametrize("lost_at", [None, 9])
def test_a_resumed_exploration_ends_at_the_same_prediction(lost_at: int | None) -> None:
    class Line:
        """A prober, policy and tracker that touch along a line."""

        def next_probe(self, *_: object, **__: object) -> Probe:
            return Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.03, 0.02)

        def probe(self, probe: Probe, obstacles: object) -> ProbeOutcome:
            self.made += 1
            contact = Contacts([[0.0, 0.0, 0.01 * self.made]], [[0.0, 0.0, 1.0]])
            return ProbeOutcome(probe, "touched", contact)

        def move_frame(self, X_EF: np.ndarray) -> None:
            """Nothing moves."""

        def probe_again(self, state: ExplorationState) -> None:
            return None

        def track(self, outcome: ProbeOutcome, state: ExplorationState) -> tuple:
            trust = "lost" if self.made == lost_at else "trusted"
            return Observation(outcome, replace(PoseBelief.start(), trust=trust)), ()

        def __init__(self, made: int) -> None:
            self.made = made

    def counted(contacts: Contacts) -> Analytic:
        """Return an estimate that tells the number of its contacts."""
        return Analytic(lambda p: np.full(p.shape[:-1], float(len(contacts))), cube_bounds(0.06))

    def explored(recorded: Sequence[Observation]) -> tuple[int, int]:
        asked = []

        def predict(contacts: Contacts) -> float:
            asked.append(len(contacts))
            return float(len(contacts) in (10, 14, 16))

        line = Line(len(recorded))
        exploration = explore(
            line,
            TactilePerception(counted, tracker=line),
            ExplorationStrategy(line, touches=40, stop=[stop_when_graspable(0.8, predict)]),
            rng=np.random.default_rng(0),
            recorded=recorded,
        )
        made.extend(exploration.observations[len(made) :])
        return len(exploration.outcomes), len(asked)

    made: list[Observation] = []
    ended, predictions = explored(())
    assert (ended, predictions) == ((16, 4) if lost_at is None else (24, 4))
    for count in range(ended):
        resumed, again = explored(made[:count])
        assert resumed == ended
        assert again <= predictions  # what decided nothing is not predicted again


@pytest.mark.slow
def test_an_estimate_that_cannot_be_meshed_allows_no_grasp() -> None:
    nothing = Analytic(lambda p: np.ones(p.shape[:-1]), cube_bounds(0.06))  # has no inside
    scenario = Scenario.from_config(RunConfig(until_success=0.5), BOX, HAND)
    (rule,) = stop_rules(scenario.agent)
    contacts = cap(0.5, 12)
    for _ in range(2):
        rule = rule.noted(contacts, nothing)
        assert rule(contacts, nothing, ()) is None


@pytest.mark.parametrize("probability", [0.0, 1.0, np.nan])
def test_a_success_to_wait_for_is_a_probability(probability: float) -> None:
    with pytest.raises(InvalidOptionError):
        stop_when_graspable(probability, lambda surface: 1.0)
    with pytest.raises(InvalidOptionError):
        RunConfig(until_success=probability)
