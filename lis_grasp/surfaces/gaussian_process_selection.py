"""What a Gaussian process' contacts say about its own numbers: its amplitude and its length."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.gaussian_process_regression import GradientRegression
from lis_grasp.surfaces.kernels import KernelName, RadialKernel
from lis_grasp.typing import FloatArray

Criterion = Literal["likelihood", "leave_one_out"]

# Root mean squared distances [mm]: estimate to truth, truth to estimate, edges to estimate, means
# over eight objects of 0.2 m, five walks each, other ones than those that results are told for.
#
#     kernel      length               all explored     half explored
#     matern52    0.8 distances        2.9  2.3  5.8    6.0  6.8   8.3    the default
#                 likelihood           2.7  2.5  6.5    6.3  7.1   8.6
#                 leave_one_out        2.5  2.4  6.3    6.3  7.1   9.1
#     rbf         0.4 distances        3.5  2.3  6.3    7.0  6.6   8.5
#                 likelihood           3.9  2.7  7.0    7.5  7.8  10.6
#                 leave_one_out        3.8  2.7  6.8    7.2  7.2   9.2
#     thin_plate  1.5 diagonals        2.5  2.5  7.0    6.8  7.9   9.2
#                 likelihood           2.5  2.6  7.1    6.8  7.9   9.2
#                 leave_one_out        2.5  2.6  7.1    6.8  8.0   9.4
#
# The criteria prefer lengths that suit faces, which is where contacts are, and lose the edges.
# Choosing the misfit of normals by them as well did no better.

# Length of each kernel, in units of the largest distance between two contacts; of the thin plate,
# in diagonals of the bounds: with gradient blocks its matrix is positive definite only if the
# length exceeds the largest distance by about a third.
DEFAULT_LENGTHS: dict[KernelName, float] = {"rbf": 0.4, "matern52": 0.8, "thin_plate": 1.5}

# Shortest and longest length that a criterion may choose, over those.
LENGTH_FACTORS: dict[KernelName, tuple[float, float]] = {
    "rbf": (0.25, 4.0),
    "matern52": (0.25, 4.0),
    "thin_plate": (0.9, 4.0),
}

# The amplitude is looked for down to about this share of what it would be without any noise.
_LEAST_AMPLITUDE = 1e-3

# Lengths tried before the best of them is refined.
_TRIALS = 9

# What a length counts at which the equations are singular: less than any other.
_SINGULAR = 1e12


def fit_with_noise(
    kernel: RadialKernel,
    nodes: FloatArray,
    targets: FloatArray,
    *,
    sensor_noise: FloatArray,
    misfit: FloatArray,
) -> GradientRegression:
    """Fit a process whose amplitude a agrees with noise that is known in absolute terms.

    Its prior is a^2 k, its noise a^2 misfit + sensor_noise, and a is such that the targets scatter
    as foretold: targets^T (a^2 (K + misfit) + sensor_noise)^-1 targets = 4N. The left side falls
    as a grows, so that there is one such a. In the result everything is divided by a^2.

    Parameters
    ----------
    kernel, nodes, targets
        See `GradientRegression`.
    sensor_noise
        Shape (4,), variances of value and slopes.
    misfit
        Shape (4,), variances in units of the prior's.
    """
    process = GradientRegression.fit(kernel, nodes, targets, misfit)
    if not sensor_noise.any():
        return process

    def fit(log_amplitude: float) -> GradientRegression:
        noise = misfit + sensor_noise * np.exp(-2.0 * log_amplitude)
        return GradientRegression.fit(kernel, nodes, targets, noise)

    def excess(log_amplitude: float) -> float:
        return float(np.log(fit(log_amplitude).likeliest_amplitude())) - log_amplitude

    # Noise explains some of the scatter: a is lower than without it. A little more, for rounding.
    high = float(np.log(process.likeliest_amplitude())) + 0.1
    low = high + float(np.log(_LEAST_AMPLITUDE))
    if excess(low) <= 0.0:  # noise explains all of it
        return fit(low)
    return fit(float(brentq(excess, low, high, xtol=1e-9)))


def choose_length(
    fit: Callable[[float], GradientRegression],
    criterion: Criterion,
    default: float,
    factors: tuple[float, float],
) -> float:
    """Return the kernel length by which the contacts foretell each other best.

    Evenly spaced logarithms first, then Brent's bounded search beside the best of them; no random
    numbers. The default where the equations are singular at all lengths.

    Parameters
    ----------
    fit
        Makes the process with a given length; EstimationError where it is singular.
    criterion
        "likelihood": log marginal likelihood (Rasmussen and Williams 2006, eq. 5.8).
        "leave_one_out": log predictive density of each contact from all others (eq. 5.11).
    default
        A length, in the unit of `fit`.
    factors
        Least and largest length tried, over the default.
    """

    def loss(log_length: float) -> float:
        try:
            process = fit(float(np.exp(log_length)))
        except EstimationError:
            return _SINGULAR
        if criterion == "likelihood":
            return -process.log_marginal_likelihood()
        return -process.leave_one_out_log_density()

    trials = np.log(default * np.geomspace(*factors, _TRIALS))
    losses = [loss(trial) for trial in trials]
    best = int(np.argmin(losses))
    if losses[best] == _SINGULAR:
        return default
    beside = trials[max(best - 1, 0)], trials[min(best + 1, _TRIALS - 1)]
    found = minimize_scalar(loss, bounds=beside, method="bounded", options={"xatol": 1e-4})
    return float(np.exp(found.x if found.fun < losses[best] else trials[best]))
