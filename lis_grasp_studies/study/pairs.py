"""Difference of success rates between an estimator and the reference, over pairs of trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.io.json_lines import Row
from lis_grasp.typing import FloatArray
from lis_grasp_studies.harness.statistics import interval_over_objects, interval_over_seeds
from lis_grasp_studies.harness.tables import NONE
from lis_grasp_studies.study.cells import effect_text

Pairs = Sequence[tuple[Row, Row]]
"""Rows of an estimator, each with the reference's row of the same trial; see `pairs_of`."""


def gains(pairs: Pairs) -> FloatArray:
    """Return for each pair 1 where only the estimator held, -1 where only the reference did."""
    return np.array([float(row["held"]) - float(other["held"]) for row, other in pairs])


def rows_of(pairs: Pairs) -> list[Row]:
    """Return the estimator's rows."""
    return [row for row, _ in pairs]


def difference(pairs: Pairs, *, over_objects: bool = False) -> str:
    """Return the difference of success rates in points, with its interval over seeds or objects."""
    if not pairs:
        return NONE
    interval = interval_over_objects if over_objects else interval_over_seeds
    return effect_text("held", float(gains(pairs).mean()), *interval(rows_of(pairs), gains(pairs)))
