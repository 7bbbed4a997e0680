"""Noise of depth cameras: a model in disparity, what it says of a depth, and its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy import ndimage

from lis_grasp.exceptions import require_at_least, require_positive
from lis_grasp.records import Record
from lis_grasp.typing import BoolArray, FloatArray

_Depths = TypeVar("_Depths", float, FloatArray)

# A step in depth between neighbouring pixels that is a border of what is seen [m].
_STEP = 0.012


@dataclass(frozen=True, slots=True)
class DepthNoise(Record):
    """Noise of a stereo camera, whose depth is ``focal_baseline / disparity``.

    The standard deviation of a depth z is a z^2: errors of the disparity are alike everywhere in an
    image. They have two parts. One is correlated over `length` pixels, so that a plane fitted to
    many pixels averages it out; the other over `smooth_length` pixels, so that nothing does.

    Parameters
    ----------
    disparity
        Standard deviation of the first part [px].
    length
        Standard deviation of the Gaussian that correlates it [px].
    smooth_disparity
        Standard deviation of the second part [px].
    smooth_length
        Standard deviation of the Gaussian that correlates it [px].
    step
        Quantum of disparities [px]; 0 for none.
    focal_baseline
        Focal length times baseline [px m].
    mixed
        Fraction of the pixels at borders whose depth is between both sides; half of the others are
        holes.

    Raises `InvalidOptionError` if a number is out of range.

    Examples
    --------
    The default is near to a RealSense D435 of 640 x 480 pixels.

    >>> noise = DepthNoise()
    >>> round(1e3 * noise.deviation(0.5), 2), DepthNoise.none().deviation(0.5)
    (1.16, 0.0)
    """

    disparity: float = 0.08
    length: float = 1.0
    smooth_disparity: float = 0.04
    smooth_length: float = 12.0
    step: float = 1.0 / 32.0
    focal_baseline: float = 385.0 * 0.05
    mixed: float = 0.5

    def __post_init__(self) -> None:
        require_at_least(
            0.0,
            disparity=self.disparity,
            smooth_disparity=self.smooth_disparity,
            step=self.step,
            mixed=self.mixed,
        )
        require_positive(
            length=self.length,
            smooth_length=self.smooth_length,
            focal_baseline=self.focal_baseline,
        )

    @classmethod
    def none(cls) -> DepthNoise:
        """Return the noise of an exact camera, as of a simulator's image."""
        return cls(disparity=0.0, smooth_disparity=0.0, step=0.0, mixed=0.0)

    @property
    def rough(self) -> float:
        """Standard deviation of the inverse depth by the first part and the quantum [1/m]."""
        return float(np.hypot(self.disparity, self.step / np.sqrt(12.0))) / self.focal_baseline

    @property
    def smooth(self) -> float:
        """Standard deviation of the inverse depth by the second part [1/m]."""
        return self.smooth_disparity / self.focal_baseline

    @property
    def correlated_pixels(self) -> float:
        """Number of pixels with a common error of the first part: its correlations' sum."""
        return max(4.0 * np.pi * self.length**2, 1.0)

    def deviation(self, depths: _Depths) -> _Depths:
        """Return the standard deviation of depths [m], of the same shape [m]."""
        return float(np.hypot(self.rough, self.smooth)) * depths**2

    def measured(self, depth: FloatArray, focal: float, *, rng: np.random.Generator) -> FloatArray:
        """Return a true depth image (H, W) [m] with noise; NaN where the camera has no depth.

        The noise is larger on oblique surfaces, and most surfaces beyond 79 degrees have none.
        """
        if self == self.none():
            return depth
        border, near, step = _borders(depth)
        known = np.where(np.isfinite(depth), depth, np.nan)
        slope = np.hypot(*np.gradient(np.nan_to_num(known, nan=1e3)))
        slope *= focal / np.nan_to_num(known, nan=1e3)
        wide = (1.0 + np.minimum(slope, 5.0) ** 2) ** 0.25
        wide[border] = 1.0
        disparity = self.focal_baseline / known
        disparity += self.disparity * wide * correlated(depth.shape, self.length, rng=rng)
        disparity += self.smooth_disparity * correlated(depth.shape, self.smooth_length, rng=rng)
        if self.step:
            disparity = np.round(disparity / self.step) * self.step
        z = self.focal_baseline / disparity
        mixed = border & (rng.random(depth.shape) < self.mixed)
        z[mixed] = near[mixed] + rng.random(np.count_nonzero(mixed)) * step[mixed]
        lost = border & ~mixed & (rng.random(depth.shape) < 0.5)
        lost |= (slope > 5.0) & (rng.random(depth.shape) < 0.7) & ~border
        lost |= rng.random(depth.shape) < 0.002
        z[lost] = np.nan
        return np.where(np.isinf(depth) & ~lost & ~mixed, np.inf, z)


def _borders(depth: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which pixels are at steps in depth, the nearest depth about each, and the step."""
    near = ndimage.minimum_filter(depth, 3)
    far = ndimage.maximum_filter(np.where(np.isfinite(depth), depth, 0.0), 3)
    step = np.where(np.isfinite(near), far - np.where(np.isfinite(near), near, 0.0), 0.0)
    return step > _STEP, near, step


def correlated(shape: tuple[int, ...], length: float, *, rng: np.random.Generator) -> FloatArray:
    """Return Gaussian noise of unit variance, white noise smoothed by a Gaussian of `length` px."""
    rows = np.asarray(ndimage.gaussian_filter(rng.standard_normal(shape), length, mode="wrap"))
    kernel = np.zeros(shape)
    kernel[0, 0] = 1.0
    kernel = ndimage.gaussian_filter(kernel, length, mode="wrap")
    return np.asarray(rows / np.linalg.norm(kernel))
