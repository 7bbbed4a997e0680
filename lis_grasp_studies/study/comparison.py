"""Paired comparison of estimators with a reference: tests, effects, and agreement with errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import itemgetter
from typing import Any, Literal, get_args

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.harness.statistics import (
    clustered_p_value,
    clusters_of,
    holm,
    interval_over_objects,
    interval_over_seeds,
    numbered,
    objects_of,
    rank_biserial,
    signed_ranks,
)
from lis_grasp_studies.study.trial import TRIAL_COLUMNS, TRUTH

Measure = Literal[
    "held", "epsilon_truth", "epsilon_gap", "rmsd", "rmsd_truth_to_estimate", "edge_rmsd"
]
Kind = Literal["all", "edged", "curved", "files"]

MEASURES: tuple[Measure, ...] = get_args(Measure)
KINDS: tuple[Kind, ...] = get_args(Kind)
"""All objects; built-in shapes with sharp edges, and without; mesh files, whose edges may be real
or noise of a scan."""

ERRORS: tuple[Measure, ...] = MEASURES[3:]
"""Errors of the surface."""

_LESS_IS_BETTER = ("epsilon_gap", *ERRORS)


@dataclass(frozen=True, slots=True)
class Comparison:
    """One estimator against the reference, by one measure, on one kind of objects."""

    estimator: str
    reference: str
    measure: Measure
    """Success rate ("held"; a trial without a grasp is not held); epsilon of the best grasp on the
    true object ("epsilon_truth"; 0 without a grasp); absolute difference between epsilon on the
    estimate and on the truth ("epsilon_gap", where both found a grasp); or a surface error [m],
    where both have one."""
    kind: Kind
    """Kind of the objects, see `KINDS`."""
    noise: str | None
    """Level of sensor noise; None for all levels together."""
    pairs: int
    """Number of trials: same object, hand, touches, noise and seed."""
    clusters: int
    """Number of clusters of pairs: those of one object and seed share their first touches."""
    wins: int
    losses: int
    """`wins` and `losses`: pairs in which the estimator is better, and worse."""
    mean: float
    mean_reference: float
    """`mean` and `mean_reference`: means of the measure over the pairs."""
    effect: float
    low: float | None
    high: float | None
    """`effect`: difference of the two means (of "held": the risk difference); `low` and `high`: its
    95 % interval for other seeds, see `interval_over_seeds`."""
    objects_low: float | None
    objects_high: float | None
    """Its interval for other objects, see `interval_over_objects`."""
    rank_biserial: float | None
    """Effect size of the measures other than "held": 1 where the estimator is always better, -1
    where it is always worse."""
    p: float
    """The exact two-sided test of McNemar ("held") or of Wilcoxon's signed ranks in which all pairs
    of a cluster flip together."""
    p_seeds: float
    p_objects: float
    """`p_seeds` and `p_objects`: `p` with all pairs of a seed, or of an object, as one cluster."""
    p_holm: float = 1.0
    """`p`, adjusted for all comparisons of the same measure and kind of objects, those of single
    levels of noise and those of all together apart."""


def compare(rows: Sequence[Row], reference: str) -> list[Comparison]:
    """Return every estimator against the reference, by every measure, kind of object and noise.

    Planning on the truth is no estimator, and is left out; so is a comparison without pairs.
    """
    return [
        comparison
        for measure, kind in product(MEASURES, kinds_of(rows))
        for comparison in _family(rows, reference, measure, kind, names(rows, "noise"))
    ]


def compare_held(rows: Sequence[Row], reference: str) -> list[Comparison]:
    """Return the comparisons of success rates over all objects and levels of noise together."""
    return _family(rows, reference, "held", kinds_of(rows)[0], [None])


def _family(
    rows: Sequence[Row], reference: str, measure: Measure, kind: Kind, noises: Sequence[str | None]
) -> list[Comparison]:
    """Return the comparisons of a measure and kind, their p-values adjusted for each other."""
    family = [
        comparison
        for noise in noises
        for name in compared(rows, reference)
        if (comparison := compare_one(rows, name, reference, measure, kind, noise))
    ]
    adjusted = holm([comparison.p for comparison in family])
    return [replace(c, p_holm=float(p)) for c, p in zip(family, adjusted, strict=True)]


def compare_one(
    rows: Sequence[Row],
    estimator: str,
    reference: str,
    measure: Measure,
    kind: Kind,
    noise: str | None,
) -> Comparison | None:
    """Return one comparison, not adjusted for others; None without pairs."""
    chosen = [row for row in rows if noise in (None, row["noise"]) and is_kind(row, kind)]
    pairs = [
        pair
        for pair in pairs_of(chosen, [estimator], reference)
        if None not in (value_of(row, measure) for row in pair)
    ]
    if not pairs:
        return None
    own_rows = [row for row, _ in pairs]
    values, others = (np.array([value_of(pair[k], measure) for pair in pairs]) for k in (0, 1))
    clusters = clusters_of(own_rows)
    differences = values - others
    gains = -differences if measure in _LESS_IS_BETTER else differences
    low, high = interval_over_seeds(own_rows, differences)
    objects_low, objects_high = interval_over_objects(own_rows, differences)
    binary = measure == "held"
    weights = np.sign(gains) if binary else signed_ranks(gains)
    return Comparison(
        estimator=estimator,
        reference=reference,
        measure=measure,
        kind=kind,
        noise=noise,
        pairs=len(pairs),
        clusters=len(set(clusters)),
        wins=int((gains > 0.0).sum()),
        losses=int((gains < 0.0).sum()),
        mean=float(values.mean()),
        mean_reference=float(others.mean()),
        effect=float(differences.mean()),
        low=low,
        high=high,
        objects_low=objects_low,
        objects_high=objects_high,
        rank_biserial=None if binary else rank_biserial(gains),
        p=clustered_p_value(weights, clusters),
        p_seeds=clustered_p_value(weights, numbered([row["seed"] for row in own_rows])),
        p_objects=clustered_p_value(weights, objects_of(own_rows)),
    )


@dataclass(frozen=True, slots=True)
class Agreement:
    """How often the estimator with the smaller surface error held, in pairs where only one did."""

    measure: Measure
    """The surface error."""
    agree: int
    """Pairs in which the one that held had the smaller error."""
    pairs: int
    """Pairs whose errors differ."""
    p: float
    """The exact sign test in which all pairs of one object and seed flip together."""


def agreements(rows: Sequence[Row], reference: str) -> list[Agreement]:
    """Return the agreement of each surface error with success, over all objects."""
    differing = [
        (row, other)
        for row, other in pairs_of(rows, compared(rows, reference), reference)
        if bool(row["held"]) != bool(other["held"])
    ]
    result = []
    for measure in ERRORS:
        pairs = [pair for pair in differing if None not in (pair[0][measure], pair[1][measure])]
        gains = [other[measure] - row[measure] for row, other in pairs]
        signs = np.sign(gains) * [1 if row["held"] else -1 for row, _ in pairs]
        if signs.any():
            p = clustered_p_value(signs, clusters_of([row for row, _ in pairs]))
            agree, decided = int((signs > 0).sum()), int(np.count_nonzero(signs))
            result.append(Agreement(measure, agree, decided, p))
    return result


def losses(rows: Sequence[Row], reference: str) -> list[tuple[Row, Row]]:
    """Return every pair in which the reference held and another estimator did not."""
    return [
        (row, other)
        for row, other in pairs_of(rows, compared(rows, reference), reference)
        if other["held"] and not row["held"]
    ]


def clearest_pairs(rows: Sequence[Row], reference: str) -> list[tuple[Row, Row]]:
    """Return the clearest win and the clearest loss of the best estimator, as (winner, loser).

    The best is the estimator with the most held trials, the reference apart; clearest is the
    largest difference of epsilon on the truth. A win or loss that does not occur is left out.
    """
    others = compared(rows, reference)
    if not others:
        return []
    best = max(others, key=lambda n: np.mean([r["held"] for r in rows if r["estimator"] == n]))
    pairs = pairs_of(rows, [best], reference)
    won = [(row, other) for row, other in pairs if row["held"] and not other["held"]]
    lost = [(other, row) for row, other in pairs if other["held"] and not row["held"]]

    def margin(pair: tuple[Row, Row]) -> tuple[float, str]:
        winner, loser = (row["epsilon_truth"] or 0.0 for row in pair)
        return winner - loser, pair[0]["key"]

    return [max(pairs, key=margin) for pairs in (won, lost) if pairs]


def value_of(row: Row, measure: str) -> float | None:
    """Return the value of a row that is compared; see `Comparison` for a row without a grasp."""
    value = row[measure]
    if measure in ("held", "epsilon_truth"):
        return float(value or 0.0)
    if value is None:
        return None
    return abs(float(value)) if measure == "epsilon_gap" else float(value)


def kind_of(row: Row) -> Kind:
    """Return the kind of a row's object, not "all"."""
    if row.get("object_digest") is not None:
        return "files"
    return "edged" if row["edged"] else "curved"


def is_kind(row: Row, kind: Kind) -> bool:
    """Return whether a row's object is of a kind; all are of "all"."""
    return kind in ("all", kind_of(row))


def kinds_of(rows: Sequence[Row]) -> list[Kind]:
    """Return the kinds of objects that occur; "all" first if there are several."""
    there = {kind_of(row) for row in rows}
    return [kind for kind in KINDS if kind in there or (kind == "all" and len(there) > 1)]


def compared(rows: Sequence[Row], reference: str) -> list[str]:
    """Return the estimators that are compared with the reference."""
    return [name for name in names(rows, "estimator") if name not in (reference, TRUTH)]


def names(rows: Sequence[Row], column: str) -> list[Any]:
    """Return the values of a column, each once, in the order of the rows."""
    return list(dict.fromkeys(row[column] for row in rows))


def pairs_of(
    rows: Sequence[Row], estimators: Sequence[str], reference: str
) -> list[tuple[Row, Row]]:
    """Return the rows of some estimators, each with the reference's row of the same trial."""
    trial_of = itemgetter(*TRIAL_COLUMNS)
    others = {trial_of(row): row for row in rows if row["estimator"] == reference}
    compared_rows = [row for row in rows if row["estimator"] in estimators]
    return [(row, others[trial_of(row)]) for row in compared_rows if trial_of(row) in others]
