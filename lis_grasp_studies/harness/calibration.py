"""Calibration: predicted probabilities against observed rates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.typing import FloatArray, IntArray

_BINS = 10


def expected_calibration_error(predicted: npt.ArrayLike, observed: npt.ArrayLike) -> float:
    """Return the expected calibration error (ECE).

    ``sum_b |observed rate in b - mean probability in b| n_b / N`` over bins of equal width
    (Naeini, Cooper and Hauskrecht, AAAI 2015). `predicted` are probabilities (N,), `observed` says
    of each event whether it occurred (N,).
    """
    probability, outcome = np.asarray(predicted, np.float64), np.asarray(observed, np.float64)
    off = np.bincount(_bins_of(probability), outcome - probability)
    return float(np.abs(off).sum() / len(probability))


def chance_calibration_error(predicted: npt.ArrayLike) -> float:
    """Return the mean calibration error of a predictor whose probabilities are all right.

    It is not 0: the rate of a few events differs from their probability by chance. With a normal
    approximation of the rate of each bin, the mean of ``|rate - probability|`` is
    ``sqrt(2 / pi)`` standard deviations. Arguments as of `expected_calibration_error`.
    """
    probability = np.asarray(predicted, np.float64)
    index = _bins_of(probability)
    variances = np.bincount(index, probability * (1.0 - probability))  # of the number of events
    return float(np.sqrt(2.0 / np.pi) * np.sqrt(variances).sum() / len(probability))


def _bins_of(probability: FloatArray) -> IntArray:
    return np.minimum((_BINS * probability).astype(np.int64), _BINS - 1)
