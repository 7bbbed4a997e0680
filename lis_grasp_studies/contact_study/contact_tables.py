"""Tables of the study: by kind, family and object, losses, calibration, absolute errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.contact_study.contact_cases import KINDS
from lis_grasp_studies.contact_study.error_ratios import (
    LOSS,
    ErrorRatio,
    failures,
    grouped,
    summarise,
)
from lis_grasp_studies.contact_study.estimate_score import TRUTH
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.test_objects.shape_sets import FAMILIES

WORST = 1.25
"""Largest ratio of an estimator that is right everywhere."""

OFF = 0.05
"""Largest deviation of a calibrated rate from 68 or 95 %."""

_BANDS = (("within_68", 0.6827), ("within_95", 0.95))


def by_kind_table(ratios: Sequence[ErrorRatio], estimators: Sequence[str]) -> TextTable:
    """Return the geometric mean ratios of every estimator for each kind of contacts."""
    lines = []
    for kind in (*KINDS, "all"):
        chosen = [ratio for ratio in ratios if kind in (ratio.kind, "all")]
        if not chosen:
            continue
        of = grouped(chosen, lambda ratio: ratio.estimator)
        lines.append(
            (f"{kind} ({len(of[estimators[0]])} sets)", *(_pair(of[n]) for n in estimators))
        )
    title = "Ratios of errors by kind of contacts"
    return TextTable("by_kind", title, ("contacts", *estimators), tuple(lines))


def by_family_table(ratios: Sequence[ErrorRatio], estimator: str) -> TextTable:
    """Return the ratios of one estimator for each family and kind, with intervals and the worst."""
    own = [ratio for ratio in ratios if ratio.estimator == estimator]
    lines = []
    for family in (*FAMILIES, "all"):
        for kind in (*KINDS, "all"):
            chosen = [r for r in own if family in (r.family, "all") and kind in (r.kind, "all")]
            if not chosen:
                continue
            worst = max(chosen, key=lambda ratio: ratio.worst)
            lines.append(
                (
                    family,
                    kind,
                    str(len(chosen)),
                    summarise(chosen, "truth_to_estimate").text(),
                    summarise(chosen, "estimate_to_truth").text(),
                    str(sum(ratio.worst > LOSS for ratio in chosen)),
                    f"{worst.worst:.2f}: {worst.set_name}",
                )
            )
    head = ("family", "contacts", "sets", "truth to estimate", "estimate to truth")
    title = f"Ratios of {estimator} by family and kind of contacts"
    return TextTable("by_family", title, (*head, "losses", "worst"), tuple(lines))


def by_object_table(ratios: Sequence[ErrorRatio], estimators: Sequence[str]) -> TextTable:
    """Return the ratios of every estimator for each object; losses are bold."""
    lines = []
    for family in FAMILIES:
        members = [ratio for ratio in ratios if ratio.family == family]
        for name, chosen in grouped(members, lambda ratio: ratio.object).items():
            of = grouped(chosen, lambda ratio: ratio.estimator)
            sets = len(of[estimators[0]])
            lines.append((name, family, str(sets), *(_pair(of[n], bold=True) for n in estimators)))
    head = ("object", "family", "sets", *estimators)
    return TextTable("by_object", "Ratios of errors by object", head, tuple(lines))


def losses_table(ratios: Sequence[ErrorRatio], estimator: str) -> TextTable:
    """Return every set on which one estimator has a larger error than the reference."""
    lost = [ratio for ratio in ratios if ratio.estimator == estimator and ratio.worst > LOSS]
    lost.sort(key=lambda ratio: -ratio.worst)
    lines = [
        (
            ratio.object,
            ratio.family,
            ratio.case,
            str(ratio.seed),
            f"{ratio.truth_to_estimate:.2f}",
            f"{ratio.estimate_to_truth:.2f}",
            "failed" if ratio.failed else "",
        )
        for ratio in lost
    ]
    head = ("object", "family", "contacts", "seed", "truth to estimate", "estimate to truth", "")
    title = f"Losses of {estimator}, the largest first"
    return TextTable("losses", title, head, tuple(lines))


def calibration_table(rows: Sequence[Row], estimators: Sequence[str]) -> TextTable:
    """Return the rates within one and 1.96 standard deviations, for each kind and each family.

    Over the estimate / over the true surface. Rates more than 5 points off are bold.
    """
    lines = []
    for column, names in (("kind", KINDS), ("family", FAMILIES)):
        for name in names:
            chosen = [row for row in rows if row[column] == name]
            if not chosen:
                continue
            cells = []
            for estimator in estimators:
                own = [r for r in chosen if r["estimator"] == estimator and not r["failure"]]
                cells += [_rates(own, band, goal) for band, goal in _BANDS]
            lines.append((name, *cells))
    head = tuple(f"{estimator}, {goal:.0%}" for estimator in estimators for _, goal in _BANDS)
    title = "Coverage of the uncertainty bands"
    return TextTable("calibration", title, ("contacts or family", *head), tuple(lines))


def error_table(rows: Sequence[Row], estimators: Sequence[str]) -> TextTable:
    """Return mean errors in mm on objects scaled to 20 cm, with failures and times of fits.

    Truth to estimate / estimate to truth / true edges to estimate.
    """
    lines = []
    for kind in (*KINDS, "all"):
        chosen = [row for row in rows if kind in (row["kind"], "all")]
        if not chosen:
            continue
        cells = []
        for estimator in estimators:
            own = [row for row in chosen if row["estimator"] == estimator]
            names = ("truth_to_estimate", "estimate_to_truth", "edge")
            cells.append(" / ".join(_at_20_cm(own, name) for name in names))
        lines.append((kind, *cells))
    failed = failures(rows)
    lines.append(("failures", *(str(failed[name]) for name in estimators)))
    times = ([r["fit_seconds"] for r in rows if r["estimator"] == name] for name in estimators)
    medians = (f"{1e3 * np.median(seconds):.0f} ms" if seconds else "-" for seconds in times)
    lines.append(("median time of a fit", *medians))
    title = "Mean errors in mm, objects scaled to 20 cm"
    return TextTable("errors", title, ("contacts", *estimators), tuple(lines))


def with_truth(rows: Sequence[Row], estimators: Sequence[str]) -> tuple[str, ...]:
    """Return the estimators, and the clipped true surface if there are rows of it."""
    return (*estimators, *([TRUTH] if any(row["estimator"] == TRUTH for row in rows) else []))


def _pair(ratios: Sequence[ErrorRatio], *, bold: bool = False) -> str:
    means = [summarise(ratios, name).mean for name in ("truth_to_estimate", "estimate_to_truth")]
    return " / ".join(f"**{m:.2f}**" if bold and m > LOSS else f"{m:.2f}" for m in means)


def _rates(rows: Sequence[Row], band: str, goal: float) -> str:
    cells = []
    for name in (band, f"truth_{band}"):
        values = [row[name] for row in rows if row[name] is not None]
        if not values:
            return "-"
        rate = float(np.mean(values))
        cells.append(f"**{rate:.0%}**" if abs(rate - goal) > OFF else f"{rate:.0%}")
    return " / ".join(cells)


def _at_20_cm(rows: Sequence[Row], measure: str) -> str:
    values = [200.0 * row[measure] / row["size"] for row in rows if row[measure] is not None]
    return f"{np.mean(values):.1f}" if values else "-"
