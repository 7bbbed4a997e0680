"""What rows of trials say together: means over objects and seeds, and how sure they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray

_RESAMPLES = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """One measure of one experiment: estimators by objects by seeds.

    Parameters
    ----------
    estimators, objects, seeds
        What the axes stand for.
    values
        Shape (estimators, objects, seeds); NaN where the measure does not exist (objects without
        edges have no edge error), where an estimator failed, or where no trial was run.
    """

    estimators: tuple[str, ...]
    objects: tuple[str, ...]
    seeds: tuple[int, ...]
    values: FloatArray

    def of(self, estimator: str) -> FloatArray:
        """Return the values of one estimator, shape (objects, seeds)."""
        return np.asarray(self.values[self.estimators.index(estimator)])

    def per_object(self, estimator: str) -> FloatArray:
        """Return its mean over seeds, shape (objects,); NaN where there is none."""
        return _mean(self.of(estimator), axis=1)

    def overall(self, estimator: str) -> float:
        """Return the mean over objects of its means over seeds."""
        return float(_mean(self.per_object(estimator), axis=0))

    def reduction(self, estimator: str, reference: str) -> tuple[float, float, float]:
        """Return by what share the mean is below another estimator's, with its 95 % interval.

        Paired: only trials that both came through count, and the bootstrap draws seeds, the same
        for both estimators and all objects (percentile interval, Efron 1979).
        """
        mine, theirs, resampled = self._paired(estimator, reference)
        low, high = np.quantile(1.0 - resampled[0] / resampled[1], [0.025, 0.975])
        return float(1.0 - mine / theirs), float(low), float(high)

    def difference(self, estimator: str, reference: str) -> tuple[float, float, float]:
        """Return how far the mean is above another estimator's, with its 95 % interval.

        Paired and resampled as in `reduction`.
        """
        mine, theirs, resampled = self._paired(estimator, reference)
        low, high = np.quantile(resampled[0] - resampled[1], [0.025, 0.975])
        return float(mine - theirs), float(low), float(high)

    def _paired(self, estimator: str, reference: str) -> tuple[float, float, FloatArray]:
        """Return the means of two over the trials that both have, and resampled, (2, resamples)."""
        both = np.stack([self.of(estimator), self.of(reference)])  # (2, objects, seeds)
        both[:, np.isnan(both).any(axis=0)] = np.nan
        rng = np.random.default_rng(0)
        drawn = rng.integers(len(self.seeds), size=(_RESAMPLES, len(self.seeds)))
        resampled = _mean(_mean(both[:, :, drawn], axis=3), axis=1)  # (2, resamples)
        mine, theirs = _mean(_mean(both, axis=2), axis=1)
        return float(mine), float(theirs), resampled


def tabulate(rows: Sequence[Row], experiment: str, measure: str) -> Table:
    """Return one measure of one experiment as a table, in the order of the rows' names."""
    chosen = [row for row in rows if row["experiment"] == experiment]
    estimators = tuple(dict.fromkeys(row["estimator"] for row in chosen))
    objects = tuple(sorted({row["object"] for row in chosen}))
    seeds = tuple(sorted({row["seed"] for row in chosen}))
    values = np.full((len(estimators), len(objects), len(seeds)), np.nan)
    for row in chosen:
        value = row.get(measure)
        if value is not None:
            place = (row["estimator"], row["object"], row["seed"])
            index = tuple(
                names.index(name)
                for names, name in zip((estimators, objects, seeds), place, strict=True)
            )
            values[index] = value
    return Table(estimators, objects, seeds, values)


def _mean(values: FloatArray, axis: int) -> FloatArray:
    """Return the mean of what is not NaN; NaN where nothing is."""
    known = ~np.isnan(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
