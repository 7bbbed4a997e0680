"""Success rates, paired permutation tests, effect sizes and bootstrap intervals of trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import block_array, coo_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import binomtest, norm, rankdata
from scipy.stats import t as student

from lis_grasp.exceptions import needed_package
from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray, IntArray

Interval = tuple[float, float] | tuple[None, None]

LEAST_CLUSTERS = 10
"""Clusters that a bootstrap interval needs: fewer have too few resamples for tails of 2.5 %."""

LEAST_SEEDS = 4
"""Seeds that an interval over whole seeds needs, with one hand; with each further hand one more."""

# Fraction of the pairs of seed and level that must be there for an interval over seeds.
_COMPLETE = 0.9

_RESAMPLES = 4000

# Summands of a sum of ranks whose exact distribution takes two seconds.
_MOST_EXACT = 1000


def sign_flip_p_value(sums: npt.ArrayLike) -> float:
    """Return the exact two-sided p-value of a sum under random sign flips (Fisher 1935).

    ``p = P(|sum_i s_i |c_i|| >= |sum_i c_i|)``, s_i independent and +1 or -1 with probability 1/2.
    Above 1000 summands the sum is taken as normal, with the variance ``sum_i c_i^2``.

    With the signs of pairs' differences this is McNemar's test (1947), with `signed_ranks`
    Wilcoxon's (1945). Where pairs are not independent, pass the sum of either over each cluster:
    then all pairs of a cluster flip together.

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
    largest = 0
    for weight in weights:
        largest += int(weight)
        moved = probabilities[: largest + 1 - weight].copy()
        probabilities[: largest + 1] *= 0.5
        probabilities[weight : largest + 1] += 0.5 * moved
    flipped = 2 * np.arange(total + 1) - total
    return float(min(1.0, probabilities[np.abs(flipped) >= abs(whole.sum())].sum()))


def equivalence_p_value(
    values: npt.ArrayLike, margin: float, *, largest: float | None = 1.0
) -> float:
    """Return the p-value of two one-sided t-tests that a mean is within a margin of 0.

    The larger of both (Schuirmann 1987); 1 with fewer than two values. Below 0.05 it is where the
    90 % interval of the mean is inside of the margin. Equal values have no variance, but say little
    of rare ones: for them it is the chance that N values show none of the differences of `largest`
    that would make a mean of `margin`.

    Parameters
    ----------
    values
        Shape (N,), independent.
    margin
        Above 0, in the unit of the values.
    largest
        Difference that is rare but possible, above `margin`; None if there is none.
    """
    known = np.asarray(values, dtype=np.float64)
    count = len(known)
    if count < 2:
        return 1.0
    room = margin - abs(float(np.mean(known)))
    error = float(np.std(known, ddof=1)) / np.sqrt(count)
    if error > 0.0:
        return float(student.sf(room / error, count - 1))
    rare = 0.0 if largest is None else float((1.0 - margin / largest) ** count)
    return rare if room > 0.0 else 1.0


def detectable_difference(values: npt.ArrayLike) -> float | None:
    """Return the mean that a t-test at 5 % finds with a power of 80 % in values of such a spread.

    ``(t_0.975 + t_0.8) s / sqrt(N)`` with N - 1 degrees of freedom, in the unit of the values
    (Cohen 1988), of values (N,). None with fewer than two.
    """
    known = np.asarray(values, dtype=np.float64)
    count = len(known)
    if count < 2:
        return None
    error = float(np.std(known, ddof=1)) / np.sqrt(count)
    return float(student.ppf([0.975, 0.8], count - 1).sum() * error)


def rank_biserial(differences: npt.ArrayLike) -> float:
    """Return the matched-pairs rank-biserial correlation of differences (N,) (Kerby 2014).

    The fraction of the rank sum that is positive minus the fraction that is negative, from -1 to 1;
    0 if all differences are 0.
    """
    ranks = signed_ranks(differences)
    return float(ranks.sum() / np.abs(ranks).sum()) if ranks.any() else 0.0


def signed_ranks(differences: npt.ArrayLike) -> IntArray:
    """Return twice the signed rank of each difference (N,), a whole number; 0 for no difference."""
    values = np.asarray(differences, dtype=np.float64)
    ranks = np.zeros(len(values), dtype=np.int64)
    differs = values != 0.0
    if differs.any():
        doubled = np.rint(2.0 * rankdata(np.abs(values[differs])))
        ranks[differs] = (doubled * np.sign(values[differs])).astype(np.int64)
    return ranks


def cluster_sums(values: npt.ArrayLike, clusters: npt.ArrayLike) -> FloatArray:
    """Return the sum of the values (N,) of each cluster, shape (C,); clusters (N,) from 0."""
    weights = np.asarray(values, dtype=np.float64)
    return np.bincount(np.asarray(clusters), weights=weights).astype(np.float64)


def clustered_p_value(values: npt.ArrayLike, clusters: npt.ArrayLike) -> float:
    """Return `sign_flip_p_value` of values (N,) where all of a cluster (N,) flip together."""
    return sign_flip_p_value(cluster_sums(values, clusters))


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % score interval of a success rate, from 0 to 1 (Wilson 1927)."""
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def rate_with_interval(successes: int, trials: int) -> str:
    """Return a success rate as text, with its score interval in percent."""
    low, high = wilson_interval(successes, trials)
    return f"{successes} of {trials} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"


def holm(p_values: Sequence[float]) -> FloatArray:
    """Return p-values adjusted for a family by Holm's step-down method (Holm 1979)."""
    with needed_package("statsmodels", "study"):
        from statsmodels.stats.multitest import multipletests
    if not len(p_values):
        return np.empty(0)
    return np.asarray(multipletests(p_values, method="holm")[1])


def bootstrap_interval(
    values: npt.ArrayLike, clusters: npt.ArrayLike, *, rng: np.random.Generator
) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of a mean of clustered values.

    Draws whole clusters, one fewer than there are, which corrects the variance for few clusters
    (McCarthy and Snowden 1985; Field and Welsh 2007). Takes the percentiles of Student's
    distribution in place of 2.5 and 97.5 (Hesterberg 2015).

    Parameters
    ----------
    values
        Shape (N,).
    clusters
        Shape (N,): index of the cluster of each value, from 0 to C - 1.
    """
    sums = cluster_sums(values, clusters)
    counts = cluster_sums(np.ones(np.shape(values)), clusters)
    size = len(sums)
    drawn = rng.multinomial(size - 1, np.full(size, 1.0 / size), size=_RESAMPLES)
    ends = norm.cdf(student.ppf([0.025, 0.975], size - 1))
    low, high = np.quantile((drawn @ sums) / (drawn @ counts), ends)
    return float(low), float(high)


def crossed_interval(values: npt.ArrayLike, drawn: npt.ArrayLike, fixed: npt.ArrayLike) -> Interval:
    """Return the 95 % Student interval of a mean over random draws, crossed with a fixed factor.

    Each draw (a seed) meets each level of the fixed factor (a hand and an object) of its stratum;
    draws that share a level are one stratum. The mean of its level is subtracted from each value,
    so neither levels nor strata count as differences between draws. The variance of draws is
    pooled over strata.

    Parameters
    ----------
    values
        Shape (N,).
    drawn
        Shape (N,): index of the draw of each value, from 0 to D - 1.
    fixed
        Shape (N,): index of the level of each value, from 0 to K - 1.

    Returns
    -------
    low, high
        None if draws less strata are fewer than `LEAST_SEEDS` - 1, or if more than a tenth of the
        pairs of draw and level are missing: then level means are too uncertain.
    """
    known = np.asarray(values, dtype=np.float64)
    draws, levels = np.asarray(drawn), np.asarray(fixed)
    met = coo_array((np.ones(len(known)), (draws, levels))).tocsr()
    count, strata = connected_components(block_array([[None, met], [met.T, None]]), directed=False)
    of_draws, of_levels = np.split(strata, [met.shape[0]])
    pairs = np.bincount(of_draws, minlength=count) @ np.bincount(of_levels, minlength=count)
    degrees = len(of_draws) - count
    if degrees < LEAST_SEEDS - 1 or met.nnz < _COMPLETE * pairs:
        return None, None
    sizes = np.bincount(draws)
    centred = known - (cluster_sums(known, levels) / np.bincount(levels))[levels]
    means = cluster_sums(centred, draws) / sizes
    variance = float(means @ means) / degrees
    half = student.ppf(0.975, degrees) * np.sqrt(variance * float(sizes @ sizes)) / len(known)
    return float(known.mean() - half), float(known.mean() + half)


def numbered(keys: Sequence[Any]) -> IntArray:
    """Return the index of each key, in the order of first occurrence, shape (N,)."""
    places: dict[Any, int] = {}
    return np.array([places.setdefault(key, len(places)) for key in keys], dtype=np.int64)


def clusters_of(rows: Sequence[Row]) -> IntArray:
    """Return the cluster of each row, shape (N,): one for each object and seed."""
    return numbered([(row["object"], row["seed"]) for row in rows])


def objects_of(rows: Sequence[Row]) -> IntArray:
    """Return the index of each row's object, shape (N,)."""
    return numbered([row["object"] for row in rows])


def interval_over_seeds(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean for other seeds on the same objects, with the same hands.

    Whole seeds are the units, because a seed gives all objects the same random numbers; their
    variance is pooled over the hands (`crossed_interval`). Where this needs more seeds, or more of
    each seed, or seeds do not differ, clusters of object and seed are drawn instead. The values
    have shape (N,), one for each row.

    Returns
    -------
    low, high
        None with too few units, or if no value differs between units.
    """
    seeds = numbered([row["seed"] for row in rows])
    cells = numbered([(row.get("hand"), row["object"]) for row in rows])
    found = _if_wide(crossed_interval(values, seeds, cells))
    return _of_clusters(values, clusters_of(rows)) if found[0] is None else found


def interval_over_objects(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean for other objects like these, each with all its trials."""
    return _of_clusters(values, objects_of(rows))


@dataclass(frozen=True, slots=True)
class SuccessRate:
    """A success rate with its 95 % interval from 0 to 1; None with too few clusters."""

    held: int
    trials: int
    clusters: int
    """Number of clusters of trials, see `clusters_of`."""
    low: float | None
    high: float | None

    @property
    def value(self) -> float:
        """The rate, from 0 to 1."""
        return self.held / self.trials


def success_rate(rows: Sequence[Row]) -> SuccessRate | None:
    """Return the fraction of rows with ``held``; None for no rows.

    The interval is `interval_over_seeds`. If all trials have the same result, it is Wilson's
    (1927), with the number of clusters as the number of trials.
    """
    if not rows:
        return None
    held = np.array([bool(row["held"]) for row in rows])
    clusters, total = len(set(clusters_of(rows))), int(held.sum())
    low, high = interval_over_seeds(rows, held)
    if low is not None and high is not None:
        low, high = max(low, 0.0), min(high, 1.0)
    if clusters >= LEAST_CLUSTERS and total in (0, len(rows)):
        low, high = wilson_interval(clusters if total else 0, clusters)
    return SuccessRate(total, len(rows), clusters, low, high)


@dataclass(frozen=True, slots=True, eq=False)
class MeasureTable:
    """One measure: estimators by objects by seeds."""

    estimators: tuple[str, ...]
    objects: tuple[str, ...]
    seeds: tuple[int, ...]
    values: FloatArray
    """Shape (estimators, objects, seeds); NaN where a value is missing."""

    def of(self, estimator: str) -> FloatArray:
        """Return the values of one estimator, shape (objects, seeds)."""
        return np.asarray(self.values[self.estimators.index(estimator)])

    def only(self, name: str) -> MeasureTable:
        """Return the table of one object."""
        k = self.objects.index(name)
        return MeasureTable(self.estimators, (name,), self.seeds, self.values[:, k : k + 1])

    def per_object(self, estimator: str) -> FloatArray:
        """Return the means over seeds, shape (objects,); NaN where there is no value."""
        return _mean(self.of(estimator), axis=1)

    def overall(self, estimator: str) -> float:
        """Return the mean over objects of the means over seeds."""
        return float(_mean(self.per_object(estimator), axis=0))

    def reduction(self, estimator: str, reference: str) -> tuple[float, Interval]:
        """Return the relative reduction of the mean below the reference, and its 95 % interval.

        Paired: only trials with a value of both count. The interval is Student's for the logarithm
        of the ratio of means, over seeds, which are the same for both estimators and all objects;
        the variance of the logarithm is that of its linearisation. With fewer than `LEAST_SEEDS`
        seeds, or a mean of 0, there is no interval.
        """
        both = np.stack([self.of(estimator), self.of(reference)])  # (2, objects, seeds)
        both[:, np.isnan(both).any(axis=0)] = np.nan
        of_objects = _mean(both, axis=2)
        means = _mean(of_objects, axis=1)
        ratio, count = float(means[0] / means[1]), len(self.seeds)
        if count < LEAST_SEEDS or not ratio > 0.0:
            return 1.0 - ratio, (None, None)
        relative = (both - of_objects[:, :, None]) / means[:, None, None]
        known = ~np.isnan(both[0])
        weights = known / np.maximum(known.sum(axis=1, keepdims=True), 1) / known.any(axis=1).sum()
        deviations = np.sum(weights * np.where(known, relative[0] - relative[1], 0.0), axis=0)
        error = np.sqrt(count / (count - 1) * np.sum(deviations**2))
        half = student.ppf(0.975, count - 1) * error
        return 1.0 - ratio, (1.0 - ratio * np.exp(half), 1.0 - ratio * np.exp(-half))


def measure_table(rows: Sequence[Row], measure: str) -> MeasureTable:
    """Return one measure of rows as a table, estimators in the order of the rows."""
    estimators = tuple(dict.fromkeys(row["estimator"] for row in rows))
    objects = tuple(sorted({row["object"] for row in rows}))
    seeds = tuple(sorted({row["seed"] for row in rows}))
    found = {(row["estimator"], row["object"], row["seed"]): row.get(measure) for row in rows}
    cells = [found.get(cell) for cell in product(estimators, objects, seeds)]
    values = np.array(cells, dtype=np.float64)  # None becomes NaN
    values = values.reshape(len(estimators), len(objects), len(seeds))
    return MeasureTable(estimators, objects, seeds, values)


def _mean(values: FloatArray, axis: int) -> FloatArray:
    """Return the mean of the values that are not NaN; NaN if all are."""
    return np.asarray(np.ma.filled(np.ma.masked_invalid(values).mean(axis=axis), np.nan))


def _of_clusters(values: npt.ArrayLike, clusters: IntArray) -> Interval:
    if len(set(clusters)) < LEAST_CLUSTERS:
        return None, None
    return _if_wide(bootstrap_interval(values, clusters, rng=np.random.default_rng(0)))


def _if_wide(interval: Interval) -> Interval:
    low, high = interval
    if low is None or high is None or np.isclose(low, high, rtol=1e-9, atol=1e-12):
        return None, None
    return low, high
