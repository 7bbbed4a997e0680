"""Times of motions by kind, and an arm that goes on where a record left it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scenes

from lis_grasp import pipeline
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Exploration, Observation
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.results.motion_times import motion_times, times_line
from lis_grasp.task.task import Task

PROBE = Probe([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.01, 0.01)
KINDS = {"transit": 1.0, "free": 0.25, "guarded": 0.5, "slide": 0.0, "retreat": 0.125}


def _lift(seconds: dict[str, float], *, lifted: bool) -> LiftOutcome:
    outcome = LiftOutcome.not_begun("held" if lifted else "dropped", np.eye(4))
    return replace(outcome, lifted=lifted, held=lifted, motion=scenes.motion(), seconds=seconds)


def test_times_add_up_over_probes_attempts_and_touches_between_them() -> None:
    outcome = ProbeOutcome(PROBE, "missed", duration=sum(KINDS.values()), seconds=KINDS)
    exploration = Exploration(Contacts.empty(), (Observation(outcome),) * 2, homeward=2.0)
    failed = _lift({"approach": 1.0, "close": 2.0, "let_go": 0.5}, lifted=False)
    held = _lift(
        {"approach": 1.0, "close": 2.0, "lift": 1.0, "shake": 6.0, "hold": 1.0}, lifted=True
    )
    attempts = [
        SimpleNamespace(outcome=failed, lesson=SimpleNamespace(seconds=4.0)),
        SimpleNamespace(outcome=held, lesson=None),
    ]
    times = motion_times(exploration, attempts)
    assert exploration.duration == 2.0 * sum(KINDS.values()) + 2.0
    assert times["touching"] == {**{kind: 2.0 * s for kind, s in KINDS.items()}, "home": 2.0}
    assert times["lifting"]["close"] == 4.0
    assert times["total"] == exploration.duration + 4.0 + 3.5 + 11.0
    assert times["until_lifted"] == times["total"] - 7.0  # without shake and hold
    assert f"{times['until_lifted']:.0f} s until" in times_line(times)


def test_nothing_lifted_has_no_time_until_it_was() -> None:
    exploration = Exploration(Contacts.empty(), ())
    assert motion_times(exploration, [SimpleNamespace(outcome=None, lesson=None)]) == {
        "touching": {"home": 0.0},
        "touching_again": 0.0,
        "lifting": {},
        "until_lifted": None,
        "total": 0.0,
    }


@pytest.mark.slow
def test_an_arm_goes_on_where_the_recorded_probes_left_it() -> None:
    options = {"hand": "wsg50", "arm": "iiwa14", "prober": "kinematic", "touches": 6}
    task = Task.of("box", known=True, **options)
    scenario = pipeline.Scenario.from_config(task)
    whole = pipeline.touch(scenario)
    resumed = pipeline.touch(scenario, recorded=whole.observations[:3])
    assert all(len(outcome.left_at) == 7 + 2 for outcome in whole.outcomes if outcome.duration)
    assert resumed.duration == whole.duration
    assert whole.homeward > 0.0
    for first, second in zip(whole.outcomes, resumed.outcomes, strict=True):
        np.testing.assert_array_equal(first.contacts.points, second.contacts.points)
        assert dict(first.seconds) == dict(second.seconds)
        assert first.duration == pytest.approx(sum(first.seconds.values()))
