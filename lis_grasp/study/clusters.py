"""Which trials of a study belong together, and the intervals that follow from it.

Trials of one object and seed share their first touches: they are a cluster. Two questions are asked
of a mean over trials. What would other seeds give, on these objects? And what would objects like
these give?
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.json_lines import Row
from lis_grasp.study.statistics import bootstrap_interval

IntArray = npt.NDArray[np.int64]
Interval = tuple[float, float] | tuple[None, None]

LEAST_CLUSTERS = 10
"""Of a bootstrap interval: all resamples of fewer are too few to have tails of 2.5 %."""

LEAST_SEEDS = 3
"""Of each object, to draw its seeds among themselves: two tell little of their spread."""


def clusters_of(rows: Sequence[Row]) -> IntArray:
    """Return which object and seed each row is of, as numbers from 0, shape (N,)."""
    return _numbered([(row["object"], row["seed"]) for row in rows])


def objects_of(rows: Sequence[Row]) -> IntArray:
    """Return which object each row is of, as numbers from 0, shape (N,)."""
    return _numbered([row["object"] for row in rows])


def interval_over_seeds(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean, had other seeds been drawn for these objects.

    Seeds are drawn object by object. Where an object has fewer than `LEAST_SEEDS`, or none whose
    seeds differ, clusters are drawn regardless of their object: then what sets objects apart counts
    as chance too, and the interval is rather too wide.

    Parameters
    ----------
    rows
        Of the values, N.
    values
        Shape (N,).

    Returns
    -------
    low, high
        None for fewer than `LEAST_CLUSTERS`, and where nothing differs that is drawn: no spread
        that was seen is not a spread of nothing.
    """
    clusters, objects = clusters_of(rows), objects_of(rows)
    seeds = [len(set(clusters[objects == each])) for each in set(objects)]
    if min(seeds, default=0) >= LEAST_SEEDS:
        found = _interval(values, clusters, objects)
        if found[0] is not None:
            return found
    return _interval(values, clusters)


def interval_over_objects(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean, had other objects like these been drawn.

    Objects are drawn with all their trials. Parameters and result are as `interval_over_seeds`'.
    """
    return _interval(values, objects_of(rows))


def _interval(
    values: npt.ArrayLike, clusters: IntArray, strata: IntArray | None = None
) -> Interval:
    if len(set(clusters)) < LEAST_CLUSTERS:
        return None, None
    low, high = bootstrap_interval(values, clusters, strata, rng=np.random.default_rng(0))
    return (None, None) if np.isclose(low, high, rtol=1e-9, atol=0.0) else (low, high)


def _numbered(keys: Sequence[Any]) -> IntArray:
    places: dict[Any, int] = {}
    return np.array([places.setdefault(key, len(places)) for key in keys], dtype=np.int64)
