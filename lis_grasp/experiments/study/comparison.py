"""What the rows of a study say: every estimator against the reference, pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from lis_grasp.experiments.paper.summary import Table, tabulate
from lis_grasp.experiments.statistics import (
    cluster_sums,
    holm,
    rank_biserial,
    sign_flip_p_value,
    signed_ranks,
)
from lis_grasp.experiments.study.clusters import (
    clusters_of,
    interval_over_objects,
    interval_over_seeds,
    objects_of,
)
from lis_grasp.experiments.study.study import TRIAL_COLUMNS, TRUTH
from lis_grasp.io.json_lines import Row

Measure = Literal[
    "held", "epsilon_truth", "epsilon_gap", "rmsd", "rmsd_truth_to_estimate", "edge_rmsd"
]
Kind = Literal["all", "edged", "curved", "files"]

MEASURES: tuple[Measure, ...] = get_args(Measure)
KINDS: tuple[Kind, ...] = get_args(Kind)
"""All objects; built-in shapes with sharp edges, and without; mesh files, of whose edges nobody
says which are real and which are a scan's noise."""

ERRORS: tuple[Measure, ...] = MEASURES[3:]
"""Errors of the surface."""

# Where less is better.
_LESS_IS_BETTER = ("epsilon_gap", *ERRORS)


@dataclass(frozen=True, slots=True)
class Comparison:
    """One estimator against the reference, by one measure, on one kind of objects.

    Parameters
    ----------
    estimator, reference
        Who is compared.
    measure
        "held": share of trials whose grasp lifted and held, no grasp being not held.
        "epsilon_truth": epsilon of the best grasp on the true object, 0 where there is no grasp.
        "epsilon_gap": by how much the estimate promised another epsilon than the truth keeps, as an
        absolute value, where both found a grasp. The rest are surface errors [m], where both have
        them.
    kind
        Of the objects, see `KINDS`.
    noise
        Of the sensor; None for all levels together.
    pairs
        Trials that count: same object, hand, touches, noise and seed.
    clusters
        Of pairs: those of one object and seed, which share their first touches.
    wins, losses
        Pairs in which the estimator is better, and worse.
    mean, mean_reference
        Over the pairs.
    effect, low, high
        Difference of the two means (of "held": the risk difference), with its 95 % interval had
        other seeds been drawn, see `interval_over_seeds`.
    objects_low, objects_high
        The interval of the effect had other objects been drawn, see `interval_over_objects`.
    rank_biserial
        Effect size of the measures that are no yes or no: 1 where the estimator is always better,
        -1 where it is always worse.
    p
        The exact test of McNemar ("held") or of Wilcoxon's signed ranks in which all pairs of a
        cluster flip together, two-sided.
    p_objects
        The same with all pairs of an object a cluster: the test for objects like these.
    p_holm
        `p`, adjusted for all comparisons of the same measure and kind of objects, those of single
        levels of noise and those of all together apart.
    """

    estimator: str
    reference: str
    measure: Measure
    kind: Kind
    noise: str | None
    pairs: int
    clusters: int
    wins: int
    losses: int
    mean: float
    mean_reference: float
    effect: float
    low: float | None
    high: float | None
    objects_low: float | None
    objects_high: float | None
    rank_biserial: float | None
    p: float
    p_objects: float
    p_holm: float = 1.0


def compare(rows: Sequence[Row], reference: str) -> list[Comparison]:
    """Return every estimator against the reference, by every measure, kind of object and noise.

    Planning on the truth is no estimator, and is left out. So is what has no pair.
    """
    found = []
    for measure in MEASURES:
        for kind in kinds_of(rows):
            found += _family(rows, reference, measure, kind, names(rows, "noise"))
    return found


def compare_held(rows: Sequence[Row], reference: str) -> list[Comparison]:
    """Return every estimator against the reference by what held: all objects, noises together."""
    return _family(rows, reference, "held", kinds_of(rows)[0], [None])


def _family(
    rows: Sequence[Row],
    reference: str,
    measure: Measure,
    kind: Kind,
    noises: Sequence[str | None],
) -> list[Comparison]:
    """Return the comparisons of a measure and kind, their p-values adjusted for each other."""
    family = [
        comparison
        for noise in noises
        for name in names(rows, "estimator")
        if name not in (reference, TRUTH)
        and (comparison := compare_one(rows, name, reference, measure, kind, noise))
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
    """Return one comparison, not adjusted for others; None where there is no pair."""
    chosen = [row for row in rows if noise in (None, row["noise"]) and is_kind(row, kind)]
    theirs = {pair_of(row): row for row in chosen if row["estimator"] == reference}
    known = [
        (row, value, other)
        for row in chosen
        if row["estimator"] == estimator
        and (its := theirs.get(pair_of(row))) is not None
        and (value := value_of(row, measure)) is not None
        and (other := value_of(its, measure)) is not None
    ]
    if not known:
        return None
    mine = [row for row, _, _ in known]
    values, others = (np.array([pair[k] for pair in known]) for k in (1, 2))
    clusters = clusters_of(mine)
    differences = values - others
    gains = -differences if measure in _LESS_IS_BETTER else differences
    low, high = interval_over_seeds(mine, differences)
    objects_low, objects_high = interval_over_objects(mine, differences)
    yes_no = measure == "held"
    weights = np.sign(gains) if yes_no else signed_ranks(gains)
    return Comparison(
        estimator=estimator,
        reference=reference,
        measure=measure,
        kind=kind,
        noise=noise,
        pairs=len(known),
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
        rank_biserial=None if yes_no else rank_biserial(gains),
        p=sign_flip_p_value(cluster_sums(weights, clusters)),
        p_objects=sign_flip_p_value(cluster_sums(weights, objects_of(mine))),
    )


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether the better surface of a pair had the better grasp, where only one of two held.

    Parameters
    ----------
    measure
        A surface error.
    kind
        Of the objects.
    agree, disagree
        Pairs in which the one that held had the smaller error, and the larger.
    p
        The exact sign test of both being as likely, in which all pairs of one object and seed flip
        together.
    """

    measure: Measure
    kind: Kind
    agree: int
    disagree: int
    p: float

    @property
    def pairs(self) -> int:
        """How many pairs there are."""
        return self.agree + self.disagree

    @property
    def share(self) -> float:
        """The share of pairs that agree, from 0 to 1."""
        return self.agree / self.pairs


def agreements(rows: Sequence[Row], reference: str) -> list[Agreement]:
    """Return, for each surface error and kind of objects, whether it goes with what held.

    Pairs are those of `compare`, of all estimators against the reference.
    """
    paired = {pair_of(row): row for row in rows if row["estimator"] == reference}
    split = [
        (row, paired[pair_of(row)])
        for row in rows
        if row["estimator"] not in (reference, TRUTH)
        and pair_of(row) in paired
        and bool(row["held"]) != bool(paired[pair_of(row)]["held"])
    ]
    found = []
    for kind in kinds_of(rows):
        for measure in ERRORS:
            known = [
                (mine, its)
                for mine, its in split
                if is_kind(mine, kind) and None not in (mine[measure], its[measure])
            ]
            signs = np.array(
                [
                    np.sign(its[measure] - mine[measure]) * (1 if mine["held"] else -1)
                    for mine, its in known
                ]
            )
            agree, disagree = int((signs > 0).sum()), int((signs < 0).sum())
            if agree + disagree:
                clusters = clusters_of([mine for mine, _ in known])
                p = sign_flip_p_value(cluster_sums(signs, clusters))
                found.append(Agreement(measure, kind, agree, disagree, p))
    return found


def losses(rows: Sequence[Row], reference: str) -> list[tuple[Row, Row]]:
    """Return every pair in which the reference held and another estimator did not."""
    held = {pair_of(row): row for row in rows if row["estimator"] == reference and row["held"]}
    return [
        (row, held[pair_of(row)])
        for row in rows
        if row["estimator"] not in (reference, TRUTH) and not row["held"] and pair_of(row) in held
    ]


def measure_table(rows: Sequence[Row], measure: str, *, kind: Kind, noise: str) -> Table:
    """Return a measure as a table whose objects are cells of object, hand and touches."""
    return tabulate(
        [
            {
                "experiment": kind,
                "object": _cell(row),
                "seed": row["seed"],
                "estimator": row["estimator"],
                measure: value_of(row, measure),
            }
            for row in rows
            if row["noise"] == noise and is_kind(row, kind)
        ],
        kind,
        measure,
    )


def value_of(row: Row, measure: str) -> float | None:
    """Return what counts of a row: see `Comparison` for what no grasp counts as."""
    value = row[measure]
    if measure == "held":
        return float(bool(value))
    if measure == "epsilon_truth":
        return 0.0 if value is None else float(value)
    if value is None:
        return None
    return abs(float(value)) if measure == "epsilon_gap" else float(value)


def kind_of(row: Row) -> Kind:
    """Return whether a row's object has sharp edges, or is of a file and nobody knows."""
    if row.get("object_digest") is not None:
        return "files"
    return "edged" if row["edged"] else "curved"


def is_kind(row: Row, kind: Kind) -> bool:
    """Tell whether a row's object is of a kind; all are of "all"."""
    return kind in ("all", kind_of(row))


def kinds_of(rows: Sequence[Row]) -> list[Kind]:
    """Return the kinds of objects that there are; "all" where there is more than one."""
    there = {kind_of(row) for row in rows}
    return [kind for kind in KINDS if kind in there or (kind == "all" and len(there) > 1)]


def pair_of(row: Row) -> tuple[Any, ...]:
    """Return what the rows of a pair have in common."""
    return tuple(row[name] for name in TRIAL_COLUMNS)


def names(rows: Sequence[Row], column: str) -> list[Any]:
    """Return the values of a column, each once, in the order in which they come."""
    return list(dict.fromkeys(row[column] for row in rows))


def _cell(row: Row) -> str:
    return f"{row['object']}\n{row['hand']}\n{row['touches']}"
