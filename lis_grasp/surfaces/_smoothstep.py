"""Smooth steps between two values, with their derivatives."""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray


def smoothstep(values: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Return 3 t^2 - 2 t^3, which rises from 0 at `low` to 1 at `high`, and its derivative."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / (high - low)


def agreement(differences: FloatArray, near: float, far: float) -> tuple[FloatArray, FloatArray]:
    """Return what falls from 1 to 0 from a difference of `near` to `far`, and its derivative."""
    rises, slopes = smoothstep(np.abs(differences), near, far)
    return 1.0 - rises, -slopes * np.sign(differences)
