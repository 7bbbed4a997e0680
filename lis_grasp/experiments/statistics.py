"""Paired tests, effect sizes and intervals, free of distributions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.stats import norm, rankdata
from scipy.stats import t as student

from lis_grasp.typing import FloatArray, IntArray

_RESAMPLES = 4000

# Summands of a sum of ranks whose distribution takes two seconds.
_MOST_EXACT = 1000


def sign_flip_p_value(sums: npt.ArrayLike) -> float:
    """Return the exact two-sided p-value of a total, under signs as likely + as - (Fisher 1935).

    ``p = P(|sum_i s_i |c_i|| >= |sum_i c_i|)``, s_i independent and +1 or -1 with probability 1/2.
    The distribution is built one summand after the other: each moves it up and down by half. Of
    more than 1000 summands it is taken as normal, with the variance ``sum_i c_i^2``.

    What a summand is decides which test it is. The sign of a pair's difference makes it McNemar's
    (1947), `signed_ranks` Wilcoxon's (1945). Where pairs are not independent, it is the sum of
    either over a cluster, whose pairs then flip together.

    Parameters
    ----------
    sums
        Shape (C,), whole numbers.
    """
    whole = np.rint(np.asarray(sums, dtype=np.float64)).astype(np.int64)
    weights = np.abs(whole[whole != 0])
    if len(weights) > _MOST_EXACT:
        deviation = np.sqrt(np.sum(weights.astype(np.float64) ** 2))
        return float(2.0 * norm.sf(abs(int(whole.sum())) / deviation))
    # probabilities[k]: the weights with sign + add up to k; then the sum is 2 k - total.
    total = int(weights.sum())
    probabilities = np.zeros(total + 1)
    probabilities[0] = 1.0
    reached = 0
    for weight in weights:
        reached += int(weight)
        moved = probabilities[: reached + 1 - weight].copy()
        probabilities[: reached + 1] *= 0.5
        probabilities[weight : reached + 1] += 0.5 * moved
    flipped = 2 * np.arange(total + 1) - total
    return float(min(1.0, probabilities[np.abs(flipped) >= abs(whole.sum())].sum()))


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

    Draws clusters, each whole, again and again, one less than there are, which makes the variance
    right where they are few (McCarthy and Snowden 1985; Field and Welsh 2007), and takes the
    percentiles that Student's law has in place of 2.5 and 97.5 (Hesterberg 2015).

    Parameters
    ----------
    values
        Shape (N,).
    clusters
        Shape (N,): which cluster each is of, from 0 to C - 1.
    """
    sums = cluster_sums(values, clusters)
    counts = cluster_sums(np.ones(np.shape(values)), clusters)
    size = len(sums)
    drawn = rng.multinomial(size - 1, np.full(size, 1.0 / size), size=_RESAMPLES)
    ends = norm.cdf(student.ppf([0.025, 0.975], size - 1))
    low, high = np.quantile((drawn @ sums) / (drawn @ counts), ends)
    return float(low), float(high)


def crossed_interval(
    values: npt.ArrayLike, drawn: npt.ArrayLike, kept: npt.ArrayLike
) -> tuple[float, float]:
    """Return the 95 % interval of a mean over draws, each of which all that is kept has met.

    Student's (1908), of the means of the draws; what is kept may differ as it likes, and may have
    the luck of a draw in common. Values are taken less the mean of what is kept, so that it does
    not matter much if some are missing.

    Parameters
    ----------
    values
        Shape (N,).
    drawn
        Shape (N,): which draw each is of, from 0 to D - 1; 2 draws at least.
    kept
        Shape (N,): of what each is, from 0 to K - 1.
    """
    known, groups = np.asarray(values, dtype=np.float64), np.asarray(kept)
    ones = np.ones(len(known))
    centres = cluster_sums(known, groups) / cluster_sums(ones, groups)
    means = cluster_sums(known - centres[groups], drawn) / cluster_sums(ones, drawn)
    half = student.ppf(0.975, len(means) - 1) * means.std(ddof=1) / np.sqrt(len(means))
    return float(known.mean() - half), float(known.mean() + half)


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
