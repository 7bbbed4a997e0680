"""Exposure of a hand in a search: how likely an unknown object meets another link first."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray

# Radius and height of upright cylinders that stand for the unknown object [m].
_OBJECTS = np.array([[0.03, 0.06], [0.05, 0.1], [0.05, 0.2]])
SPACING = 0.01
"""Spacing of their places across the motion [m]."""
_TIE = 1e-6  # Less makes no difference [m]: rounding differs between processors.


def exposed_width(
    inner: FloatArray, tips: FloatArray, direction: FloatArray, height: float
) -> float:
    """Return the mean width of a level motion on which objects meet an inner link first [m].

    The objects are upright cylinders of three sizes on a table at a `height` [m]. The points
    `inner` (P, 3) are on links that are not to touch, `tips` (T, 3) on fingertips, where the motion
    along a `direction` (3,), level and unit, begins [m].
    """
    if not len(inner):  # a suction cup is a fingertip only
        return 0.0
    across = np.array([-direction[1], direction[0]])
    places = inner[:, :2] @ across
    count = int((np.ptp(places) + 0.1 + _TIE) / SPACING) + 1
    centers = places.min() - 0.05 + SPACING * np.arange(count)  # (C,)
    widths = []
    for radius, top in _OBJECTS:
        first, of_tips = (
            _reached(points[points[:, 2] < height + top - _TIE], direction, across, centers, radius)
            for points in (inner, tips)
        )
        widths.append(SPACING * np.count_nonzero(first > of_tips + _TIE))
    return float(np.mean(widths))


def _reached(
    points: FloatArray,
    direction: FloatArray,
    across: FloatArray,
    centers: FloatArray,
    radius: float,
) -> FloatArray:
    """Return how far ahead cylinders at places (C,) across are touched by points (P, 3), (C,) [m].

    It is -inf for cylinders that no point meets.
    """
    beside = np.abs(points[:, :2] @ across - centers[:, None])  # (C, P)
    bulge = np.sqrt(np.maximum(radius**2 - beside**2, 0.0))
    ahead = np.where(beside < radius - _TIE, points @ direction + bulge, -np.inf)
    return np.asarray(ahead.max(axis=1, initial=-np.inf))
