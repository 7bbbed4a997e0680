"""Ratios of errors to a reference estimator on the same contact sets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.harness.statistics import bootstrap_interval, numbered

FLOOR = 0.0005
"""Added to both errors of a ratio, in sizes of the object: 0.1 mm at 20 cm. Errors far below what
any use needs do not count."""

LOSS = 1.005
"""A ratio above this, shown as more than 1.00, is a loss."""

LEAST_OBJECTS = 6
"""Objects that an interval needs."""

MEASURES = ("truth_to_estimate", "estimate_to_truth")
"""The two errors that ratios are of."""


@dataclass(frozen=True, slots=True)
class ErrorRatio:
    """Errors of one estimator over those of the reference on one contact set."""

    object: str
    family: str
    case: str
    kind: str
    seed: int
    estimator: str
    truth_to_estimate: float
    estimate_to_truth: float
    failed: bool

    @property
    def worst(self) -> float:
        """The larger of both ratios."""
        return max(self.truth_to_estimate, self.estimate_to_truth)

    @property
    def set_name(self) -> str:
        """Object and case; the seed unless it is 0."""
        return f"{self.object}, {self.case}" + (f", seed {self.seed}" if self.seed else "")


@dataclass(frozen=True, slots=True)
class RatioSummary:
    """Geometric mean of ratios, with its 95 % bootstrap interval over objects."""

    mean: float
    low: float | None
    high: float | None

    def text(self) -> str:
        """Return the mean, and the interval where there is one."""
        if self.low is None or self.high is None:
            return f"{self.mean:.2f}"
        return f"{self.mean:.2f} ({self.low:.2f} to {self.high:.2f})"


def error_ratios(rows: Sequence[Row], reference: str) -> list[ErrorRatio]:
    """Return the ratios of every row to the reference's row of the same set.

    ``(error + FLOOR size) / (reference's error + FLOOR size)``. Sets on which the reference has no
    row are left out.
    """
    known = {_set_of(row): row for row in rows if row["estimator"] == reference}
    found = []
    for row in rows:
        other = known.get(_set_of(row))
        if other is None:
            continue
        floor = FLOOR * row["size"]
        both = [(row[name] + floor) / (other[name] + floor) for name in MEASURES]
        facts = {n: row[n] for n in ("object", "family", "case", "kind", "seed", "estimator")}
        errors = dict(zip(MEASURES, both, strict=True))
        found.append(ErrorRatio(**facts, **errors, failed=bool(row["failure"])))
    return found


def summarise(ratios: Sequence[ErrorRatio], measure: str) -> RatioSummary:
    """Return the geometric mean of one measure; the interval draws whole objects."""
    logs = np.log([getattr(ratio, measure) for ratio in ratios])
    objects = numbered([ratio.object for ratio in ratios])
    mean = float(np.exp(logs.mean()))
    if objects.max(initial=-1) + 1 < LEAST_OBJECTS:
        return RatioSummary(mean, None, None)
    low, high = np.exp(bootstrap_interval(logs, objects, rng=np.random.default_rng(0)))
    return RatioSummary(mean, float(low), float(high))


def failures(rows: Iterable[Row]) -> Counter[str]:
    """Return the number of failed estimates of each estimator."""
    return Counter(row["estimator"] for row in rows if row["failure"])


def _set_of(row: Row) -> tuple[str, str, int, str]:
    return row["object"], row["case"], row["seed"], row["box"]
