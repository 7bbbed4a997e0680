"""Whether what was foretold with some probability came as often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def calibration_bins(
    foretold: npt.ArrayLike, happened: npt.ArrayLike, *, bins: int = 10
) -> list[tuple[int, float, float]]:
    """Return, of each bin with anything in it: how much, mean probability, share that happened.

    Arguments as of `expected_calibration_error`.
    """
    probability, came = np.asarray(foretold, np.float64), np.asarray(happened, np.float64)
    index = np.minimum((bins * probability).astype(int), bins - 1)
    members = [index == b for b in np.unique(index)]
    return [(int(m.sum()), float(probability[m].mean()), float(came[m].mean())) for m in members]


def expected_calibration_error(
    foretold: npt.ArrayLike, happened: npt.ArrayLike, *, bins: int = 10
) -> float:
    """Return by how much probabilities are off, on average.

    ``sum_b |share of b that happened - mean probability in b| n_b / N`` over bins of equal width
    (Naeini, Cooper and Hauskrecht, AAAI 2015).

    Parameters
    ----------
    foretold
        Shape (N,): probabilities.
    happened
        Shape (N,): whether each came true.
    bins
        How many.
    """
    found = calibration_bins(foretold, happened, bins=bins)
    off = sum(count * abs(share - probability) for count, probability, share in found)
    return off / sum(count for count, _, _ in found)
