"""Tables of a study: success rates, differences, surface errors, calibration, losses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import product
from operator import itemgetter

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.harness.calibration import (
    chance_calibration_error,
    expected_calibration_error,
)
from lis_grasp_studies.harness.statistics import cluster_sums, objects_of
from lis_grasp_studies.harness.tables import (
    NONE,
    Column,
    Table,
    columns_by,
    grouped_table,
    split,
    where,
)
from lis_grasp_studies.study.cells import (
    KIND_LABELS,
    MEASURE_LABELS,
    difference_text,
    held_text,
    interval_text,
    p_phrase,
    p_value,
    printed,
    signed_text,
)
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
from lis_grasp_studies.study.trial import DEFAULT_CONDITIONS, TRIAL_COLUMNS, TRUTH


def all_tables(
    rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str
) -> list[Table]:
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


def summary_table(rows: Sequence[Row], reference: str) -> Table:
    """Return success rates at each budget and with each hand, and the difference to the reference.

    Levels of noise are together.
    """
    comparisons = {c.estimator: c for c in compare_held(rows, reference)}

    def against(rows: Sequence[Row]) -> Comparison | None:
        return comparisons.get(rows[0]["estimator"])

    def adjusted_p(rows: Sequence[Row]) -> str:
        comparison = against(rows)
        return p_value(comparison.p_holm) if comparison else NONE

    columns: list[Column] = [
        *_budget_columns(rows, held_text),
        ("all", held_text),
        *columns_by("hand", rows, held_text),
        (f"minus {estimator_label(reference)}", lambda rows: difference_text(against(rows))),
        ("p, Holm", adjusted_p),
    ]
    title = f"Held, in percent, and difference from {estimator_label(reference)}, in points"
    return grouped_table("summary", title, "estimator", _by_estimator(rows), columns)


def held_table(rows: Sequence[Row], kind: Kind) -> Table:
    """Return the success rate of each estimator at each budget and level of noise."""
    rows = [row for row in rows if is_kind(row, kind)]
    title = f"Held, in percent, with 95 % intervals: {KIND_LABELS[kind]}"
    lines = product(names(rows, "noise"), names(rows, "estimator"))
    groups = {
        (estimator_label(name), noise): where(rows, estimator=name, noise=noise)
        for noise, name in lines
    }
    columns = [*_budget_columns(rows, held_text), ("all", held_text)]
    return grouped_table(f"held_{kind}", title, "estimator | noise", groups, columns)


def differences_table(rows: Sequence[Row], reference: str) -> Table:
    """Return the difference of success rates from the reference, at each budget and noise."""
    kind = kinds_of(rows)[0]
    body = []
    for noise, name in product(names(rows, "noise"), compared(rows, reference)):

        def cell(part: Sequence[Row], name: str = name, noise: str = noise) -> str:
            return difference_text(compare_one(part, name, reference, "held", kind, noise))

        columns = [*_budget_columns(rows, cell), ("all", cell)]
        body.append((estimator_label(name), noise, *(cell(rows) for _, cell in columns)))
    title = f"Held, difference from {estimator_label(reference)}, in points, with 95 % intervals"
    title += f": {KIND_LABELS[kind]}"
    head = (*(f"{budget} touches" for budget in sorted(names(rows, "touches"))), "all")
    return Table("differences", title, ("estimator", "noise", *head), tuple(body))


def _budget_columns(rows: Sequence[Row], cell: Callable[[Sequence[Row]], str]) -> list[Column]:
    """Return a column with a cell for each number of touches."""
    ordered = sorted(rows, key=itemgetter("touches"))
    return columns_by("touches", ordered, cell, lambda budget: f"{budget} touches")


def _count(rows: Sequence[Row]) -> str:
    return str(len(rows))


def _by_estimator(rows: Sequence[Row]) -> dict[str, list[Row]]:
    return {estimator_label(name): part for name, part in split(rows, "estimator").items()}


def comparisons_table(comparisons: Sequence[Comparison]) -> Table:
    """Return every comparison: pairs, means, effect, intervals and p-values."""
    columns: list[tuple[str, Callable[[Comparison], str]]] = [
        ("reference", lambda c: estimator_label(c.reference)),
        ("objects", lambda c: KIND_LABELS[c.kind]),
        ("noise", lambda c: c.noise or "all"),
        ("measure", lambda c: MEASURE_LABELS[c.measure]),
        ("pairs", lambda c: str(c.pairs)),
        ("clusters", lambda c: str(c.clusters)),
        ("better", lambda c: str(c.wins)),
        ("worse", lambda c: str(c.losses)),
        ("mean", lambda c: printed(c.measure, c.mean)),
        ("reference mean", lambda c: printed(c.measure, c.mean_reference)),
        ("difference", lambda c: printed(c.measure, c.effect, signed=True)),
        ("95 %, seeds", lambda c: interval_text(c.measure, c.low, c.high)),
        ("95 %, objects", lambda c: interval_text(c.measure, c.objects_low, c.objects_high)),
        ("rank-biserial", _rank_biserial),
        ("p, Holm", lambda c: p_value(c.p_holm)),
        ("p", lambda c: p_value(c.p)),
        ("p, seeds", lambda c: p_value(c.p_seeds)),
        ("p, objects", lambda c: p_value(c.p_objects)),
    ]
    body = tuple(
        (estimator_label(c.estimator), *(cell(c) for _, cell in columns)) for c in comparisons
    )
    head = ("estimator", *(head for head, _ in columns))
    return Table("comparisons", "All comparisons", head, body)


def _rank_biserial(comparison: Comparison) -> str:
    value = comparison.rank_biserial
    return NONE if value is None else signed_text(value, 2)


def nearer_table(rows: Sequence[Row], reference: str) -> Table:
    """Return how often the surface with the smaller error held where only one did, by estimator."""
    others = compared(rows, reference)
    body = []
    for title, members in (*((estimator_label(name), [name]) for name in others), ("all", others)):
        chosen = [row for row in rows if row["estimator"] in (reference, *members)]
        by_measure = {a.measure: a for a in agreements(chosen, reference)}
        cells = (
            f"{100.0 * a.agree / a.pairs:.0f} % of {a.pairs}, p {p_phrase(a.p)}" if a else NONE
            for a in map(by_measure.get, ERRORS)
        )
        body.append((title, *cells))
    errors = (MEASURE_LABELS[measure].removesuffix(" [mm]") for measure in ERRORS)
    head = (f"{estimator_label(reference)} and", *errors)
    title = "Pairs of which only one held: how often the one with the smaller error"
    return Table("nearer", title, head, tuple(body))


def calibration_table(rows: Sequence[Row]) -> Table:
    """Return predicted and observed success rates of the executed grasps, and calibration errors.

    Beside each calibration error is that of right probabilities, by chance. The error by object is
    the mean over objects of |mean prediction - observed rate|: errors of different objects do not
    cancel.
    """
    hands = names(rows, "hand")
    body = []
    for hand in [*hands, None] if len(hands) > 1 else hands:
        for name, group in split(rows, "estimator").items():
            executed = [
                row
                for row in (_without_repetitions(group) if name == TRUTH else group)
                if hand in (None, row["hand"]) and row["success_probability"] is not None
            ]
            if executed:
                cells = (f"{100.0 * value:.1f}" for value in _calibration(executed))
                label = (estimator_label(name), hand or "all", str(len(executed)))
                body.append((*label, *cells))
    head = (
        *("planned on", "hand", "grasps executed", "predicted", "observed"),
        *("calibration error", "by chance", "error by object"),
    )
    title = "Predicted and observed success rates, in percent"
    return Table("calibration", title, head, tuple(body))


def _calibration(rows: Sequence[Row]) -> tuple[float, ...]:
    """Return the mean prediction, the rate, and three errors of executed grasps."""
    predicted = np.array([row["success_probability"] for row in rows])
    held = np.array([bool(row["held"]) for row in rows])
    objects = objects_of(rows)
    by_object = np.abs(cluster_sums(predicted - held, objects)) / np.bincount(objects)
    errors = expected_calibration_error(predicted, held), chance_calibration_error(predicted)
    return (float(predicted.mean()), float(held.mean()), *errors, float(by_object.mean()))


def _without_repetitions(rows: Sequence[Row]) -> list[Row]:
    """Return rows of the true mesh without those of the same grasp.

    Touches and noise move only a free object.
    """

    def decides(row: Row) -> tuple:
        planned = (row["object"], row["hand"], row["seed"])
        is_fixed = row.get("conditions") in (None, DEFAULT_CONDITIONS)
        return planned if is_fixed else (*planned, row["touches"], row["noise"])

    return list({decides(row): row for row in rows}.values())


def objects_table(rows: Sequence[Row], measure: Measure) -> Table:
    """Return the mean of a measure for each object, level of noise and number of touches."""

    def mean(rows: Sequence[Row]) -> str:
        values = [value_of(row, measure) for row in rows]
        present = [value for value in values if value is not None]
        return printed(measure, float(np.mean(present)) if present else None)

    measured = [row for row in rows if value_of(row, measure) is not None]
    return grouped_table(
        f"objects_{measure}",
        f"By object: {MEASURE_LABELS[measure]}",
        "object | noise | touches",
        split(measured, "object", "noise", "touches"),
        columns_by("estimator", rows, mean, estimator_label),
    )


def reasons_table(rows: Sequence[Row]) -> Table:
    """Return how many trials of each estimator ended for each reason."""
    totals = Counter(row["reason"] for row in rows)
    ordered = sorted(totals, key=lambda reason: (reason != "held", -totals[reason]))
    columns = columns_by("estimator", rows, _count, estimator_label)
    groups = {reason: where(rows, reason=reason) for reason in ordered}
    return grouped_table("reasons", "How trials ended", "reason", groups, columns)


def losses_table(rows: Sequence[Row], reference: str) -> Table:
    """Return every trial that the reference held and another estimator did not."""
    head = (
        *("estimator", *TRIAL_COLUMNS, "reason"),
        *("epsilon on the estimate", "on the truth", "estimate to truth [mm]"),
        *("edges to estimate [mm]", f"{estimator_label(reference)}: epsilon on the truth", "key"),
    )
    body = tuple(
        (
            estimator_label(loss["estimator"]),
            *(str(loss[name]) for name in TRIAL_COLUMNS),
            str(loss["failure"] or loss["reason"]),
            *(printed("epsilon_truth", loss[f"epsilon_{on}"]) for on in ("estimate", "truth")),
            *(printed(measure, loss[measure]) for measure in ("rmsd", "edge_rmsd")),
            printed("epsilon_truth", win["epsilon_truth"]),
            loss["key"],
        )
        for loss, win in losses(rows, reference)
    )
    title = f"Every trial that {estimator_label(reference)} held and another estimator did not"
    return Table("losses", title, head, body)
