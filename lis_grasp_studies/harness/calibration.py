"""Calibration: predicted probabilities against observed rates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.typing import FloatArray, IntArray

_BINS = 10


def calibration_bins(
    predicted: npt.ArrayLike, observed: npt.ArrayLike
) -> list[tuple[int, float, float]]:
    """Return the count, mean predicted probability and observed rate of each non-empty bin.

    Arguments as of `expected_calibration_error`.
    """
    probability, outcome = np.asarray(predicted, np.float64), np.asarray(observed, np.float64)
    index = _bins_of(probability)
    members = [index == b for b in np.unique(index)]
    return [(int(m.sum()), float(probability[m].mean()), float(outcome[m].mean())) for m in members]


def expected_calibration_error(predicted: npt.ArrayLike, observed: npt.ArrayLike) -> float:
    """Return the expected calibration error (ECE).

    ``sum_b |observed rate in b - mean probability in b| n_b / N`` over bins of equal width
    (Naeini, Cooper and Hauskrecht, AAAI 2015). `predicted` are probabilities (N,), `observed` says
    of each event whether it occurred (N,).
    """
    found = calibration_bins(predicted, observed)
    off = sum(count * abs(rate - probability) for count, probability, rate in found)
    return off / sum(count for count, _, _ in found)


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
