"""Least uncertainty: closed forms of distances, and the values of the estimate unchanged."""

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.surfaces.least_uncertainty import _GROWTH, LeastUncertainty

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS = Contacts(0.03 * AXES, AXES, position_noise=np.full(6, 0.0005))
SURFACE = GaussianProcessImplicitSurface.from_contacts(CONTACTS)
PLACES = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3))


@pytest.fixture
def one() -> LeastUncertainty:
    """Return the estimate as if one contact had been measured, with 2 mm of noise."""
    few = Contacts([[0.0, 0.0, 0.03]], [[0.0, 0.0, 1.0]], position_noise=np.array([0.002]))
    return LeastUncertainty(SURFACE, few)


def test_it_is_the_larger_of_the_own_one_and_that_of_the_nearest_contact(
    one: LeastUncertainty,
) -> None:
    distance = np.linalg.norm(PLACES - [0.0, 0.0, 0.03], axis=1)
    own = SURFACE.uncertainty(PLACES)
    expected = np.maximum(own, np.hypot(0.002, _GROWTH * distance))
    assert np.abs(one.uncertainty(PLACES) - expected).max() < 1e-15
    assert (one.uncertainty(PLACES) > own).any()
    assert one.uncertainty([0.0, 0.0, 0.03]) >= 0.002


def test_the_surface_is_that_of_the_estimate(one: LeastUncertainty) -> None:
    assert np.array_equal(one.evaluate(PLACES), SURFACE.evaluate(PLACES))
    assert np.array_equal(one.gradient(PLACES), SURFACE.gradient(PLACES))
    assert np.array_equal(one.bounds, SURFACE.bounds)


def test_noise_that_is_unknown_counts_as_none() -> None:
    bare = LeastUncertainty(SURFACE, Contacts(CONTACTS.points, AXES))
    assert np.array_equal(bare.uncertainty(CONTACTS.points), SURFACE.uncertainty(CONTACTS.points))
