"""Texts of measures, intervals, rates, differences and p-values in the tables of studies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.statistics import (
    SuccessRate,
    interval_over_objects,
    success_rate,
)
from lis_grasp_studies.harness.tables import NONE
from lis_grasp_studies.study.comparison import Comparison, Kind, Measure

MEASURE_LABELS: Mapping[Measure, str] = {
    "held": "held [%]",
    "epsilon_truth": "epsilon on the truth",
    "epsilon_gap": "gap of epsilon",
    "rmsd": "estimate to truth [mm]",
    "rmsd_truth_to_estimate": "truth to estimate [mm]",
    "edge_rmsd": "edges to estimate [mm]",
}

KIND_LABELS: Mapping[Kind, str] = {
    "all": "all objects",
    "edged": "edged objects",
    "curved": "curved objects",
    "files": "objects of mesh files",
}

# Measure -> factor to what is printed, and its digits.
_PRINTED = {"held": (1e2, 1), "epsilon_truth": (1.0, 3), "epsilon_gap": (1.0, 3)}
_LENGTH = (1e3, 2)


def printed(measure: str, value: float | None, *, signed: bool = False) -> str:
    """Return a value as text: rates in percent, lengths in mm; a dash for none."""
    if value is None or math.isnan(value):
        return NONE
    factor, digits = _PRINTED.get(measure, _LENGTH)
    return signed_text(factor * value, digits) if signed else f"{factor * value:.{digits}f}"


def interval_text(measure: str, low: float | None, high: float | None) -> str:
    """Return an interval of a difference as text; a dash for none."""
    if low is None or high is None:
        return NONE
    return " to ".join(printed(measure, end, signed=True) for end in (low, high))


def effect_text(measure: str, effect: float, low: float | None, high: float | None) -> str:
    """Return a difference with its interval, if there is one, as text."""
    text = printed(measure, effect, signed=True)
    return text if low is None else f"{text} ({interval_text(measure, low, high)})"


def difference_text(comparison: Comparison | None) -> str:
    """Return a comparison's effect with its interval, as text; a dash for none."""
    if comparison is None:
        return NONE
    return effect_text(comparison.measure, comparison.effect, comparison.low, comparison.high)


def rate_text(rate: SuccessRate | None) -> str:
    """Return a success rate in percent with its interval, as text."""
    if rate is None:
        return NONE
    text = f"{100.0 * rate.value:.0f}"
    if rate.low is None or rate.high is None:
        return text
    return f"{text} ({100.0 * rate.low:.0f} to {100.0 * rate.high:.0f})"


def held_text(rows: Sequence[Row]) -> str:
    """Return the success rate of rows as text."""
    return rate_text(success_rate(rows))


def p_value(p: float) -> str:
    """Return a p-value as text."""
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def p_phrase(p: float) -> str:
    """Return a p-value as text after the letter p."""
    return p_value(p) if p < 0.001 else f"= {p_value(p)}"


def signed_text(value: float, digits: int) -> str:
    """Return a number with its sign; no minus before zero."""
    rounded = round(value, digits) + 0.0
    return f"{rounded:+.{digits}f}".replace("-", "−")


Pairs = Sequence[tuple[Row, Row]]
"""Rows of an estimator, each with the reference's row of the same trial; see `pairs_of`."""


def gains(pairs: Pairs) -> FloatArray:
    """Return for each pair 1 where only the estimator held, -1 where only the reference did."""
    return np.array([float(row["held"]) - float(other["held"]) for row, other in pairs])


def difference(pairs: Pairs) -> str:
    """Return the difference of success rates in points, with its interval over objects."""
    if not pairs:
        return NONE
    interval = interval_over_objects([row for row, _ in pairs], gains(pairs))
    return effect_text("held", float(gains(pairs).mean()), *interval)
