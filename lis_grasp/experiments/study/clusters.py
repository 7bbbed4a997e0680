"""Which trials of a study belong together, and the intervals that follow from it.

Two questions are asked of a mean over trials. What would other seeds give, on these objects? And
what would objects like these give?
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.experiments.statistics import bootstrap_interval, crossed_interval
from lis_grasp.io.json_lines import Row
from lis_grasp.typing import IntArray

Interval = tuple[float, float] | tuple[None, None]

LEAST_CLUSTERS = 10
"""Of a bootstrap interval: all resamples of fewer are too few to have tails of 2.5 %."""

LEAST_SEEDS = 4
"""To be drawn as wholes: fewer say too little of how far they spread."""


def clusters_of(rows: Sequence[Row]) -> IntArray:
    """Return which object and seed each row is of, as numbers from 0, shape (N,).

    Such trials share their first touches.
    """
    return _numbered([(row["object"], row["seed"]) for row in rows])


def objects_of(rows: Sequence[Row]) -> IntArray:
    """Return which object each row is of, as numbers from 0, shape (N,)."""
    return _numbered([row["object"] for row in rows])


def interval_over_seeds(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean, had other seeds been drawn for these objects.

    Seeds are taken as wholes, because all objects of one share its random numbers: where touches
    begin, how grasps are drawn. Of fewer than `LEAST_SEEDS`, or where they do not differ, objects
    and seeds are drawn in pairs: then what sets objects apart counts as chance, and what objects of
    a seed share does not.

    Parameters
    ----------
    rows
        Of the values, N.
    values
        Shape (N,).

    Returns
    -------
    low, high
        None for fewer than `LEAST_SEEDS` seeds and `LEAST_CLUSTERS` pairs, and where nothing
        differs that is drawn: no spread that was seen is not a spread of nothing.
    """
    seeds = _numbered([row["seed"] for row in rows])
    if len(set(seeds)) >= LEAST_SEEDS:
        found = _if_wide(crossed_interval(values, seeds, objects_of(rows)))
        if found[0] is not None:
            return found
    return _of_clusters(values, clusters_of(rows))


def interval_over_objects(rows: Sequence[Row], values: npt.ArrayLike) -> Interval:
    """Return the 95 % interval of a mean, had other objects like these been drawn.

    Objects are drawn with all their trials. Parameters and result are as `interval_over_seeds`'.
    """
    return _of_clusters(values, objects_of(rows))


def _of_clusters(values: npt.ArrayLike, clusters: IntArray) -> Interval:
    if len(set(clusters)) < LEAST_CLUSTERS:
        return None, None
    return _if_wide(bootstrap_interval(values, clusters, rng=np.random.default_rng(0)))


def _if_wide(interval: tuple[float, float]) -> Interval:
    return (None, None) if np.isclose(*interval, rtol=1e-9, atol=1e-12) else interval


def _numbered(keys: Sequence[Any]) -> IntArray:
    places: dict[Any, int] = {}
    return np.array([places.setdefault(key, len(places)) for key in keys], dtype=np.int64)
