"""Robust local surfaces of a depth image: what normals and places of its pixels come from.

The inverse depth of a plane is linear in the image, and the noise of a stereo camera is alike in
it everywhere. So a quadratic is fitted to the inverse depths of a window about each pixel, with a
prior that favours planes. Near an edge the window shows two faces. Then the face counts that
explains most of the window and the pixel itself: the planes of neighbouring pixels are candidates,
as in a Kuwahara filter (1976), and other pixels lose their weight (Geman and McClure's function).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Samples of a window on each side of its pixel; half its width at least and at most [px].
_HALF, _NARROWEST, _WIDEST = 4, 1.4, 12.0
# Noise of normals that the width of windows aims at [rad].
_NORMAL_NOISE = 0.03
# A surface needs this weight of samples.
_FEWEST = 6.0
# Deviations at which a sample has a quarter of its weight, and beyond which a candidate is refused.
_SCALE, _REFUSED = 2.0, 2.5
# Departure of a window from a quadratic, of its inverse depth: it is never exactly one.
_LEAST = 2e-4
# Prior of curvatures [1/m].
_CURVATURE = 100.0
# Candidates: directions, and distances in half windows.
_DIRECTIONS, _DISTANCES = 8, (0.5, 1.0)
# Rounds of weights: for first planes, and for the final surface.
_ROUNDS, _FINAL_ROUNDS = 3, 3


@dataclass(frozen=True, slots=True, eq=False)
class LocalPlanes:
    """Tangent planes of N pixels: value + slope . (columns, rows from the pixel) is 1 / z."""

    values: FloatArray  # (N,) [1/m] at the pixel
    slopes: FloatArray  # (N, 2) [1/m/px]
    covariances: FloatArray  # (N, 3, 3) of values and slopes by noise that is correlated nearby
    residuals: FloatArray  # (N,) [1/m] of the pixel itself from its plane
    found: BoolArray  # (N,) whether there are enough samples


@dataclass(frozen=True, slots=True)
class ImageNoise:
    """Noise of inverse depths, of which windows need to know."""

    deviation: float  # [1/m] of a pixel
    correlated_pixels: float  # with a common error
    focal: float  # [px]


def fit_local_planes(
    inverse: FloatArray, rows: IndexArray, columns: IndexArray, noise: ImageNoise
) -> LocalPlanes:
    """Fit a surface about each pixel to inverse depths (H, W) [1/m], NaN where unknown.

    `rows` and `columns` (N,) are the pixels, at least one.
    """
    own = inverse[rows, columns]
    depth = 1.0 / float(np.median(own))
    half = window_half(noise, depth)
    step = max(round(half / _HALF), 1)
    dv, du = (step * d.ravel() for d in np.mgrid[-_HALF : _HALF + 1, -_HALF : _HALF + 1])
    padded = np.pad(inverse, step * _HALF, constant_values=np.nan)
    samples = padded[rows[:, None] + step * _HALF + dv, columns[:, None] + step * _HALF + du]
    known = np.isfinite(samples)
    samples = np.where(known, samples, 0.0)  # (N, K)
    distance = (du**2 + dv**2) / half**2
    near, wide = known * np.exp(-3.0 * distance), known * np.exp(-0.75 * distance)
    curved = np.column_stack([np.ones(len(du)), du, dv, 0.5 * du**2, du * dv, 0.5 * dv**2])
    flat = curved[:, :3]
    scale = np.hypot(_SCALE * noise.deviation, _LEAST * own)[:, None]
    planes, weights = np.zeros((len(rows), 3)), near
    planes[:, 0] = own
    for _ in range(_ROUNDS):
        planes, _ = _solve(weights, samples, flat, np.zeros(3))
        weights = near * _trust(samples - planes @ flat.T, scale)
    window = _Windows(rows, columns, own, samples, wide, flat, scale)
    surfaces = np.pad(window.explained(planes, half), ((0, 0), (0, 3)))
    alike = max(noise.correlated_pixels / step**2, 1.0)
    variance = alike * max(noise.deviation, 1e-9) ** 2  # of independent samples
    ridge = np.repeat([0.0, variance / (_CURVATURE / noise.focal**2) ** 2], 3)
    for _ in range(_FINAL_ROUNDS):
        weights = wide * _trust(samples - surfaces @ curved.T, scale)
        surfaces, normal = _solve(weights, samples, curved, ridge)
    return LocalPlanes(
        surfaces[:, 0],
        surfaces[:, 1:3],
        np.asarray(variance * np.linalg.inv(normal)[:, :3, :3], dtype=np.float64),
        own - surfaces[:, 0],
        weights.sum(axis=1) >= _FEWEST,
    )


def window_half(noise: ImageNoise, depth: float) -> float:
    """Return half the width of windows [px] in which normals have the noise that is aimed at."""
    slope = noise.deviation * np.sqrt(noise.correlated_pixels) * noise.focal * depth
    return float(np.clip(np.sqrt(np.sqrt(0.75) * slope / _NORMAL_NOISE), _NARROWEST, _WIDEST))


def _solve(
    weights: FloatArray, heights: FloatArray, basis: FloatArray, ridge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weighted least squares (N, C), and their normal matrices (N, C, C)."""
    count = basis.shape[1]
    products = (basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    normal = (weights @ products).reshape(-1, count, count)
    normal += np.diag(ridge + 1e-9)
    right = (weights * heights) @ basis
    found = np.linalg.solve(normal, right[..., None])[..., 0]
    return np.asarray(found, dtype=np.float64), normal


def _trust(residuals: FloatArray, scale: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + (residuals / scale) ** 2) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """Windows of N pixels with K samples."""

    rows: IndexArray  # (N,)
    columns: IndexArray  # (N,)
    own: FloatArray  # (N,) [1/m] of the pixel
    samples: FloatArray  # (N, K) [1/m]
    weights: FloatArray  # (N, K)
    basis: FloatArray  # (K, 3)
    scale: FloatArray  # (N, 1) [1/m]

    def explained(self, planes: FloatArray, half: float) -> FloatArray:
        """Return for each pixel its plane or a neighbour's (N, 3): which explains most samples."""
        shape = self.rows.max() + 1, self.columns.max() + 1
        index = np.full(shape, -1, dtype=np.intp)
        index[self.rows, self.columns] = np.arange(len(self.rows))
        stride = _stride(self.rows)
        best, most = planes.copy(), self._explained(planes, np.arange(len(planes)))
        for distance, direction in product(_DISTANCES, range(_DIRECTIONS)):
            angle = 2.0 * np.pi * direction / _DIRECTIONS
            away = distance * half / stride * np.array([np.sin(angle), np.cos(angle)])
            down, right = (stride * np.round(away)).astype(np.intp)
            v, u = self.rows + down, self.columns + right
            inside = (v >= 0) & (v < shape[0]) & (u >= 0) & (u < shape[1])
            other = np.where(inside, index[np.where(inside, v, 0), np.where(inside, u, 0)], -1)
            here = np.flatnonzero(other >= 0)
            moved = planes[other[here]]
            moved[:, 0] -= moved[:, 1:] @ [right, down]
            ok = np.abs(moved[:, 0] - self.own[here]) < _REFUSED / _SCALE * self.scale[here, 0]
            here, moved = here[ok], moved[ok]
            explained = self._explained(moved, here)
            better = explained > most[here]
            best[here[better]], most[here[better]] = moved[better], explained[better]
        return best

    def _explained(self, planes: FloatArray, here: IndexArray) -> FloatArray:
        residuals = self.samples[here] - planes @ self.basis.T
        return np.asarray((self.weights[here] * _trust(residuals, self.scale[here])).sum(axis=1))


def _stride(rows: IndexArray) -> int:
    """Return the distance between the rows of pixels."""
    different = np.unique(rows)
    return int(np.diff(different).min()) if len(different) > 1 else 1
