"""Tables of a study: success rates, differences, surface errors, calibration, losses."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row
from lis_grasp_studies.calibration import (
    chance_calibration_error,
    expected_calibration_error,
)
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.report_page import TextTable, csv_text
from lis_grasp_studies.statistics import SuccessRate, cluster_sums, objects_of, success_rate
from lis_grasp_studies.study.comparison import (
    ERRORS,
    Comparison,
    Kind,
    Measure,
    agreements,
    compare_held,
    compare_one,
    compared,
    is_kind,
    kinds_of,
    losses,
    names,
    value_of,
)
from lis_grasp_studies.study.study_trial import COLUMNS
from lis_grasp_studies.study.trial import DEFAULT_CONDITIONS, TRIAL_COLUMNS, TRUTH

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


def all_tables(
    rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str
) -> list[TextTable]:
    """Return the tables of a study, in the order of the report."""
    return [
        summary_table(rows, reference),
        *(held_table(rows, kind) for kind in kinds_of(rows)),
        differences_table(rows, reference),
        comparisons_table(comparisons),
        nearer_table(rows, reference),
        calibration_table(rows),
        *(objects_table(rows, measure) for measure in ("held", *ERRORS)),
        reasons_table(rows),
        losses_table(rows, reference),
    ]


def write_tables(folder: Path, tables: Iterable[TextTable], rows: Sequence[Row]) -> None:
    """Write each table as CSV and LaTeX, and all rows as ``rows.csv``."""
    for table in tables:
        write_text(folder / f"{table.name}.csv", table.csv())
        write_text(folder / f"{table.name}.tex", table.latex())
    content = [[row.get(name) for name in COLUMNS] for row in rows]
    write_text(folder / "rows.csv", csv_text([COLUMNS, *content]))


def summary_table(rows: Sequence[Row], reference: str) -> TextTable:
    """Return success rates at each budget and with each hand, and the difference to the reference.

    Levels of noise are together.
    """
    budgets, hands = sorted(names(rows, "touches")), names(rows, "hand")
    against = {c.estimator: c for c in compare_held(rows, reference)}
    body = []
    for name in names(rows, "estimator"):
        of = _of(rows, estimator=name)
        parts = [*(_of(of, touches=n) for n in budgets), of, *(_of(of, hand=h) for h in hands)]
        found = against.get(name)
        last = (difference_text(found), p_value(found.p_holm) if found else "–")
        body.append((estimator_label(name), *(rate_text(success_rate(p)) for p in parts), *last))
    last = (f"minus {estimator_label(reference)}", "p, Holm")
    head = ("estimator", *_touches(budgets), "all", *hands, *last)
    title = f"Held, in percent, and difference from {estimator_label(reference)}, in points"
    return TextTable("summary", title, head, tuple(body))


def held_table(rows: Sequence[Row], kind: Kind) -> TextTable:
    """Return the success rate of each estimator at each budget and level of noise."""

    def cell(part: Sequence[Row], name: str, noise: str) -> str:
        return rate_text(success_rate(_of(part, noise=noise, estimator=name)))

    chosen = [row for row in rows if is_kind(row, kind)]
    title = f"Held, in percent, with 95 % intervals: {KIND_LABELS[kind]}"
    return _budgets_table(f"held_{kind}", title, chosen, names(chosen, "estimator"), cell)


def differences_table(rows: Sequence[Row], reference: str) -> TextTable:
    """Return the difference of success rates from the reference, at each budget and noise."""
    kind = kinds_of(rows)[0]

    def cell(part: Sequence[Row], name: str, noise: str) -> str:
        return difference_text(compare_one(part, name, reference, "held", kind, noise))

    title = f"Held, difference from {estimator_label(reference)}, in points, with 95 % intervals"
    title += f": {KIND_LABELS[kind]}"
    return _budgets_table("differences", title, rows, compared(rows, reference), cell)


def _budgets_table(
    table: str,
    title: str,
    rows: Sequence[Row],
    estimators: Sequence[str],
    cell: Callable[[Sequence[Row], str, str], str],
) -> TextTable:
    """Return a cell for each estimator and level of noise, at each budget and at all of them."""
    budgets = sorted(names(rows, "touches"))
    parts = [*(_of(rows, touches=n) for n in budgets), rows]
    body = tuple(
        (estimator_label(name), noise, *(cell(part, name, noise) for part in parts))
        for noise in names(rows, "noise")
        for name in estimators
    )
    return TextTable(table, title, ("estimator", "noise", *_touches(budgets), "all"), body)


def comparisons_table(comparisons: Sequence[Comparison]) -> TextTable:
    """Return every comparison: pairs, means, effect, intervals and p-values."""
    head = (
        *("estimator", "reference", "objects", "noise", "measure", "pairs", "clusters"),
        *("better", "worse", "mean", "reference mean", "difference", "95 %, seeds"),
        *("95 %, objects", "rank-biserial", "p, Holm", "p", "p, seeds", "p, objects"),
    )
    body = tuple(
        (
            *(estimator_label(c.estimator), estimator_label(c.reference), KIND_LABELS[c.kind]),
            *(c.noise or "all", MEASURE_LABELS[c.measure], str(c.pairs), str(c.clusters)),
            *(str(c.wins), str(c.losses)),
            *(printed(c.measure, c.mean), printed(c.measure, c.mean_reference)),
            printed(c.measure, c.effect, signed=True),
            interval_text(c.measure, c.low, c.high),
            interval_text(c.measure, c.objects_low, c.objects_high),
            "–" if c.rank_biserial is None else _signed(c.rank_biserial, 2),
            *map(p_value, (c.p_holm, c.p, c.p_seeds, c.p_objects)),
        )
        for c in comparisons
    )
    return TextTable("comparisons", "All comparisons", head, body)


def nearer_table(rows: Sequence[Row], reference: str) -> TextTable:
    """Return how often the surface with the smaller error held where only one did, by estimator."""
    others = compared(rows, reference)
    body = []
    for title, members in (*((estimator_label(n), [n]) for n in others), ("all", others)):
        chosen = [row for row in rows if row["estimator"] in (reference, *members)]
        found = {a.measure: a for a in agreements(chosen, reference)}
        cells = (
            f"{100.0 * a.agree / a.pairs:.0f} % of {a.pairs}, p {p_phrase(a.p)}" if a else "–"
            for a in map(found.get, ERRORS)
        )
        body.append((title, *cells))
    errors = (MEASURE_LABELS[measure].removesuffix(" [mm]") for measure in ERRORS)
    head = (f"{estimator_label(reference)} and", *errors)
    title = "Pairs of which only one held: how often the one with the smaller error"
    return TextTable("nearer", title, head, tuple(body))


def calibration_table(rows: Sequence[Row]) -> TextTable:
    """Return predicted and observed success rates of the executed grasps, and calibration errors.

    Beside each calibration error is that of right probabilities, by chance. The error by object is
    the mean over objects of |mean prediction - observed rate|: errors of different objects do not
    cancel.
    """
    body = []
    hands = names(rows, "hand")
    for hand in [*hands, None] if len(hands) > 1 else hands:
        for name in names(rows, "estimator"):
            of = [row for row in _of(rows, estimator=name) if hand in (None, row["hand"])]
            if name == TRUTH:
                of = list({_planned_from(row): row for row in of}.values())
            tried = [r for r in of if r["success_probability"] is not None]
            if not tried:
                continue
            predicted = np.array([row["success_probability"] for row in tried])
            held = np.array([bool(row["held"]) for row in tried])
            objects = objects_of(tried)
            by_object = np.abs(cluster_sums(predicted - held, objects)) / np.bincount(objects)
            error = expected_calibration_error(predicted, held)
            chance = chance_calibration_error(predicted)
            values = (predicted.mean(), held.mean(), error, chance, by_object.mean())
            cells = (f"{100.0 * value:.1f}" for value in values)
            body.append((estimator_label(name), hand or "all", str(len(tried)), *cells))
    head = (
        *("planned on", "hand", "grasps executed", "predicted", "observed"),
        *("calibration error", "by chance", "error by object"),
    )
    title = "Predicted and observed success rates, in percent"
    return TextTable("calibration", title, head, tuple(body))


def _planned_from(row: Row) -> tuple:
    """Return what decides a grasp on the true mesh: touches and noise move only a free object."""
    planned = (row["object"], row["hand"], row["seed"])
    is_fixed = row.get("conditions") in (None, DEFAULT_CONDITIONS)
    return planned if is_fixed else (*planned, row["touches"], row["noise"])


def objects_table(rows: Sequence[Row], measure: Measure) -> TextTable:
    """Return the mean of a measure for each object, level of noise and number of touches."""
    estimators = names(rows, "estimator")
    cells: dict[tuple[str, str, str], dict[str, list[float]]] = {}
    for row in rows:
        value = value_of(row, measure)
        if value is not None:
            of = cells.setdefault((row["object"], row["noise"], str(row["touches"])), {})
            of.setdefault(row["estimator"], []).append(value)
    body = tuple(
        (*cell, *(printed(measure, float(np.mean(of.get(n, np.nan)))) for n in estimators))
        for cell, of in cells.items()
    )
    head = ("object", "noise", "touches", *map(estimator_label, estimators))
    title = f"By object: {MEASURE_LABELS[measure]}"
    return TextTable(f"objects_{measure}", title, head, body)


def reasons_table(rows: Sequence[Row]) -> TextTable:
    """Return how many trials of each estimator ended for each reason."""
    estimators = names(rows, "estimator")
    counts = Counter((row["reason"], row["estimator"]) for row in rows)
    totals = Counter(row["reason"] for row in rows)
    ordered = sorted(totals, key=lambda reason: (reason != "held", -totals[reason]))
    body = tuple((reason, *(str(counts[reason, n]) for n in estimators)) for reason in ordered)
    head = ("reason", *map(estimator_label, estimators))
    return TextTable("reasons", "How trials ended", head, body)


def losses_table(rows: Sequence[Row], reference: str) -> TextTable:
    """Return every trial that the reference held and another estimator did not."""
    head = (
        *("estimator", *TRIAL_COLUMNS, "reason"),
        *("epsilon on the estimate", "on the truth", "estimate to truth [mm]"),
        *("edges to estimate [mm]", f"{estimator_label(reference)}: epsilon on the truth", "key"),
    )
    body = tuple(
        (
            estimator_label(mine["estimator"]),
            *(str(mine[name]) for name in TRIAL_COLUMNS),
            str(mine["failure"] or mine["reason"]),
            *(printed("epsilon_truth", mine[f"epsilon_{on}"]) for on in ("estimate", "truth")),
            *(printed(measure, mine[measure]) for measure in ("rmsd", "edge_rmsd")),
            printed("epsilon_truth", theirs["epsilon_truth"]),
            mine["key"],
        )
        for mine, theirs in losses(rows, reference)
    )
    title = f"Every trial that {estimator_label(reference)} held and another estimator did not"
    return TextTable("losses", title, head, body)


def printed(measure: str, value: float | None, *, signed: bool = False) -> str:
    """Return a value as text: rates in percent, lengths in mm; a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    factor, digits = _PRINTED.get(measure, _LENGTH)
    return _signed(factor * value, digits) if signed else f"{factor * value:.{digits}f}"


def interval_text(measure: str, low: float | None, high: float | None) -> str:
    """Return an interval of a difference as text; a dash for none."""
    if low is None or high is None:
        return "–"
    return " to ".join(printed(measure, end, signed=True) for end in (low, high))


def rate_text(rate: SuccessRate | None) -> str:
    """Return a success rate in percent with its interval, as text."""
    if rate is None:
        return "–"
    text = f"{100.0 * rate.value:.0f}"
    if rate.low is None or rate.high is None:
        return text
    return f"{text} ({100.0 * rate.low:.0f} to {100.0 * rate.high:.0f})"


def difference_text(comparison: Comparison | None) -> str:
    """Return a comparison's effect with its interval, as text; a dash for none."""
    c = comparison
    if c is None:
        return "–"
    text = printed(c.measure, c.effect, signed=True)
    return text if c.low is None else f"{text} ({interval_text(c.measure, c.low, c.high)})"


def p_value(p: float) -> str:
    """Return a p-value as text."""
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def p_phrase(p: float) -> str:
    """Return a p-value as text after the letter p."""
    return p_value(p) if p < 0.001 else f"= {p_value(p)}"


def _signed(value: float, digits: int) -> str:
    rounded = round(value, digits) + 0.0  # no minus before zero
    return f"{rounded:+.{digits}f}".replace("-", "−")


def _touches(budgets: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"{n} touches" for n in budgets)


def _of(rows: Sequence[Row], **columns: object) -> list[Row]:
    return [row for row in rows if all(row[name] == value for name, value in columns.items())]
