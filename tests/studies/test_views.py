"""The study of views: its trials, its measures of unseen surface, and its table."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.evaluation.views import (
    BLIND,
    EXACT,
    SEEN,
    ViewsPart,
    ViewTrial,
    camera_measures,
    measure_view,
    surface_measures,
    views_table,
)

TASK = Task.of("box", hand="wsg50", prober="kinematic", camera=True)


def test_an_exact_estimate_has_no_error_and_a_shifted_side_has_its_shift() -> None:
    scenario = Scenario.from_config(TASK)
    truth = scenario.truth.shape.mesh
    exact = surface_measures(scenario, truth)
    assert max(exact[name] for name in ("unseen", "seen", "all", "to_truth")) < 1e-9
    assert exact["superfluous"] == 0.0
    grown = trimesh.Trimesh(truth.vertices * [1.0, 1.0, 1.2], truth.faces, process=False)
    higher = surface_measures(scenario, grown)
    assert higher["superfluous"] > 0.05
    assert higher["to_truth"] > 0.003


def test_a_camera_is_displaced_by_its_error_and_not_without_one() -> None:
    measured = camera_measures(Scenario.from_config(TASK), touches=Contacts.empty())
    exact = camera_measures(
        Scenario.from_config(TASK.having(hand_eye=(0.0, 0.0))), touches=Contacts.empty()
    )
    assert exact["displaced"] < 1e-12
    assert exact["stated"] == 0.0
    # The table levels it: less than four deviations of 2 mm and 0.5 degrees at 0.6 m are left.
    assert 1e-5 < measured["displaced"] < 4.0 * np.hypot(0.002, 0.6 * np.radians(0.5))
    assert camera_measures(Scenario.from_config(TASK.having(camera=False)), Contacts.empty()) == {}


def test_the_table_has_a_line_for_each_number_of_touches() -> None:
    rows = [
        {"where": where, "touches": touches, "held": touches > 0, "unseen": 0.003}
        for where in (SEEN, BLIND)
        for touches in (0, 3)
    ]
    table = views_table(rows)
    assert [line[0] for line in table.body] == [
        "blind, 0 touches", "blind, 3 touches", "seen, 0 touches", "seen, 3 touches",
    ]  # fmt: skip
    part = ViewsPart(
        measure="views", title="Views", variants=[SEEN, EXACT, BLIND], seconds=60.0, seeds=[0, 1],
        objects=["box"], hands=["wsg50"], touches=[0, 3],
    )  # fmt: skip
    assert len(list(part.trials(0, Places()))) == 2
    assert part.numbers(rows)["seen 3"] == 100.0


@pytest.mark.slow
def test_an_object_with_an_unseen_end_is_touched_more_though_nothing_was_touched() -> None:
    row = measure_view(ViewTrial("cone", "wsg50", 0, 43, prober="dynamic"), SEEN)
    assert row["probes"] == 0
    assert row["held"]


@pytest.mark.slow
def test_a_run_after_a_view_and_a_blind_one_measure_the_same() -> None:
    rows = [
        measure_view(ViewTrial("box", "wsg50", 3, 0, estimator="gpis"), v) for v in (SEEN, BLIND)
    ]
    seen, blind = rows
    assert blind.keys() <= seen.keys()
    assert seen["unseen"] < blind["all"]
