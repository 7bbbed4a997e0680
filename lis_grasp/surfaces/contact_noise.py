"""Standard deviations of each contact's position and normal, as an estimator uses them."""

from __future__ import annotations

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.queries import require_range
from lis_grasp.typing import FloatArray, IndexArray

# Least noise in a weight, relative to the largest: an exact measurement has no finite weight.
_LEAST_NOISE = 1e-6


def noise_of(
    contacts: Contacts,
    position_noise: float | None,
    normal_noise: float | None,
    *,
    default: tuple[float, float] = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Return the noise of each contact: its own, else what is given, else the default.

    `position_noise` [m] and `normal_noise` [rad] are those of contacts whose own are unknown; None
    takes `default`. Returns two arrays of shape (N,) [m] and [rad]. Raises `InvalidOptionError` if
    an option is outside its range.
    """
    given = (position_noise, normal_noise)
    for name, unit, value in zip(
        ("position_noise", "normal_noise"), ("m", "rad"), given, strict=True
    ):
        if value is not None:
            require_range(name, value, unit=unit)
    position, normal = (
        default_value if value is None else value
        for value, default_value in zip(given, default, strict=True)
    )
    count = len(contacts)
    return (
        filled(contacts.position_noise, position, count),
        filled(contacts.normal_noise, normal, count),
    )


def precisions_of(noise: FloatArray | None, count: int) -> FloatArray:
    """Return relative weights of measurements, 1 / variance, shape (N,); 1 for the noisiest.

    `noise` (N,) are standard deviations, or None where all are unknown. An unknown one, NaN, counts
    as their root mean square; an exact one, 0, as a millionth of the largest.
    """
    if noise is None:
        return np.ones(count)
    known = mean_where_unknown(noise)
    largest = known.max()
    if largest == 0.0:
        return np.ones(count)
    return np.asarray(1.0 / np.maximum(known / largest, _LEAST_NOISE) ** 2)


def mean_where_unknown(noise: FloatArray) -> FloatArray:
    """Return noise (N,), where it is unknown the root mean square of what is known."""
    return np.where(np.isnan(noise), np.sqrt(np.nanmean(noise**2)), noise)


def noise_of_means(noise: FloatArray | None, group: IndexArray) -> FloatArray | None:
    """Return the noise of inverse-variance weighted means, (sum of 1 / variance)^(-1/2).

    `noise` (N,) are standard deviations of independent measurements or None, `group` (N,) their
    groups, numbered from 0. NaN for a group whose noise is all unknown.
    """
    if noise is None:
        return None
    known = ~np.isnan(noise)
    with np.errstate(divide="ignore"):
        precisions = 1.0 / noise[known] ** 2  # infinite for an exact measurement
        total = np.bincount(group[known], precisions, minlength=int(group.max()) + 1)
        means = 1.0 / np.sqrt(total)
    return np.where(np.isin(np.arange(len(total)), group[known]), means, np.nan)


def filled(own: FloatArray | None, value: float, count: int) -> FloatArray:
    """Return noise (N,) of so many contacts: their own, a value where it is unknown."""
    return np.full(count, value) if own is None else np.where(np.isnan(own), value, own)
