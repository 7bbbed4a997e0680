"""Objects put down after the lift: their rows, and what counts."""

from __future__ import annotations

import pytest

from lis_grasp_studies.evaluation.part import SaltedTrial
from lis_grasp_studies.evaluation.placings import PlacingsPart, measure_placings
from lis_grasp_studies.evaluation.touched_shapes import TRUTH

PART = PlacingsPart(
    measure="placings", title="", variants=["blend"], seconds=1.0, seeds=[1], salt="a", objects=6
)


def placing(number: int, simulator: str, reason: str) -> dict[str, object]:
    held, placed = reason not in ("not_held", "no_grasp"), reason == "placed"
    key = {"estimator": "blend", "number": number, "seed": 1, "goal": "table"}
    return key | {"simulator": simulator, "reason": reason, "held": held, "placed": placed}


def test_what_was_not_held_is_not_placed_and_a_missing_place_is_a_loss() -> None:
    """Drake holds three of four and places one; MuJoCo holds three and agrees about one of two."""
    ends = {
        "drake": ("placed", "fallen", "no_place", "not_held"),
        "mujoco": ("placed", "placed", "not_held", "placed"),
    }
    rows = [placing(k, name, reason) for name in ends for k, reason in enumerate(ends[name])]
    assert PART.numbers(rows) == {
        "placed blend": 1,
        "held blend": 3,
        "alike blend": 1,
        "judged blend": 2,
    }
    (table,) = PART.tables(rows)
    line = dict(zip(table.head, table.body[0], strict=True))
    assert line["other ends"] == "fallen 1, no_place 1"
    assert line["MuJoCo agrees"] == "1 of 2"


@pytest.mark.slow
def test_a_prism_is_put_down_by_its_truth_in_both_simulators() -> None:
    rows = measure_placings(SaltedTrial("devplace", 0, 1), TRUTH)
    assert [(row["goal"], row["simulator"]) for row in rows] == [
        ("table", "drake"),
        ("table", "mujoco"),
        ("corner", "drake"),
        ("corner", "mujoco"),
    ]
    assert all(row["held"] and row["placed"] and row["moved"] < 5e-3 for row in rows)
