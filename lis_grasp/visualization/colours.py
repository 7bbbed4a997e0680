"""Colour map (viridis) and colour scale with round ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.typing import FloatArray

# Viridis (Nathaniel Smith and Stefan van der Walt, 2015, CC0) at 17 steps: errors below 6/255.
VIRIDIS = (
    "#440154", "#48186a", "#472d7b", "#424086", "#3b528b", "#33638d", "#2c728e", "#26828e",
    "#21918c", "#1fa088", "#28ae80", "#3fbc73", "#5ec962", "#84d44b", "#addc30", "#d8e219",
    "#fde725",
)  # fmt: skip

# Upper end of the scale, as a fraction of the object's size.
_SHOWN_SIZE = 0.025
# Quantile at the upper end of the scale: large values must not compress the rest into one colour.
_SHOWN_FRACTION = 0.8


def srgb(colour: str) -> FloatArray:
    """Return a ``#rrggbb`` colour as three sRGB values in [0, 1], shape (3,)."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def linear_rgb(colours: npt.ArrayLike) -> FloatArray:
    """Return sRGB values in [0, 1], any shape, as linear light (IEC 61966-2-1)."""
    c = np.asarray(colours, dtype=np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0.0) + 0.055) / 1.055) ** 2.4)


def viridis(values: npt.ArrayLike) -> FloatArray:
    """Return the sRGB colours (N, 3) of `values` (N,), which are clipped to [0, 1]."""
    stops = np.array([srgb(c) for c in VIRIDIS])  # (17, 3)
    where = np.linspace(0.0, 1.0, len(stops))
    x = np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0)
    return np.stack([np.interp(x, where, stops[:, k]) for k in range(3)], axis=-1)


@dataclass(frozen=True, slots=True)
class ColourScale:
    """Colour scale of lengths: viridis from `low` to `high` [m], ``low < high``, clipped there."""

    low: float
    high: float
    clipped: bool = False  # whether some values are above `high`

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise InvalidOptionError.out_of_range("high", self.high, f"above low, {self.low}")

    @classmethod
    def of(cls, values: npt.ArrayLike) -> ColourScale:
        """Return the scale from zero to the first round number above 80 % of `values` (N,) [m].

        Infinite values mean unknown, and take the colour of the upper end.
        """
        all_values = np.asarray(values, dtype=np.float64)
        finite = all_values[np.isfinite(all_values)]
        if not len(finite) or finite.max() <= 0.0:
            return cls(0.0, 1e-3, clipped=bool(len(finite) < all_values.size))
        high = round_up(float(np.quantile(finite, _SHOWN_FRACTION)) or float(finite.max()))
        return cls(0.0, high, clipped=bool(np.any(~(all_values <= high * (1.0 + 1e-9)))))

    @classmethod
    def of_object(cls, size: float, values: npt.ArrayLike) -> ColourScale:
        """Return the scale of every estimate of an object of `size` [m]: the same in all runs.

        Its upper end is the first round number above 2.5 % of the size; `values` (N,) [m] only
        say whether some are above it.
        """
        high = round_up(_SHOWN_SIZE * size)
        all_values = np.asarray(values, dtype=np.float64)
        return cls(0.0, high, clipped=bool(np.any(~(all_values <= high * (1.0 + 1e-9)))))

    def colours(self, values: npt.ArrayLike) -> FloatArray:
        """Return the sRGB colours, shape (N, 3), of `values` [m], shape (N,)."""
        x = (np.asarray(values, dtype=np.float64) - self.low) / (self.high - self.low)
        return viridis(np.nan_to_num(x, nan=1.0, posinf=1.0, neginf=0.0))

    def tick_labels(self) -> Sequence[str]:
        """Return five evenly spaced labels in millimetres, the last one with its unit."""
        labels = [f"{v:.3g}" for v in np.linspace(self.low, self.high, 5) * 1e3]
        labels[-1] = ("≥ " if self.clipped else "") + labels[-1] + " mm"
        return labels


def round_up(value: float) -> float:
    """Return the smallest of 1, 2, 3, 4, 6, 8 times 10^k that is >= `value` > 0."""
    rounds = 10.0 ** np.floor(np.log10(value)) * np.array([1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0])
    return float(rounds[rounds >= value * (1.0 - 1e-9)][0])  # whose quarters have few digits
