"""What the rows of a study say: every estimator against the reference, pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from lis_grasp.evaluation.paper.summary import Table, tabulate
from lis_grasp.json_lines import Row
from lis_grasp.study.statistics import clustered, holm, mcnemar, rank_biserial, wilcoxon
from lis_grasp.study.study import TRUTH

FloatArray = npt.NDArray[np.float64]

Measure = Literal[
    "held", "epsilon_truth", "epsilon_gap", "rmsd", "rmsd_truth_to_estimate", "edge_rmsd"
]
Kind = Literal["edged", "curved"]

MEASURES: tuple[Measure, ...] = get_args(Measure)
KINDS: tuple[Kind, ...] = get_args(Kind)

LEAST_SEEDS = 5
"""Of a bootstrap interval: all resamples of fewer are too few to have tails of 2.5 %."""

# Where less is better.
_ERRORS = ("epsilon_gap", "rmsd", "rmsd_truth_to_estimate", "edge_rmsd")


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
        Objects with sharp edges, or without.
    noise
        Of the sensor.
    pairs
        Trials that count: same object, hand, touches and seed.
    wins, losses
        Pairs in which the estimator is better, and worse.
    mean, mean_reference
        Over objects, hands and touches of the means over seeds.
    effect, low, high
        Difference of the two means (of "held": the risk difference), with its 95 % bootstrap
        interval over seeds; None for fewer than `LEAST_SEEDS`, of which no interval can be told.
    rank_biserial
        Effect size of the measures that are no yes or no: 1 where the estimator is always better,
        -1 where it is always worse.
    p
        McNemar's exact test for "held", else Wilcoxon's signed ranks, two-sided.
    p_clustered
        The exact sign test of wins less losses in which all pairs of one object and seed flip
        together: these share their first touches, which `p` does not know.
    p_holm
        `p`, adjusted for all comparisons of a study.
    """

    estimator: str
    reference: str
    measure: Measure
    kind: Kind
    noise: str
    pairs: int
    wins: int
    losses: int
    mean: float
    mean_reference: float
    effect: float
    low: float | None
    high: float | None
    rank_biserial: float | None
    p: float
    p_clustered: float
    p_holm: float = 1.0


def compare(rows: Sequence[Row], reference: str) -> list[Comparison]:
    """Return every estimator against the reference, by every measure, kind of object and noise.

    Planning on the truth is no estimator, and is left out. So is what has no pair.
    """
    estimators = [name for name in _names(rows, "estimator") if name not in (reference, TRUTH)]
    found = [
        comparison
        for noise in _names(rows, "noise")
        for kind in KINDS
        for measure in MEASURES
        for name in estimators
        if (comparison := _compare(rows, name, reference, measure, kind, noise)) is not None
    ]
    adjusted = holm([comparison.p for comparison in found])
    return [replace(c, p_holm=float(p)) for c, p in zip(found, adjusted, strict=True)]


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
        The exact sign test of both being as likely.
    """

    measure: Measure
    kind: Kind
    agree: int
    disagree: int
    p: float


def agreements(rows: Sequence[Row], reference: str) -> list[Agreement]:
    """Return, for each surface error and kind of objects, whether it goes with what held.

    Pairs are those of `compare`, of all estimators against the reference.
    """
    paired = {_pair(row): row for row in rows if row["estimator"] == reference}
    split = [
        (row, paired[_pair(row)])
        for row in rows
        if row["estimator"] not in (reference, TRUTH)
        and _pair(row) in paired
        and bool(row["held"]) != bool(paired[_pair(row)]["held"])
    ]
    found = []
    for kind in KINDS:
        for measure in MEASURES[3:]:
            signs = [
                np.sign(theirs[measure] - mine[measure]) * (1 if mine["held"] else -1)
                for mine, theirs in split
                if kind_of(mine) == kind and None not in (mine[measure], theirs[measure])
            ]
            agree, disagree = signs.count(1), signs.count(-1)
            if agree + disagree:
                p = mcnemar(agree, disagree)
                found.append(Agreement(measure, kind, agree, disagree, p))
    return found


def losses(rows: Sequence[Row], reference: str) -> list[tuple[Row, Row]]:
    """Return every pair in which the reference held and another estimator did not."""
    held = {_pair(row): row for row in rows if row["estimator"] == reference and row["held"]}
    return [
        (row, held[_pair(row)])
        for row in rows
        if row["estimator"] not in (reference, TRUTH) and not row["held"] and _pair(row) in held
    ]


def measure_table(rows: Sequence[Row], measure: str, *, kind: str, noise: str) -> Table:
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
            if row["noise"] == noise and kind_of(row) == kind
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
    """Return whether a row's object has sharp edges."""
    return "edged" if row["edged"] else "curved"


def _compare(
    rows: Sequence[Row], estimator: str, reference: str, measure: Measure, kind: Kind, noise: str
) -> Comparison | None:
    table = measure_table(rows, measure, kind=kind, noise=noise)
    if not {estimator, reference} <= set(table.estimators):
        return None
    mine, theirs = table.of(estimator), table.of(reference)  # (cells, seeds)
    both = ~np.isnan(mine) & ~np.isnan(theirs)
    if not both.any():
        return None
    better = -1.0 if measure in _ERRORS else 1.0
    gains = better * np.where(both, mine - theirs, 0.0)
    wins, lost = int((gains > 0.0).sum()), int((gains < 0.0).sum())
    effect, low, high = table.difference(estimator, reference)
    told = len(table.seeds) >= LEAST_SEEDS
    yes_no = measure == "held"
    return Comparison(
        estimator=estimator,
        reference=reference,
        measure=measure,
        kind=kind,
        noise=noise,
        pairs=int(both.sum()),
        wins=wins,
        losses=lost,
        mean=_mean_over_cells(mine, both),
        mean_reference=_mean_over_cells(theirs, both),
        effect=effect,
        low=low if told else None,
        high=high if told else None,
        rank_biserial=None if yes_no else rank_biserial(gains[both]),
        p=mcnemar(wins, lost) if yes_no else wilcoxon(gains[both]),
        p_clustered=clustered(_by_object(table.objects, np.sign(gains))),
    )


def _mean_over_cells(values: FloatArray, both: npt.NDArray[np.bool_]) -> float:
    cells = both.any(axis=1)
    sums = np.where(both, values, 0.0).sum(axis=1)
    return float((sums[cells] / both.sum(axis=1)[cells]).mean())


def _by_object(cells: Sequence[str], signs: FloatArray) -> FloatArray:
    """Return the sums over hands and touches, for each object and seed, shape (C,)."""
    names = np.array([cell.split("\n")[0] for cell in cells])
    return np.concatenate([signs[names == name].sum(axis=0) for name in np.unique(names)])


def _cell(row: Row) -> str:
    return f"{row['object']}\n{row['hand']}\n{row['touches']}"


def _pair(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in ("object", "hand", "touches", "noise", "seed"))


def _names(rows: Sequence[Row], column: str) -> list[str]:
    return list(dict.fromkeys(row[column] for row in rows))
