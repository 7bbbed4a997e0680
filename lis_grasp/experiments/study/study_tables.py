"""What a study came to, as tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from lis_grasp.evaluation.calibration import expected_calibration_error
from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.study.comparison import (
    ERRORS,
    Agreement,
    Comparison,
    Kind,
    agreements,
    compare_held,
    compare_one,
    is_kind,
    kinds_of,
    losses,
    measure_table,
    names,
)
from lis_grasp.experiments.study.study import TRIAL_COLUMNS, TRUTH
from lis_grasp.experiments.study.study_results import COLUMNS
from lis_grasp.experiments.study.study_table import StudyTable, csv_text
from lis_grasp.experiments.study.success_rates import Share, share_of
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.io.json_lines import Row

MEASURE_LABELS = {
    "held": "held",
    "epsilon_truth": "epsilon on the truth",
    "epsilon_gap": "gap of epsilon",
    "rmsd": "estimate to truth [mm]",
    "rmsd_truth_to_estimate": "truth to estimate [mm]",
    "edge_rmsd": "edges to estimate [mm]",
}
"""What each measure is called."""

KIND_LABELS: Mapping[Kind, str] = MappingProxyType(
    {
        "all": "all objects",
        "edged": "edged objects",
        "curved": "curved objects",
        "files": "objects of mesh files",
    }
)
"""What each kind of objects is called."""

# Measure -> factor to what is printed, and its digits.
_PRINTED = {"held": (1e2, 1), "epsilon_truth": (1.0, 3), "epsilon_gap": (1.0, 3)}
_LENGTH = (1e3, 2)


def all_tables(
    rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str
) -> list[StudyTable]:
    """Return the tables of a study, in the order of the report."""
    noises = names(rows, "noise")
    return [
        summary_table(rows, reference),
        *(held_table(rows, kind) for kind in kinds_of(rows)),
        differences_table(rows, reference),
        comparisons_table(comparisons),
        nearer_table(rows, reference),
        agreements_table(rows, reference),
        foretold_table(rows),
        overview_table(rows),
        *(objects_table(rows, noise) for noise in noises),
        reasons_table(rows),
        losses_table(rows, reference),
    ]


def write_tables(folder: Path, tables: Iterable[StudyTable], rows: Sequence[Row]) -> None:
    """Write each table as CSV and LaTeX, and all rows as ``rows.csv``."""
    for table in tables:
        write_text(folder / f"{table.name}.csv", table.csv())
        write_text(folder / f"{table.name}.tex", table.latex())
    content = [[_plain(row.get(name)) for name in COLUMNS] for row in rows]
    write_text(folder / "rows.csv", csv_text([COLUMNS, *content]))


def summary_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return the share of held grasps of each estimator, at each budget and with each hand.

    Noises are together; the last two columns hold each estimator against the reference.
    """
    budgets, hands = sorted(names(rows, "touches")), names(rows, "hand")
    against = {c.estimator: c for c in compare_held(rows, reference)}
    body = []
    for name in names(rows, "estimator"):
        of = [row for row in rows if row["estimator"] == name]
        parts = [[r for r in of if r["touches"] == n] for n in budgets]
        parts += [of, *([r for r in of if r["hand"] == hand] for hand in hands)]
        found = against.get(name)
        last = ("–", "–") if found is None else (difference_text(found), p_value(found.p_holm))
        body.append((estimator_label(name), *(share_text(share_of(p)) for p in parts), *last))
    who = estimator_label(reference)
    head = (
        *("estimator", *(f"{n} touches" for n in budgets), "all", *hands),
        *(f"against {who}", "p, Holm"),
    )
    title = f"In short: held, in percent, and points more (+) or less (−) than {who}"
    return StudyTable("summary", title, head, tuple(body))


def held_table(rows: Sequence[Row], kind: Kind) -> StudyTable:
    """Return the share of held grasps, with its interval, of each estimator at each budget."""
    chosen = [row for row in rows if is_kind(row, kind)]
    budgets = sorted(names(chosen, "touches"))
    body = []
    for noise in names(chosen, "noise"):
        for name in names(chosen, "estimator"):
            of = [r for r in chosen if r["noise"] == noise and r["estimator"] == name]
            cells = [share_of([r for r in of if r["touches"] == n]) for n in budgets]
            told = (share_text(share) for share in (*cells, share_of(of)))
            body.append((estimator_label(name), noise, *told))
    head = ("estimator", "noise", *(f"{n} touches" for n in budgets), "all")
    title = f"Held, in percent, with 95 % intervals: {KIND_LABELS[kind]}"
    return StudyTable(f"held_{kind}", title, head, tuple(body))


def differences_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return by how many points each estimator holds more than the reference, at each budget."""
    budgets = sorted(names(rows, "touches"))
    kind = kinds_of(rows)[0]
    body = []
    for noise in names(rows, "noise"):
        for name in names(rows, "estimator"):
            if name in (reference, TRUTH):
                continue
            found = [
                compare_one(chosen, name, reference, "held", kind, noise)
                for chosen in (*([r for r in rows if r["touches"] == n] for n in budgets), rows)
            ]
            cells = ("–" if c is None else difference_text(c) for c in found)
            body.append((estimator_label(name), noise, *cells))
    head = ("estimator", "noise", *(f"{n} touches" for n in budgets), "all")
    title = (
        f"Held more (+) or less (−) than {estimator_label(reference)}, in points, with 95 %"
        f" intervals: {KIND_LABELS[kind]}"
    )
    return StudyTable("differences", title, head, tuple(body))


def comparisons_table(comparisons: Sequence[Comparison]) -> StudyTable:
    """Return every comparison: pairs, means, effect and what it is worth."""
    head = (
        *("estimator", "against", "objects", "noise", "measure", "pairs", "clusters"),
        *("better", "worse", "mean", "reference", "difference", "95 %, seeds", "95 %, objects"),
        *("rank-biserial", "p, Holm", "p", "p, objects"),
    )
    body = tuple(
        (
            estimator_label(c.estimator),
            estimator_label(c.reference),
            KIND_LABELS[c.kind],
            c.noise or "all",
            _label(c.measure),
            str(c.pairs),
            str(c.clusters),
            str(c.wins),
            str(c.losses),
            printed(c.measure, c.mean),
            printed(c.measure, c.mean_reference),
            printed(c.measure, c.effect, signed=True),
            interval(c),
            objects_interval(c),
            "–" if c.rank_biserial is None else f"{c.rank_biserial:+.2f}".replace("-", "−"),
            p_value(c.p_holm),
            p_value(c.p),
            p_value(c.p_objects),
        )
        for c in comparisons
    )
    return StudyTable("comparisons", "Every comparison, pair by pair", head, body)


def agreements_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return whether smaller surface errors go with grasps that hold, pair by pair."""
    body = tuple(
        (_label(a.measure), KIND_LABELS[a.kind], str(a.agree), str(a.disagree), p_value(a.p))
        for a in agreements(rows, reference)
    )
    head = ("error", "objects", "the nearer surface held", "the farther one held", "p")
    title = f"Where only one of two held, of all estimators with {estimator_label(reference)}"
    return StudyTable("agreements", title, head, body)


def nearer_table(rows: Sequence[Row], reference: str, *, without: Sequence[str] = ()) -> StudyTable:
    """Return how often the nearer of two surfaces held, where only one did, by estimator.

    Parameters
    ----------
    rows
        Of all estimators.
    reference
        With which each makes its pairs.
    without
        Estimators without each of which all others are counted together, too.
    """
    others = [name for name in names(rows, "estimator") if name not in (reference, TRUTH)]
    groups = {estimator_label(name): [name] for name in others}
    groups["all"] = others
    for name in without:
        groups[f"all but {estimator_label(name)}"] = [n for n in others if n != name]
    kind = kinds_of(rows)[0]
    body = []
    for title, members in groups.items():
        chosen = [row for row in rows if row["estimator"] in (reference, *members)]
        found = {a.measure: a for a in agreements(chosen, reference) if a.kind == kind}
        body.append((title, *(_agreement(found.get(measure)) for measure in ERRORS)))
    who = estimator_label(reference)
    head = (f"{who} and", *(MEASURE_LABELS[measure].removesuffix(" [mm]") for measure in ERRORS))
    title = f"Where only one of two held: how often the nearer surface, {KIND_LABELS[kind]}"
    return StudyTable("nearer", title, head, tuple(body))


def _agreement(found: Agreement | None) -> str:
    if found is None:
        return "–"
    return f"{100.0 * found.share:.0f} % of {found.pairs}, p {p_phrase(found.p)}"


def foretold_table(rows: Sequence[Row]) -> StudyTable:
    """Return how many executed grasps were foretold to hold, and how many did."""
    body = []
    for hand in names(rows, "hand"):
        for name in names(rows, "estimator"):
            of = [r for r in rows if r["hand"] == hand and r["estimator"] == name]
            if name == TRUTH:  # the same grasp for every number of touches and every noise
                of = list({(r["object"], r["seed"]): r for r in of}.values())
            tried = [r for r in of if r["success_probability"] is not None]
            if not tried:
                continue
            foretold = [r["success_probability"] for r in tried]
            held = [bool(r["held"]) for r in tried]
            means = (sum(foretold) / len(tried), sum(held) / len(tried))
            error = expected_calibration_error(foretold, held)
            shares = (f"{100.0 * share:.1f}" for share in (*means, error))
            body.append((estimator_label(name), hand, str(len(tried)), *shares))
    head = ("planned on", "hand", "grasps executed", "foretold", "held", "calibration error")
    return StudyTable("foretold", "Foretold to hold and held, in percent", head, tuple(body))


def overview_table(rows: Sequence[Row]) -> StudyTable:
    """Return the means of every measure, for each estimator, kind of objects and noise."""
    body = []
    for noise in dict.fromkeys(row["noise"] for row in rows):
        for kind in kinds_of(rows):
            tables = {m: measure_table(rows, m, kind=kind, noise=noise) for m in MEASURE_LABELS}
            for name in tables["held"].estimators:
                values = [printed(m, t.overall(name)) for m, t in tables.items()]
                body.append((estimator_label(name), KIND_LABELS[kind], noise, *values))
    head = ("estimator", "objects", "noise", *(_label(measure) for measure in MEASURE_LABELS))
    return StudyTable("overview", "Means over objects, hands, touches and seeds", head, tuple(body))


def objects_table(rows: Sequence[Row], noise: str) -> StudyTable:
    """Return how many grasps held of how many, for each object and number of touches."""
    chosen = [row for row in rows if row["noise"] == noise]
    estimators = names(chosen, "estimator")
    cells: dict[tuple[str, str, str], dict[str, list[bool]]] = {}
    for row in chosen:
        cell = cells.setdefault((row["object"], row["hand"], str(row["touches"])), {})
        cell.setdefault(row["estimator"], []).append(bool(row["held"]))
    body = tuple(
        (*cell, *(f"{sum(of[n])} of {len(of[n])}" if n in of else "–" for n in estimators))
        for cell, of in cells.items()
    )
    head = ("object", "hand", "touches", *(estimator_label(name) for name in estimators))
    name = "objects_" + noise.replace("/", "_").replace(".", "_")
    return StudyTable(name, f"Grasps that held, noise: {noise}", head, body)


def reasons_table(rows: Sequence[Row]) -> StudyTable:
    """Return how trials ended, counted."""
    who = names(rows, "estimator")
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        of = counts.setdefault(row["reason"], dict.fromkeys(who, 0))
        of[row["estimator"]] += 1
    ordered = sorted(counts, key=lambda reason: (reason != "held", -sum(counts[reason].values())))
    body = tuple((reason, *(str(counts[reason][name]) for name in who)) for reason in ordered)
    head = ("ended as", *(estimator_label(name) for name in who))
    return StudyTable("reasons", "How trials ended", head, body)


def losses_table(rows: Sequence[Row], reference: str) -> StudyTable:
    """Return every trial that the reference held and another estimator did not."""
    head = (
        *("estimator", *TRIAL_COLUMNS, "ended as"),
        *("epsilon on the estimate", "on the truth", "estimate to truth [mm]"),
        *("edges to estimate [mm]", f"{estimator_label(reference)}: epsilon on the truth", "key"),
    )
    body = tuple(
        (
            estimator_label(mine["estimator"]),
            *(str(mine[name]) for name in TRIAL_COLUMNS),
            str(mine["failure"] or mine["reason"]),
            printed("epsilon_truth", mine["epsilon_estimate"]),
            printed("epsilon_truth", mine["epsilon_truth"]),
            printed("rmsd", mine["rmsd"]),
            printed("edge_rmsd", mine["edge_rmsd"]),
            printed("epsilon_truth", theirs["epsilon_truth"]),
            mine["key"],
        )
        for mine, theirs in losses(rows, reference)
    )
    title = f"Every trial that {estimator_label(reference)} held and another did not"
    return StudyTable("losses", title, head, body)


def printed(measure: str, value: float | None, *, signed: bool = False) -> str:
    """Return a value as it is printed: shares in percent, lengths in mm; a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    factor, digits = _PRINTED.get(measure, _LENGTH)
    rounded = round(factor * value, digits) + 0.0  # no minus before zero
    return f"{rounded:{'+' if signed else ''}.{digits}f}".replace("-", "−")


def interval(comparison: Comparison) -> str:
    """Return the interval of a comparison's effect, had other seeds been drawn, as printed."""
    return _interval(comparison.measure, comparison.low, comparison.high)


def objects_interval(comparison: Comparison) -> str:
    """Return the interval of a comparison's effect, had other objects been drawn, as printed."""
    return _interval(comparison.measure, comparison.objects_low, comparison.objects_high)


def share_text(share: Share | None) -> str:
    """Return a share in percent with its interval, as it is printed."""
    if share is None:
        return "–"
    told = f"{100.0 * share.value:.0f}"
    if share.low is None or share.high is None:
        return told
    return f"{told} ({100.0 * share.low:.0f} to {100.0 * share.high:.0f})"


def difference_text(comparison: Comparison) -> str:
    """Return a comparison's effect with its interval, as they are printed."""
    told = printed(comparison.measure, comparison.effect, signed=True)
    return told if comparison.low is None else f"{told} ({interval(comparison)})"


def p_value(p: float) -> str:
    """Return a p-value as it is printed."""
    return f"{p:.3f}" if p >= 0.001 else "< 0.001"


def p_phrase(p: float) -> str:
    """Return a p-value as it is printed after the letter p."""
    return p_value(p) if p < 0.001 else f"= {p_value(p)}"


def _interval(measure: str, low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return "–"
    return " to ".join(printed(measure, end, signed=True) for end in (low, high))


def _label(measure: str) -> str:
    return MEASURE_LABELS[measure] + (" [%]" if measure == "held" else "")


def _plain(value: object) -> str:
    return "" if value is None else str(value)
