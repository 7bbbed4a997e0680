"""Ratios of errors to a reference, and tables of the study of surfaces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.contact_sets import KINDS
from lis_grasp_studies.contact_study.score import TRUTH
from lis_grasp_studies.harness.statistics import bootstrap_interval, numbered
from lis_grasp_studies.harness.tables import Column, Table, grouped_table, values_of, where
from lis_grasp_studies.test_objects.shape_sets import FAMILIES

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


WORST = 1.25
"""Largest ratio of an estimator that is right everywhere."""

OFF = 0.05
"""Largest deviation of a calibrated rate from 68 or 95 %."""

_BANDS = (("within_68", 0.6827), ("within_95", 0.95))
_ERRORS = ("truth_to_estimate", "estimate_to_truth", "edge")


def by_kind_table(ratios: Sequence[ErrorRatio], estimators: Sequence[str]) -> Table:
    """Return the geometric mean ratios of every estimator for each kind of contacts."""
    groups = {}
    for kind in (*KINDS, "all"):
        members = [ratio for ratio in ratios if kind in (ratio.kind, "all")]
        sets = sum(ratio.estimator == estimators[0] for ratio in members)
        groups[f"{kind} ({sets} sets)"] = members
    columns = [(name, _ratios_cell(name)) for name in estimators]
    return grouped_table(
        "by_kind", "Ratios of errors by kind of contacts", "contacts", groups, columns
    )


def by_family_table(ratios: Sequence[ErrorRatio], estimator: str) -> Table:
    """Return the ratios of one estimator for each family and kind, with intervals and the worst."""

    def worst(ratios: Sequence[ErrorRatio]) -> str:
        largest = max(ratios, key=lambda ratio: ratio.worst)
        return f"{largest.worst:.2f}: {largest.set_name}"

    groups = {
        (family, kind): [
            ratio
            for ratio in ratios
            if ratio.estimator == estimator
            and family in (ratio.family, "all")
            and kind in (ratio.kind, "all")
        ]
        for family, kind in product((*FAMILIES, "all"), (*KINDS, "all"))
    }
    columns: list[Column] = [
        ("sets", lambda ratios: str(len(ratios))),
        ("truth to estimate", lambda ratios: summarise(ratios, MEASURES[0]).text()),
        ("estimate to truth", lambda ratios: summarise(ratios, MEASURES[1]).text()),
        ("losses", lambda ratios: str(sum(ratio.worst > LOSS for ratio in ratios))),
        ("worst", worst),
    ]
    title = f"Ratios of {estimator} by family and kind of contacts"
    return grouped_table("by_family", title, "family | contacts", groups, columns)


def by_object_table(ratios: Sequence[ErrorRatio], estimators: Sequence[str]) -> Table:
    """Return the ratios of every estimator for each object; losses are bold."""
    groups: dict[tuple[str, str], list[ErrorRatio]] = {}
    for ratio in sorted(ratios, key=lambda ratio: FAMILIES.index(ratio.family)):
        groups.setdefault((ratio.object, ratio.family), []).append(ratio)
    columns: list[Column] = [
        ("sets", lambda ratios: str(sum(r.estimator == estimators[0] for r in ratios))),
        *((name, _ratios_cell(name, bold=True)) for name in estimators),
    ]
    title = "Ratios of errors by object"
    return grouped_table("by_object", title, "object | family", groups, columns)


def losses_table(ratios: Sequence[ErrorRatio], estimator: str, *, above: float = LOSS) -> Table:
    """Return every set on which one estimator has a larger error than the reference."""
    lost = [ratio for ratio in ratios if ratio.estimator == estimator and ratio.worst > above]
    lines = tuple(
        (
            *(ratio.object, ratio.family, ratio.case, str(ratio.seed)),
            *(f"{getattr(ratio, name):.2f}" for name in MEASURES),
            "failed" if ratio.failed else "",
        )
        for ratio in sorted(lost, key=lambda ratio: -ratio.worst)
    )
    head = ("object", "family", "contacts", "seed", "truth to estimate", "estimate to truth", "")
    title = f"Losses of {estimator}, the largest first"
    return Table("losses", title if above == LOSS else f"{title}, above {above}", head, lines)


def calibration_table(rows: Sequence[Row], estimators: Sequence[str]) -> Table:
    """Return the rates within one and 1.96 standard deviations, for each kind and each family.

    Over the estimate / over the true surface. Rates more than 5 points off are bold.
    """
    groups = {
        name: where(rows, **{column: name})
        for column, names in (("kind", KINDS), ("family", FAMILIES))
        for name in names
    }
    columns = [
        (f"{estimator}, {goal:.0%}", _rates_cell(estimator, band, goal))
        for estimator in estimators
        for band, goal in _BANDS
    ]
    title = "Coverage of the uncertainty bands"
    return grouped_table("calibration", title, "contacts or family", groups, columns)


def error_table(rows: Sequence[Row], estimators: Sequence[str]) -> Table:
    """Return mean errors in mm on objects scaled to 20 cm, with failures and times of fits.

    Truth to estimate / estimate to truth / true edges to estimate.
    """
    groups = {kind: [r for r in rows if kind in (r["kind"], "all")] for kind in (*KINDS, "all")}
    columns = [(name, _errors_cell(name)) for name in estimators]
    title = "Mean errors in mm, objects scaled to 20 cm"
    table = grouped_table("errors", title, "contacts", groups, columns)
    failed = failures(rows)
    times = (values_of(where(rows, estimator=name), "fit_seconds") for name in estimators)
    medians = (f"{1e3 * np.median(seconds):.0f} ms" if len(seconds) else "-" for seconds in times)
    further = (
        ("failures", *(str(failed[name]) for name in estimators)),
        ("median time of a fit", *medians),
    )
    return Table(table.name, table.title, table.head, (*table.body, *further))


def with_truth(rows: Sequence[Row], estimators: Sequence[str]) -> tuple[str, ...]:
    """Return the estimators, and the clipped true surface if there are rows of it."""
    return (*estimators, *([TRUTH] if any(row["estimator"] == TRUTH for row in rows) else []))


def _ratios_cell(estimator: str, *, bold: bool = False) -> Callable[[Sequence[ErrorRatio]], str]:
    def cell(ratios: Sequence[ErrorRatio]) -> str:
        members = [ratio for ratio in ratios if ratio.estimator == estimator]
        means = [summarise(members, name).mean for name in MEASURES]
        return " / ".join(f"**{m:.2f}**" if bold and m > LOSS else f"{m:.2f}" for m in means)

    return cell


def _rates_cell(estimator: str, band: str, goal: float) -> Callable[[Sequence[Row]], str]:
    def cell(rows: Sequence[Row]) -> str:
        texts = []
        for name in (band, f"truth_{band}"):
            values = values_of(where(rows, estimator=estimator, failure=""), name)
            if not len(values):
                return "-"
            rate = float(values.mean())
            texts.append(f"**{rate:.0%}**" if abs(rate - goal) > OFF else f"{rate:.0%}")
        return " / ".join(texts)

    return cell


def _errors_cell(estimator: str) -> Callable[[Any], str]:
    def at_20_cm(rows: Sequence[Row], measure: str) -> str:
        values = [200.0 * row[measure] / row["size"] for row in rows if row[measure] is not None]
        return f"{np.mean(values):.1f}" if values else "-"

    return lambda rows: " / ".join(
        at_20_cm(where(rows, estimator=estimator), measure) for measure in _ERRORS
    )
