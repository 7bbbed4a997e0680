"""The answer of a study in plain words, made of its numbers and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

from lis_grasp.experiments.figures.palette import estimator_label
from lis_grasp.experiments.study.comparison import (
    Agreement,
    Comparison,
    agreements,
    compare_held,
    compare_one,
    kinds_of,
    names,
)
from lis_grasp.experiments.study.study import TRUTH
from lis_grasp.experiments.study.study_tables import (
    KIND_LABELS,
    difference_text,
    objects_interval,
    p_phrase,
    share_text,
)
from lis_grasp.experiments.study.success_rates import Share, share_of
from lis_grasp.io.json_lines import Row

ALPHA = 0.05
"""Adjusted p-values up to here are told as differences."""


def answer(rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str) -> list[str]:
    """Return paragraphs: on all noise and on each level, on surfaces and grasps, how sure it is."""
    levels: list[str | None] = list(names(rows, "noise"))
    overall = compare_held(rows, reference)
    if len(levels) > 1:
        comparisons, levels = [*overall, *comparisons], [None, *levels]
    told = [_of_noise(rows, comparisons, reference, noise) for noise in levels]
    told += [
        _of_objects(rows, overall, reference),
        _of_surfaces(rows, reference),
        _of_precision(rows, overall, reference),
    ]
    return [paragraph for paragraph in told if paragraph]


def _of_noise(
    rows: Sequence[Row], comparisons: Sequence[Comparison], reference: str, noise: str | None
) -> str:
    kind = kinds_of(rows)[0]
    chosen = [row for row in rows if noise in (None, row["noise"])]
    of = {n: [r for r in chosen if r["estimator"] == n] for n in names(chosen, "estimator")}
    shares = {name: share for name, r in of.items() if (share := share_of(r)) is not None}
    against = [c for c in comparisons if (c.measure, c.kind, c.noise) == ("held", kind, noise)]
    if reference not in shares:
        return ""
    who = estimator_label(reference)
    ranked = sorted(against, key=lambda c: -c.effect)
    more = [c for c in ranked if c.p_holm <= ALPHA and c.effect > 0.0]
    fewer = [c for c in reversed(ranked) if c.p_holm <= ALPHA and c.effect < 0.0]
    same = [estimator_label(c.estimator) for c in ranked if c.p_holm > ALPHA]
    where = "Without noise" if noise == "none" else f"With noise of {noise}"
    if noise is None:
        where = "With all levels of noise together"
    text = (
        f"{where}, over {KIND_LABELS[kind]}, hands and touches, {who} held"
        f" {share_text(shares[reference])} % of its trials"
    )
    if TRUTH in shares and reference != TRUTH:
        text += f", planning on the true mesh {share_text(shares[TRUTH])} %"
    if not against:
        return f"{text}."
    text += f". {_listed('More', more, who)} {_listed('Fewer', fewer, who)}"
    if same:
        text += f" No difference from {who} is shown for {_joined(same)}."
    first = ranked[0]
    steps = [
        (n, compare_one(_of_budget(chosen, n), first.estimator, reference, "held", kind, noise))
        for n in sorted(names(chosen, "touches"))
    ]
    parts = [f"at {n} touches {difference_text(c)}" for n, c in steps if c is not None]
    name = estimator_label(first.estimator)
    rank = "which held most" if first.effect > 0.0 else "the best of the others"
    return f"{text} {name}, {rank}, against {who}, in points: {', '.join(parts)}."


def _of_objects(rows: Sequence[Row], overall: Sequence[Comparison], reference: str) -> str:
    """Tell what the differences come to if objects are taken as drawn."""
    parts = [
        f"{estimator_label(c.estimator)} {objects_interval(c)} (p {p_phrase(c.p_objects)})"
        for c in sorted(overall, key=lambda c: -c.effect)
        if c.objects_low is not None
    ]
    if not parts:
        return ""
    count, who = len(names(rows, "object")), estimator_label(reference)
    return (
        f"These intervals are about these {count} objects. Drawing other objects like them instead,"
        f" differences from {who} lie, in points, within: {'; '.join(parts)}; these p are not"
        " adjusted."
    )


def _of_surfaces(rows: Sequence[Row], reference: str) -> str:
    kind = kinds_of(rows)[0]
    found = {a.measure: a for a in agreements(rows, reference) if a.kind == kind}
    if not found:
        return (
            "Of no pair with a measured surface did only one hold: whether the nearer surface is"
            " the better one to grasp cannot be told."
        )
    words = {
        "edge_rmsd": "at the edges",
        "rmsd": "from the estimate to the truth",
        "rmsd_truth_to_estimate": "from the truth to the estimate",
    }
    parts = [
        f"measured {words[measure]}, in {_share(found[measure])}"  # type: ignore[index]
        for measure in words
        if measure in found
    ]
    return (
        f"In pairs of an estimator and {estimator_label(reference)}, of which exactly one held, it"
        f" was the one with the smaller error: {'; '.join(parts)}. Half of the pairs would be"
        " chance; these p are not adjusted."
    )


def _of_precision(rows: Sequence[Row], overall: Sequence[Comparison], reference: str) -> str:
    """Tell half the width of the widest interval: of shares, and of differences."""
    widths: list[float | None] = []
    for columns in (("estimator",), ("estimator", "touches")):
        cells: dict[tuple[object, ...], list[Row]] = {}
        for row in rows:
            cells.setdefault(tuple(row[name] for name in columns), []).append(row)
        shares = [share for of in cells.values() if (share := share_of(of)) is not None]
        widths.append(_widest(shares))
    if None in widths:
        return "There are too few objects and seeds for intervals of all shares."
    told = (
        f"Over {KIND_LABELS[kinds_of(rows)[0]]}, shares of all touches together are known to"
        f" ±{widths[0]:.1f} points or better, those of one number of touches to ±{widths[1]:.1f}"
    )
    of_differences = _widest([c for c in overall if c.low is not None])
    if of_differences is None:
        return f"{told}."
    who = estimator_label(reference)
    return f"{told}; differences from {who}, of all touches together, to ±{of_differences:.1f}."


def _widest(found: Sequence[Share] | Sequence[Comparison]) -> float | None:
    """Return half the width of the widest interval in points; None where one is not known."""
    widths = [x.high - x.low for x in found if x.low is not None and x.high is not None]
    return 50.0 * max(widths) if widths and len(widths) == len(found) else None


def _share(found: Agreement) -> str:
    pairs = "pair" if found.pairs == 1 else "pairs"
    return f"{100.0 * found.share:.0f} % of {found.pairs} {pairs} (p {p_phrase(found.p)})"


def _listed(word: str, found: Sequence[Comparison], who: str) -> str:
    if not found:
        return f"{word} than {who}: none."
    parts = [
        f"{estimator_label(c.estimator)} {difference_text(c)} points, p {p_phrase(c.p_holm)}"
        for c in found
    ]
    return f"{word} than {who}: {'; '.join(parts)}."


def _joined(items: Sequence[str]) -> str:
    return "; ".join(items)  # names have commas


def _of_budget(rows: Sequence[Row], touches: int) -> list[Row]:
    return [row for row in rows if row["touches"] == touches]
