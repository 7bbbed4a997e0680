"""Robust local planes of a depth image: what normals and places of its pixels come from.

The inverse depth of a plane is linear in the image, and the noise of a stereo camera is alike in
it everywhere. So the planes are fitted to inverse depths in windows of pixels, by least squares
that are weighted anew in each round (Geman and McClure's function).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Windows of pixels, half their width; rounds of weights.
_HALF, _ROUNDS = 4, 4
# A plane needs this many pixels.
_FEWEST = 8
# Least noise of inverse depths that weights assume, of the inverse depth: no division by 0.
_LEAST_NOISE = 1e-6
# Deviations at which a neighbour has a quarter of its weight.
_SCALE = 2.0
# Pixels in memory at once.
_MOST_PIXELS = 8192


@dataclass(frozen=True, slots=True, eq=False)
class LocalPlanes:
    """Planes of N pixels: inverse depth = values + slopes . (columns, rows from the pixel)."""

    values: FloatArray  # (N,) [1/m] at the pixel
    slopes: FloatArray  # (N, 2) [1/m/px]
    spreads: FloatArray  # (N, 3, 3): inverse of the weighted normal equations
    residuals: FloatArray  # (N,) [1/m] of the pixel itself from its plane
    found: BoolArray  # (N,) whether there are enough pixels


def fit_local_planes(
    inverse: FloatArray, rows: IndexArray, columns: IndexArray, deviation: float
) -> LocalPlanes:
    """Fit a plane about each pixel to the inverse depths (H, W) [1/m], NaN where unknown.

    `rows` and `columns` (N,) are the pixels; `deviation` [1/m] is the standard deviation of a
    pixel's inverse depth.
    """
    padded = np.pad(inverse, _HALF, constant_values=np.nan)
    dv, du = (d.ravel() for d in np.mgrid[-_HALF : _HALF + 1, -_HALF : _HALF + 1])
    basis = np.column_stack([np.ones(len(du)), du, dv]).astype(np.float64)  # (K, 3)
    near = np.exp(-0.5 * (du**2 + dv**2) / (0.6 * _HALF) ** 2)
    parts = [
        _fit(padded[v[:, None] + _HALF + dv, u[:, None] + _HALF + du], basis, near, deviation)
        for v, u in zip(_chunks(rows), _chunks(columns), strict=True)
    ]
    return LocalPlanes(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _chunks(array: IndexArray) -> list[IndexArray]:
    return np.array_split(array, max(-(-len(array) // _MOST_PIXELS), 1))


def _fit(
    window: FloatArray, basis: FloatArray, near: FloatArray, deviation: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return the fields of `LocalPlanes` for windows (N, K) of inverse depths."""
    known = np.isfinite(window)
    middle = window[:, len(near) // 2]  # of the pixel itself
    heights = np.where(known, window - middle[:, None], 0.0)
    scale = _SCALE * np.maximum(deviation, _LEAST_NOISE * middle)[:, None]
    products = (basis[:, :, None] * basis[:, None, :]).reshape(-1, 9)
    weights = known * near
    ridge = 1e-9 * np.eye(3)
    for _ in range(_ROUNDS):
        normal: FloatArray = (weights @ products).reshape(-1, 3, 3) + ridge
        right = (weights * heights) @ basis
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        left = heights - plane @ basis.T
        weights = known * near / (1.0 + (left / scale) ** 2) ** 2
    spreads = np.linalg.inv((weights @ products).reshape(-1, 3, 3) + ridge)
    enough = np.count_nonzero(weights > 0.05, axis=1) >= _FEWEST
    values = np.asarray(middle + plane[:, 0], dtype=np.float64)
    slopes = np.asarray(plane[:, 1:], dtype=np.float64)
    return (
        values,
        slopes,
        np.asarray(spreads, dtype=np.float64),
        middle - values,
        np.asarray(enough),
    )
