"""Tables of an estimator beside the reference: by family, by object, by unit of tests."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.figures.palette import estimator_label
from lis_grasp_studies.report_page import TextTable
from lis_grasp_studies.statistics import (
    cluster_sums,
    clusters_of,
    interval_over_objects,
    interval_over_seeds,
    numbered,
    objects_of,
    sign_flip_p_value,
)
from lis_grasp_studies.study.comparison import Measure, value_of
from lis_grasp_studies.study.study_tables import (
    MEASURE_LABELS,
    interval_text,
    p_value,
    printed,
)

Pairs = Sequence[tuple[Row, Row]]
"""Rows of an estimator, each with the reference's row of the same trial; see `pairs_of`."""


def gains(pairs: Pairs) -> FloatArray:
    """Return for each pair 1 where only the estimator held, -1 where only the reference did."""
    return np.array([float(mine["held"]) - float(its["held"]) for mine, its in pairs])


def difference(pairs: Pairs, *, over_objects: bool = False) -> str:
    """Return the difference of success rates in points, with its interval over seeds or objects."""
    if not pairs:
        return "–"
    found = gains(pairs)
    interval = interval_over_objects if over_objects else interval_over_seeds
    low, high = interval([mine for mine, _ in pairs], found)
    text = printed("held", float(found.mean()), signed=True)
    return text if low is None else f"{text} ({interval_text('held', low, high)})"


def families_table(
    pairs: Pairs, family: Callable[[Row], str], unions: Mapping[str, Collection[str]]
) -> TextTable:
    """Return success rates and their difference in each family, and in unions of families."""
    families = dict.fromkeys(family(mine) for mine, _ in pairs)
    body = []
    for name, parts in ({name: (name,) for name in families} | dict(unions)).items():
        of = [pair for pair in pairs if family(pair[0]) in parts]
        if of:
            objects = len({mine["object"] for mine, _ in of})
            held = [f"{100.0 * np.mean([pair[k]['held'] for pair in of]):.0f}" for k in (1, 0)]
            body.append((name, str(objects), *held, difference(of)))
    ours, reference = (estimator_label(pairs[0][k]["estimator"]) if pairs else "–" for k in (0, 1))
    rates = (f"{reference} [%]", f"{ours} [%]")
    head = ("family", "objects", *rates, "difference in points (95 %, other seeds)")
    return TextTable("families", "By shape family", head, tuple(body))


def units_table(pairs: Pairs, family: Callable[[Row], str]) -> TextTable:
    """Return the p-value of the exact sign-flip test with different independent units."""
    mine = [pair[0] for pair in pairs]
    body = []
    for name, units in (
        ("object and seed", clusters_of(mine)),
        ("object", objects_of(mine)),
        ("seed", numbered([row["seed"] for row in mine])),
        ("shape family", numbered([family(row) for row in mine])),
    ):
        p = sign_flip_p_value(cluster_sums(gains(pairs), units))
        body.append((name, str(len(set(units))), p_value(p)))
    return TextTable("units", "p by unit", ("unit that flips", "units", "p"), tuple(body))


def cells(pairs: Pairs, *columns: str) -> dict[tuple, list[tuple[Row, Row]]]:
    """Return the pairs by their values in some columns."""
    found: dict[tuple, list[tuple[Row, Row]]] = {}
    for pair in pairs:
        found.setdefault(tuple(pair[0][name] for name in columns), []).append(pair)
    return found


def object_losses_table(pairs: Pairs) -> TextTable:
    """Return objects and touches at which the reference held more often, worst first."""
    noises = sorted({mine["noise"] for mine, _ in pairs}, reverse=True)
    apart = noises if len(noises) > 1 else []
    body = []
    for (name, touches), of in cells(pairs, "object", "touches").items():
        if gains(of).mean() < 0.0:
            parts = [[pair for pair in of if pair[0]["noise"] == noise] for noise in apart]
            means = [float(gains(part).mean()) for part in (of, *parts)]
            texts = [printed("held", mean, signed=True) for mean in means]
            body.append((means[0], (name, str(touches), *texts)))
    head = ("object", "touches", "difference in points", *(f"noise {noise}" for noise in apart))
    return TextTable("losses", "Losses", head, tuple(row for _, row in sorted(body)))


def by_object_table(pairs: Pairs, measure: Measure) -> TextTable:
    """Return estimator / reference by object, touches and noise; bold where it is worse."""
    budgets = sorted({mine["touches"] for mine, _ in pairs})
    apart = len({mine["noise"] for mine, _ in pairs}) > 1
    found = cells(pairs, "object", "noise", "touches")
    body = []
    for name, noise in dict.fromkeys(key[:2] for key in found):
        texts = [beside(found.get((name, noise, n), []), measure) for n in budgets]
        if any(text != "–" for text in texts):
            body.append((name, *([noise] if apart else []), *texts))
    head = ("object", *(["noise"] if apart else []), *(f"{n} touches" for n in budgets))
    return TextTable(measure, MEASURE_LABELS[measure], head, tuple(body))


def means(pairs: Pairs, measure: Measure) -> tuple[float, float] | None:
    """Return the means of a measure over pairs in which both have it; None without such pairs."""
    values = [(value_of(mine, measure), value_of(its, measure)) for mine, its in pairs]
    known = [value for value in values if None not in value]
    if not known:
        return None
    ours, theirs = np.mean(np.array(known, dtype=float), axis=0)
    return float(ours), float(theirs)


def beside(pairs: Pairs, measure: Measure) -> str:
    """Return both means of a measure as a text, bold where the estimator's is worse."""
    both = means(pairs, measure)
    if both is None:
        return "–"
    ours, theirs = both
    digits, factor = (0, 1e2) if measure == "held" else (1, 1e3)
    text = f"{factor * ours:.{digits}f} / {factor * theirs:.{digits}f}"
    worse = ours < theirs if measure == "held" else ours > theirs
    return f"**{text}**" if worse else text
