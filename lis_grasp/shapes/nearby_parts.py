"""Groups of parts whose bounding boxes overlap, by a sweep along the longest axis."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from lis_grasp.typing import FloatArray, IntArray


def overlapping_groups(low: FloatArray, high: FloatArray) -> list[IntArray]:
    """Return groups of boxes that overlap, directly or through others; each box is in one group.

    `low` and `high`, shapes (B, 3), are the boxes' corners; boxes that touch overlap. The time
    grows with the boxes that overlap along the axis of the largest extent, not with all pairs.
    """
    axis = int(np.argmax(high.max(axis=0) - low.min(axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    low, high = low[order], high[order]
    last = np.searchsorted(low[:, axis], high[:, axis], side="right")
    first, second = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for i, end in enumerate(last):
        ahead = slice(i + 1, int(end))
        meet = np.all((low[ahead] <= high[i]) & (high[ahead] >= low[i]), axis=1)
        others = i + 1 + np.flatnonzero(meet)
        first.append(np.full(len(others), i))
        second.append(others)
    rows, columns = np.concatenate(first), np.concatenate(second)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(low), len(low)))
    count, labels = connected_components(graph, directed=False)
    return rows_by_label(count, labels[np.argsort(order)])


def rows_by_label(count: int, labels: IntArray) -> list[IntArray]:
    """Return the rows of each label from 0 to `count` - 1, in order."""
    if not count:
        return []
    rows = np.argsort(labels, kind="stable")
    return np.split(rows, np.cumsum(np.bincount(labels, minlength=count))[:-1])
