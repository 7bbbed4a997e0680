"""What weighs the parts of an estimate: cross-validation errors, and smooth steps."""

from __future__ import annotations

import numpy as np

from lis_grasp.surfaces.contact_places import ContactPlaces
from lis_grasp.typing import FloatArray

# Weight of a normal's error of 1, and the error that is as good as none, in spacings.
_NORMAL_ERROR = 0.25
_ERROR_FLOOR = 0.02


def log_errors(
    predicted: tuple[FloatArray, FloatArray], normals: FloatArray, places: ContactPlaces
) -> FloatArray:
    """Return the mean logarithm of the errors of contacts in distance and normal, at each place.

    `predicted` are f (N,) [m] and its gradient (N, 3) at contacts of normals (N, 3), from others.
    """
    values, gradients = predicted
    slopes = np.linalg.norm(gradients, axis=1)
    distances = np.abs(values) / np.maximum(slopes, 0.3) / places.spacing
    units = gradients / np.maximum(slopes, 1e-9)[:, None]
    tilts = np.linalg.norm(units - normals, axis=1)
    logs = np.log(np.minimum(distances, 1.0) + _NORMAL_ERROR * tilts + _ERROR_FLOOR)
    return np.asarray(np.bincount(places.place, logs) / np.bincount(places.place))


def smoothstep(values: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Return 3 t^2 - 2 t^3, which rises from 0 at `low` to 1 at `high`, and its derivative."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / (high - low)


def agreement(differences: FloatArray, near: float, far: float) -> tuple[FloatArray, FloatArray]:
    """Return what falls from 1 to 0 from a difference of `near` to `far`, and its derivative."""
    rises, slopes = smoothstep(np.abs(differences), near, far)
    return 1.0 - rises, -slopes * np.sign(differences)
