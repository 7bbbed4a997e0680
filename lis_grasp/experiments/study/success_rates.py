"""How many grasps held: shares of trials, with intervals that know which trials belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from lis_grasp.experiments.study.clusters import LEAST_CLUSTERS, clusters_of, interval_over_seeds
from lis_grasp.io.json_lines import Row


@dataclass(frozen=True, slots=True)
class Share:
    """A share of trials that held.

    Parameters
    ----------
    held, trials
        How many of how many.
    clusters
        Of trials: those of one object and seed, which share their first touches.
    low, high
        Its 95 % interval, from 0 to 1; None where there are too few clusters.
    """

    held: int
    trials: int
    clusters: int
    low: float | None
    high: float | None

    @property
    def value(self) -> float:
        """The share, from 0 to 1."""
        return self.held / self.trials


def share_of(rows: Sequence[Row]) -> Share | None:
    """Return the share of rows that held; None of no rows.

    The interval is that of other seeds on the same objects, see `interval_over_seeds`. Where all
    trials came out the same, there is nothing to draw from: then it is Wilson's (1927), of as many
    trials as clusters.
    """
    if not rows:
        return None
    held = np.array([bool(row["held"]) for row in rows])
    clusters, total = len(set(clusters_of(rows))), int(held.sum())
    low, high = interval_over_seeds(rows, held)
    if low is not None and high is not None:
        low, high = max(low, 0.0), min(high, 1.0)
    if clusters >= LEAST_CLUSTERS and total in (0, len(rows)):
        wilson = binomtest(clusters if total else 0, clusters).proportion_ci(method="wilson")
        low, high = float(wilson.low), float(wilson.high)
    return Share(total, len(rows), clusters, low, high)
