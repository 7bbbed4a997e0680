"""Z-buffer of triangles: the nearest one at every pixel centre, without a display."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.typing import FloatArray, IndexArray

# Fragments that are in memory at once.
_MOST_FRAGMENTS = 1_000_000


def nearest_triangles(triangles: FloatArray, pixels: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Return the triangle that each pixel shows, shape (rows, columns); -1 where there is none.

    `triangles` (F, 3, 3) have column, row and depth [pixels]; larger depth is nearer to the eye. A
    pixel belongs to the triangles that cover its centre, each pixel at a common edge to one of
    them. Of equal depths the last triangle wins.
    """
    columns, rows = pixels
    depth = np.full(rows * columns, -np.inf, dtype=np.float32)
    nearest = np.full(rows * columns, -1, dtype=np.int32)
    owner, row, first, count = _spans(triangles, columns, rows)
    a, b, c = screen_planes(triangles, triangles[:, :, 2:])[owner, :, 0].T
    at_start = (a * (first + 0.5) + b * (row + 0.5) + c).astype(np.float32)
    slope, start = a.astype(np.float32), (row * columns + first).astype(np.int32)
    chunks = np.searchsorted(np.cumsum(count), np.arange(0, count.sum(), _MOST_FRAGMENTS)[1:])
    for part in np.split(np.arange(len(count), dtype=np.int32), chunks):
        many = count[part]
        span = np.repeat(part, many)
        step = np.arange(len(span), dtype=np.int32) - np.repeat(np.cumsum(many) - many, many)
        z = at_start[span] + slope[span] * step.astype(np.float32)
        pixel = start[span] + step
        np.maximum.at(depth, pixel, z)
        wins = z == depth[pixel]
        nearest[pixel[wins]] = owner[span[wins]]
    return nearest.reshape(rows, columns)


def _spans(
    triangles: FloatArray, columns: int, rows: int
) -> tuple[IndexArray, IndexArray, IndexArray, npt.NDArray[np.int32]]:
    """Return triangle, row, first column and number of columns of all horizontal spans, (S,)."""
    sorted_rows = np.argsort(triangles[:, :, 1], axis=1)
    points = np.take_along_axis(triangles, sorted_rows[:, :, None], axis=1)
    low = np.clip(np.ceil(points[:, 0, 1] - 0.5), 0, rows).astype(np.int64)
    high = np.clip(np.ceil(points[:, 2, 1] - 0.5), 0, rows).astype(np.int64)
    many = np.maximum(high - low, 0)
    owner = np.repeat(np.arange(len(triangles)), many)
    row = low[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(many) - many, many)
    top, middle, bottom = points[owner].transpose(1, 0, 2)
    y = row + 0.5
    upper = (y < middle[:, 1])[:, None]
    ends = np.stack(
        [
            _crossing(top, bottom, y),
            _crossing(np.where(upper, top, middle), np.where(upper, middle, bottom), y),
        ]
    )
    first = np.clip(np.ceil(ends.min(axis=0) - 0.5), 0, columns).astype(np.int64)
    last = np.clip(np.ceil(ends.max(axis=0) - 0.5), 0, columns).astype(np.int64)
    return owner, row, first, np.maximum(last - first, 0).astype(np.int32)


def _crossing(a: FloatArray, b: FloatArray, y: FloatArray) -> FloatArray:
    """Return the column at which each edge from a to b, (S, 3), crosses a row's middle y (S,)."""
    height = b[:, 1] - a[:, 1]
    fraction = np.divide(y - a[:, 1], height, out=np.zeros_like(y), where=height > 0.0)
    return np.asarray(a[:, 0] + fraction * (b[:, 0] - a[:, 0]))


def screen_planes(triangles: FloatArray, values: FloatArray) -> FloatArray:
    """Return a, b, c of a x + b y + c for values (F, 3, K) at the corners of triangles (F, 3, 3).

    The shape is (F, 3, K), with a, b, c along the middle axis. Edge-on triangles are constant.
    """
    xy, first = triangles[:, 1:, :2] - triangles[:, :1, :2], values[:, 0]
    p, q = values[:, 1] - first, values[:, 2] - first
    area = (xy[:, 0, 0] * xy[:, 1, 1] - xy[:, 0, 1] * xy[:, 1, 0])[:, None]
    a = p * xy[:, 1, 1, None] - q * xy[:, 0, 1, None]
    b = q * xy[:, 0, 0, None] - p * xy[:, 1, 0, None]
    a, b = (np.divide(t, area, out=np.zeros_like(t), where=area != 0.0) for t in (a, b))
    c = first - a * triangles[:, 0, 0, None] - b * triangles[:, 0, 1, None]
    return np.stack([a, b, c], axis=1)
