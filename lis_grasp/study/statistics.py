"""Paired tests, effect sizes and intervals, free of distributions; the tests are exact.

All three tests ask one question: if each difference were as likely to be of the other sign, how
often would their weighted sum be as far from zero as it is (Fisher 1935)? Weights of 1 make it
McNemar's exact test, ranks Wilcoxon's, sums of clusters the same for differences that are not
independent of each other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_RESAMPLES = 4000


def sign_flip_p_value(weights: npt.ArrayLike, observed: int) -> float:
    """Return the two-sided exact p-value of a sum of weights under signs as likely + as -.

    ``p = P(|sum_i s_i w_i| >= |observed|)``, s_i independent and +1 or -1 with probability 1/2. The
    distribution is built one weight after the other: each moves it up and down by half.

    Parameters
    ----------
    weights
        Shape (N,), whole numbers of 0 or more.
    observed
        The sum as observed.
    """
    whole = np.asarray(weights, dtype=np.int64)
    whole = whole[whole > 0]
    # probabilities[k]: the weights with sign + add up to k; then the sum is 2 k - total.
    total = int(whole.sum())
    probabilities = np.zeros(total + 1)
    probabilities[0] = 1.0
    reached = 0
    for weight in whole:
        reached += int(weight)
        moved = probabilities[: reached + 1 - weight].copy()
        probabilities[: reached + 1] *= 0.5
        probabilities[weight : reached + 1] += 0.5 * moved
    sums = 2 * np.arange(total + 1) - total
    return float(min(1.0, probabilities[np.abs(sums) >= abs(observed)].sum()))


def mcnemar(wins: int, losses: int) -> float:
    """Return the p-value of McNemar's exact test: wins and losses as likely (McNemar 1947).

    Parameters
    ----------
    wins, losses
        Pairs in which only the one succeeded, and only the other.
    """
    return sign_flip_p_value(np.ones(wins + losses), wins - losses)


def wilcoxon(differences: npt.ArrayLike) -> float:
    """Return the p-value of Wilcoxon's signed-rank test, exact with ties (Wilcoxon 1945).

    Parameters
    ----------
    differences
        Shape (N,); zeros are left out, as he did.
    """
    doubled, signs = _doubled_ranks(differences)
    return sign_flip_p_value(doubled, int(doubled @ signs))


def rank_biserial(differences: npt.ArrayLike) -> float:
    """Return the matched-pairs rank-biserial correlation, from -1 to 1 (Kerby 2014).

    The share of the ranks that is positive less the share that is negative; 0 where all
    differences are.

    Parameters
    ----------
    differences
        Shape (N,).
    """
    doubled, signs = _doubled_ranks(differences)
    return float(doubled @ signs / doubled.sum()) if len(doubled) else 0.0


def clustered(sums: npt.ArrayLike) -> float:
    """Return the p-value of differences that come in clusters, whose signs flip together.

    What is summed in a cluster decides which test it is: the signs of differences make it McNemar's
    (or the sign test), their `signed_ranks` Wilcoxon's, each for clusters of one.

    Parameters
    ----------
    sums
        Shape (C,): the sum of each cluster, in whole numbers.
    """
    whole = np.asarray(sums, dtype=np.int64)
    return sign_flip_p_value(np.abs(whole), int(whole.sum()))


def signed_ranks(differences: npt.ArrayLike) -> IntArray:
    """Return twice the rank of each difference's size, with its sign; 0 for no difference.

    Parameters
    ----------
    differences
        Shape (N,).
    """
    values = np.asarray(differences, dtype=np.float64)
    ranks = np.zeros(len(values), dtype=np.int64)
    doubled, signs = _doubled_ranks(values)
    ranks[values != 0.0] = doubled * signs
    return ranks


def cluster_sums(values: npt.ArrayLike, clusters: npt.ArrayLike) -> FloatArray:
    """Return the sum of the values of each cluster, shape (C,).

    Parameters
    ----------
    values
        Shape (N,).
    clusters
        Shape (N,): which cluster each is of, from 0 to C - 1.
    """
    weights = np.asarray(values, dtype=np.float64)
    return np.bincount(np.asarray(clusters), weights=weights).astype(np.float64)


def bootstrap_interval(
    values: npt.ArrayLike, clusters: npt.ArrayLike, *, rng: np.random.Generator
) -> tuple[float, float]:
    """Return the 95 % interval of a mean, for values that come in clusters.

    Draws as many clusters as there are, each whole, again and again (percentile interval of the
    cluster bootstrap: Efron 1979; Field and Welsh 2007).

    Parameters
    ----------
    values
        Shape (N,).
    clusters
        Shape (N,): which cluster each is of, from 0 to C - 1.
    """
    sums = cluster_sums(values, clusters)
    counts = cluster_sums(np.ones(np.shape(values)), clusters)
    drawn = rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), size=_RESAMPLES)
    low, high = np.quantile((drawn @ sums) / (drawn @ counts), [0.025, 0.975])
    return float(low), float(high)


def holm(p_values: npt.ArrayLike) -> FloatArray:
    """Return p-values adjusted for being a family, by Holm's step-down method (Holm 1979).

    The k-th smallest of m is multiplied by m - k + 1, and is no smaller than those before it: to
    refuse all hypotheses at or below alpha errs once or more with probability alpha at the most.

    Parameters
    ----------
    p_values
        Shape (M,).
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


def _doubled_ranks(differences: npt.ArrayLike) -> tuple[IntArray, IntArray]:
    """Return twice the mid-ranks of what is not zero, which are whole numbers, and the signs."""
    values = np.asarray(differences, dtype=np.float64)
    values = values[values != 0.0]
    ranks = rankdata(np.abs(values)) if len(values) else np.empty(0)
    return np.rint(2.0 * ranks).astype(np.int64), np.sign(values).astype(np.int64)
