"""The expected calibration error, against cases that can be counted by hand."""

import numpy as np
import pytest

from lis_grasp_studies.harness.calibration import (
    chance_calibration_error,
    expected_calibration_error,
)


@pytest.mark.parametrize(
    ("predicted", "observed", "error"),
    [
        ([0.5] * 4, [True, True, False, False], 0.0),
        ([1.0, 1.0], [False, False], 1.0),
        ([0.0, 0.0], [True, True], 1.0),
        # One bin of 0.25 where half occurred, one of 0.75 where all did.
        ([0.25, 0.25, 0.75, 0.75], [True, False, True, True], 0.25),
        # Within a bin errors cancel, between bins they do not.
        ([0.41, 0.49], [False, True], 0.05),
        ([0.39, 0.51], [False, True], 0.44),
    ],
)
def test_it_is_the_mean_distance_of_rates_from_probabilities(
    predicted: list[float], observed: list[bool], error: float
) -> None:
    assert expected_calibration_error(predicted, observed) == pytest.approx(error)


def test_a_calibrated_predictor_has_no_error_in_the_long_run() -> None:
    rng = np.random.default_rng(0)
    predicted = rng.random(200_000)
    error = expected_calibration_error(predicted, rng.random(200_000) < predicted)
    # Ten bins of 20 000: the standard deviation of each rate is 0.0035 at the most.
    assert error < 0.004


@pytest.mark.parametrize("count", [100, 1000])
def test_the_error_by_chance_is_the_mean_of_right_predictions(count: int) -> None:
    rng = np.random.default_rng(1)
    predicted = rng.beta(3.0, 1.0, count)
    errors = [
        expected_calibration_error(predicted, rng.random(count) < predicted) for _ in range(1000)
    ]
    assert chance_calibration_error(predicted) == pytest.approx(np.mean(errors), rel=0.04)


def test_certain_predictions_have_no_error_by_chance() -> None:
    assert chance_calibration_error([0.0, 1.0, 1.0]) == 0.0
