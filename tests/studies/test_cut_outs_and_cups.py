"""Lifts with a suction cup and outlines: their rows, tables and calibration."""

from __future__ import annotations

import numpy as np
import pytest

from lis_grasp.exports.outline import AXES, PROBABILITIES, scales
from lis_grasp.shapes.resting import rest_from
from lis_grasp_studies.evaluation.outlines import (
    OutlinesPart,
    conformal_quantile,
    measure_outlines,
    reliability_table,
)
from lis_grasp_studies.evaluation.part import SaltedTrial
from lis_grasp_studies.evaluation.suction_lifts import (
    SuctionPart,
    explored,
    measure_suction,
    with_holdable,
)
from lis_grasp_studies.evaluation.touched_shapes import COUNTS, TRUTH

SUCTION = SuctionPart(
    measure="suction", title="cups", variants=[TRUTH], seconds=1.0, seeds=[1], salt="a", objects=6
)
OUTLINES = OutlinesPart(
    measure="outlines", title="", variants=["blend"], seconds=1.0, seeds=[1], salt="a", objects=6
)


def suction_row(number: int, estimator: str, **columns: object) -> dict[str, object]:
    usual = {"seed": 1, "held": 0, "seals": 0, "reason": "no_seal", "closure": 1.0}
    return usual | {"number": number, "estimator": estimator} | columns


def test_an_object_counts_if_the_cup_can_hold_it_by_its_truth() -> None:
    """Two objects: the truth holds one surely, and has no grasp of the other."""
    rows = [
        suction_row(0, TRUTH, held=1, success=1.0, reason="held"),
        suction_row(1, TRUTH, reason="no grasp"),
        suction_row(0, "blend", held=0, success=0.9),
        suction_row(1, "blend", held=1, success=0.3, reason="held"),
    ]
    assert [row["holdable"] for row in with_holdable(rows)] == [True, False, True, False]
    assert SUCTION.numbers(rows) == {
        "held truth": 1,
        "lifts truth": 1,
        "held blend": 0,
        "lifts blend": 1,
    }
    (table,) = SUCTION.tables(rows)
    assert [line[-1] for line in table.body] == ["no grasp 1", "no_seal 1"]


def test_objects_rest_on_the_table() -> None:
    shape, contacts = explored(SaltedTrial("pepper", 5, 0))
    down = np.array([0.0, 0.0, -1.0])
    assert np.allclose(rest_from(shape.mesh, down), down, atol=1e-6)
    assert len(contacts) == max(COUNTS)


@pytest.mark.slow
def test_a_cup_holds_a_prism_by_its_truth() -> None:
    row = measure_suction(SaltedTrial("pepper", 0, 0), TRUTH)
    assert row["held"] == row["seals"] == 1
    assert row["success"] == row["closure"] == 1.0


@pytest.mark.parametrize("p", PROBABILITIES)
def test_a_conformal_quantile_covers_the_next_value(p: float) -> None:
    """Of n exchangeable values and a next one, each rank is equally likely (Vovk et al. 2005)."""
    n, trials = 99, 4000
    values = np.random.default_rng(3).exponential(size=(trials, n + 1))
    covered = np.mean([v[-1] <= conformal_quantile(v[:-1], p) for v in values])
    expected = np.ceil((n + 1) * p) / (n + 1)
    assert covered == pytest.approx(expected, abs=4.0 * np.sqrt(p * (1.0 - p) / trials))


def outline_rows(count: int) -> list[dict[str, object]]:
    """Return rows whose needs are 0.01, 0.02, ... to 10 deviations of 1 mm."""
    return [
        {"estimator": "blend", "count": count, "deviation": 1e-3, "grow": need, "shrink": need}
        for need in 1e-5 * np.arange(1, 1001)
    ]


def test_the_reliability_is_the_fraction_of_needs_below_the_bound() -> None:
    table = reliability_table(outline_rows(40))
    for line, p in zip(table.body, PROBABILITIES, strict=True):
        grow, shrink = scales(p)
        assert float(line[3]) == pytest.approx(10.0 * grow, abs=0.51)
        assert float(line[4]) == pytest.approx(grow, abs=0.051)
        assert float(line[5]) == pytest.approx(10.0 * shrink, abs=0.51)
    numbers = OUTLINES.numbers(outline_rows(40))
    assert numbers["grow 90 blend"] == pytest.approx(9.01)


def test_outlines_of_one_object_need_what_they_need() -> None:
    rows = measure_outlines(SaltedTrial("pepper", 0, 0), TRUTH)
    assert [row["axis"] for row in rows] == [*AXES, *AXES]
    needs = [row[name] for row in rows for name in ("grow", "shrink", "deviation")]
    assert max(needs) < 1e-9
