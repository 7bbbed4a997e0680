"""Z-buffer renderer: shaded pictures of meshes in an orthographic view, without a display.

Triangles become fragments, one for each pixel centre that they cover; the nearest fragment of a
pixel is shown. Surfaces may intersect, and need not be closed.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.shapes.fragments import nearest_triangles, screen_planes
from lis_grasp.typing import FloatArray
from lis_grasp.visualization._drawing import shade
from lis_grasp.visualization.camera import LIGHT, View
from lis_grasp.visualization.colours import srgb

# What is left of a colour that faces away from the light.
_DARKEST = 0.45
# Samples of a pixel in each direction, whose mean is its colour.
_SAMPLES = 2


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
    planes[:-1] = screen_planes(triangles, colours)
    columns, rows = (np.arange(length, dtype=np.float32) + 0.5 for length in fine.pixels)
    picture = np.empty((*nearest.shape, 4), dtype=np.float32)
    for channel in range(3):
        a, b, c = planes[:, :, channel].T.copy()
        shown = a[nearest] * columns + b[nearest] * rows[:, None] + c[nearest]
        picture[..., channel] = shown.clip(0.0, 1.0)
    picture[..., 3] = nearest >= 0
    return _averaged(picture)


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


def encode_png(picture: npt.NDArray[np.uint8]) -> bytes:
    """Return a picture (rows, columns, 3) as PNG."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG")
    return stream.getvalue()
