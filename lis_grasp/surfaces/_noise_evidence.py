"""Marginal likelihood of a smooth surface with less noise than contacts' neighbours suggest."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces._gaussian_process_regression import (
    ROWS,
    GradientRegression,
    factorize,
    gradient_covariance,
    log_likelihood,
)
from lis_grasp.surfaces._kernels import Matern52
from lis_grasp.typing import FloatArray

# Length of the kernel in largest distances between two contacts, as of `gpis`, and the noise that
# conditions the equations, in the scaled coordinates of a process.
_LENGTH = 0.8
_CONDITIONING = (3e-4, 1e-2)

# Fractions of the noise that are tried, and of the prior's amplitude without noise.
_FRACTIONS = (0.5, 0.25, 0.0)
_AMPLITUDES = (1.0, 0.7, 0.45)

# Less noise needs a Bayes factor of exp(15): edges are no smooth surface, and noise is common.
_LOG_BAYES_FACTOR = 15.0

# With more contacts their neighbours resolve the shape, and the equations take too long.
_MOST_CONTACTS = 100


def least_noise(contacts: Contacts, noise: tuple[float, float]) -> tuple[float, float]:
    """Return the noise, or the fraction of it that a smooth surface supports much better.

    Compares marginal likelihoods of a Gaussian process with values and gradients (Rasmussen and
    Williams 2006, eq. 5.8, at the best of some amplitudes) with all, half, a quarter and none of
    the noise in positions [m] and normals [rad]. A smooth shape that contacts resolve only together
    has no noise, although neighbours alone do not explain each other. More than 100 contacts are
    not compared.
    """
    if not 2 <= len(contacts) <= _MOST_CONTACTS:
        return noise
    scale = float(pdist(contacts.points).max())
    nodes = (contacts.points - contacts.bounds.mean(axis=0)) / scale
    targets = np.column_stack([np.full(len(nodes), -1.0), contacts.normals])
    kernel, conditioning = Matern52(_LENGTH), _variances(*_CONDITIONING, len(nodes))
    matrix = gradient_covariance(kernel, nodes) + np.diag(conditioning)
    variances = _variances(noise[0] / scale, noise[1], len(nodes))

    def evidence(part: FloatArray) -> float:
        factors = (factorize(a**2 * matrix, part) for a in amplitude * np.array(_AMPLITUDES))
        return max(log_likelihood(factor, targets.ravel()) for factor in factors)

    process = GradientRegression.fit(kernel, nodes, targets, conditioning.reshape(-1, ROWS))
    amplitude = process.likeliest_amplitude()
    best, chosen = evidence(variances) + _LOG_BAYES_FACTOR, 1.0
    for fraction in _FRACTIONS:
        value = evidence(fraction**2 * variances)
        if value > best:
            best, chosen = value, fraction
    return chosen * noise[0], chosen * noise[1]


def _variances(value: float, slope: float, count: int) -> FloatArray:
    return np.tile(np.array([value, *[slope] * (ROWS - 1)]) ** 2, count)
