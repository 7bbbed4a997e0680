"""A deferred surface is that of its function, made once, and only if it is used."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_surfaces import Analytic, cube_bounds, sphere
from numpy.testing import assert_array_equal

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.implicit_surface import DeferredSurface


def _ball() -> Analytic:
    return Analytic(sphere(0.05), cube_bounds(0.06))


def test_it_answers_as_the_surface_that_is_made_once() -> None:
    made = []

    def make() -> ImplicitSurface:
        made.append(_ball())
        return made[-1]

    deferred = DeferredSurface(make)
    assert isinstance(deferred, ImplicitSurface)
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3))
    for name in ("evaluate", "gradient", "uncertainty"):
        assert_array_equal(getattr(deferred, name)(points), getattr(made[0], name)(points))
    assert_array_equal(deferred.bounds, made[0].bounds)
    assert len(made) == 1


def test_nothing_is_made_without_a_use() -> None:
    made: list[int] = []
    DeferredSurface(lambda: made.append(1) or _ball())
    assert not made


def test_the_error_of_its_function_is_that_of_the_first_use() -> None:
    own = EstimationError("too few contacts")

    def fail() -> ImplicitSurface:
        raise own

    deferred = DeferredSurface(fail)
    with pytest.raises(EstimationError) as error:
        deferred.evaluate(np.zeros((1, 3)))
    assert error.value is own
