"""Z-buffer renderer: shaded pictures of meshes in an orthographic view, without a display.

Triangles become fragments, one for each pixel centre that they cover; the nearest fragment of a
pixel is shown. Surfaces may intersect, and need not be closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.visualization._drawing import shade
from lis_grasp.visualization.camera import LIGHT, View
from lis_grasp.visualization.colours import srgb

# What is left of a colour that faces away from the light.
_DARKEST = 0.45
# Samples of a pixel in each direction, whose mean is its colour.
_SAMPLES = 2
# Fragments that are in memory at once.
_MOST_FRAGMENTS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A mesh in O [m] and its sRGB colour: ``#rrggbb``, or of each vertex in [0, 1], (V, 3)."""

    mesh: trimesh.Trimesh
    colour: str | FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Part of a view that a picture shows: its middle (2,) and its width [m], and its pixels."""

    view: View
    middle: FloatArray
    width: float
    pixels: tuple[int, int]  # columns, rows

    @property
    def pixel(self) -> float:
        """Width and height of a pixel [m]."""
        return self.width / self.pixels[0]

    def place(self, points: npt.ArrayLike) -> FloatArray:
        """Return column, row and depth towards the eye of points in O, (..., 3), in pixels."""
        places, depths = self.view.project(points)
        flat = (places - self.middle) * [1.0, -1.0] / self.pixel
        return np.concatenate(
            [flat + 0.5 * np.array(self.pixels), depths[..., None] / self.pixel], axis=-1
        )

    def finer(self, samples: int) -> Window:
        """Return the same part of the view with `samples` times as many columns and rows."""
        columns, rows = self.pixels
        return Window(self.view, self.middle, self.width, (samples * columns, samples * rows))


def render(solids: Sequence[Solid], window: Window) -> npt.NDArray[np.uint8]:
    """Return a picture of solids as RGBA, (rows, columns, 4), transparent where there are none.

    Colours are shaded at the corners of triangles, and linear between them (Gouraud, 1971).
    """
    fine = window.finer(_SAMPLES)
    corners = [_shaded_corners(solid, fine) for solid in solids]
    triangles = np.concatenate([np.empty((0, 3, 3)), *(places for places, _ in corners)])
    colours = np.concatenate([np.empty((0, 3, 3)), *(colours for _, colours in corners)])
    nearest = nearest_triangles(triangles, fine.pixels)
    planes = np.zeros((len(triangles) + 1, 3, 3), dtype=np.float32)  # the last for no triangle
    planes[:-1] = _planes(triangles, colours)
    columns, rows = (np.arange(length, dtype=np.float32) + 0.5 for length in fine.pixels)
    picture = np.empty((*nearest.shape, 4), dtype=np.float32)
    for channel in range(3):
        a, b, c = planes[:, :, channel].T.copy()
        shown = a[nearest] * columns + b[nearest] * rows[:, None] + c[nearest]
        picture[..., channel] = shown.clip(0.0, 1.0)
    picture[..., 3] = nearest >= 0
    return _averaged(picture)


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
    a, b, c = _planes(triangles, triangles[:, :, 2:])[owner, :, 0].T
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


def _planes(triangles: FloatArray, values: FloatArray) -> FloatArray:
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


def _shaded_corners(solid: Solid, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return the corners of triangles as `Window.place` does, and their colours, each (F, 3, 3)."""
    vertices, faces, normals, source = shade(solid.mesh)
    colours = (
        np.broadcast_to(srgb(solid.colour), (len(vertices), 3))
        if isinstance(solid.colour, str)
        else np.asarray(solid.colour, dtype=np.float64)[source]
    )
    lit = colours * _brightness(normals, window.view)[:, None]
    return window.place(vertices)[faces], lit[faces]


def _brightness(normals: FloatArray, view: View) -> FloatArray:
    """Return the brightness (N,) of surfaces with unit normals (N, 3), seen from either side."""
    seen = normals @ view.axes.T
    seen *= np.where(seen[:, 2:] < 0.0, -1.0, 1.0)
    return np.asarray(_DARKEST + (1.0 - _DARKEST) * (0.5 + 0.5 * seen @ LIGHT))


def _averaged(picture: FloatArray) -> npt.NDArray[np.uint8]:
    """Return the mean colour over each pixel's samples, weighted by their opacity, as bytes."""
    total = np.zeros_like(picture[::_SAMPLES, ::_SAMPLES])
    for i, j in np.ndindex(_SAMPLES, _SAMPLES):
        total += picture[i::_SAMPLES, j::_SAMPLES]
    opaque = total[..., 3:]
    total[..., :3] /= np.maximum(opaque, 1.0)
    total[..., 3:] /= _SAMPLES**2
    return np.round(255.0 * total).astype(np.uint8)
