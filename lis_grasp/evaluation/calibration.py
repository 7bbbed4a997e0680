"""Whether what was foretold with some probability came as often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


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
    probability = np.asarray(foretold, dtype=np.float64)
    surplus = np.asarray(happened, dtype=np.float64) - probability
    index = np.minimum((bins * probability).astype(int), bins - 1)
    return float(np.abs(np.bincount(index, weights=surplus, minlength=bins)).sum() / len(surplus))
