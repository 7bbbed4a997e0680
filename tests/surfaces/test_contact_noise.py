"""Noise of each contact: precedence, merging, and its use by every estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.surfaces import (
    ESTIMATORS,
    Estimator,
    GaussianProcessImplicitSurface,
    LocalImplicitSurface,
)
from lis_grasp.surfaces._contact_noise import noise_of
from lis_grasp.surfaces.contact_preparation import (
    merge_duplicates,
    prepare_contacts,
    with_noise,
)

with_own_noise = pytest.mark.parametrize(
    "estimate",
    [LocalImplicitSurface.from_contacts, GaussianProcessImplicitSurface.from_contacts],
)


def sphere_contacts(count: int = 40, *, radius: float = 0.05, seed: int = 0) -> Contacts:
    """Contacts spread evenly over a sphere (Fibonacci lattice), turned at random."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count) + seed
    ring = np.sqrt(1.0 - height**2)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
    return Contacts(radius * normals, normals)


def queries(count: int = 100) -> np.ndarray:
    return np.random.default_rng(7).uniform(-0.07, 0.07, (count, 3))


def test_a_contact_s_own_noise_is_used_before_what_is_given() -> None:
    contacts = replace(sphere_contacts(3), position_noise=[0.001, np.nan, 0.0])
    position, normal = noise_of(contacts, 0.002, None)
    np.testing.assert_array_equal(position, [0.001, 0.002, 0.0])
    np.testing.assert_array_equal(normal, np.full(3, np.nan))
    position, _ = noise_of(contacts, None, None)
    np.testing.assert_array_equal(position, [0.001, np.nan, 0.0])


@pytest.mark.parametrize("option", ["position_noise", "normal_noise"])
@pytest.mark.parametrize("value", [-1e-3, float("nan"), float("inf")])
def test_noise_out_of_range_is_refused(option: str, value: float) -> None:
    options = {"position_noise": None, "normal_noise": None, option: value}
    with pytest.raises(InvalidOptionError) as error:
        noise_of(sphere_contacts(3), **options)
    assert error.value.option == option


def test_measurements_of_one_place_are_averaged_by_inverse_variance() -> None:
    # Variances 1, 4 and 4 (in mm^2): weights 4 : 1 : 1, and 1 / (1 + 1/4 + 1/4) = 2/3 together.
    noise = 1e-3 * np.array([1.0, 2.0, 2.0, 5.0])
    contacts = Contacts(
        [[0, 0, 0], [6e-5, 0, 0], [0, 6e-5, 0], [1, 0, 0]],
        np.tile([0.0, 0.0, 1.0], (4, 1)),
        position_noise=noise,
    )
    merged = merge_duplicates(contacts)
    np.testing.assert_allclose(merged.points, [[1e-5, 1e-5, 0], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(merged.position_noise, [1e-3 * np.sqrt(2 / 3), 5e-3], rtol=1e-12)
    assert merged.normal_noise is None


def test_given_noise_is_reduced_by_averaging_too() -> None:
    contacts = Contacts([[0, 0, 0], [6e-5, 0, 0], [1, 0, 0]], np.tile([0.0, 0.0, 1.0], (3, 1)))
    merged = merge_duplicates(contacts, 2e-6, 0.1)
    np.testing.assert_allclose(merged.position_noise, [np.sqrt(2.0) * 1e-6, 2e-6])
    np.testing.assert_allclose(merged.normal_noise, [np.sqrt(0.005), 0.1])
    assert merge_duplicates(contacts).position_noise is None


def test_an_exact_measurement_decides_its_place() -> None:
    contacts = Contacts(
        [[0, 0, 0], [8e-5, 0, 0], [1, 0, 0]],
        np.tile([0.0, 0.0, 1.0], (3, 1)),
        position_noise=[0.0, 0.001, np.nan],
    )
    merged = merge_duplicates(contacts)
    # A weight of 1e-6 is the least.
    np.testing.assert_allclose(merged.points, [[0, 0, 0], [1, 0, 0]], atol=1e-9)
    np.testing.assert_array_equal(merged.position_noise, [0.0, np.nan])


def test_an_exact_repetition_is_one_measurement_with_the_least_noise() -> None:
    contacts = replace(sphere_contacts(5), normal_noise=np.arange(5) / 10)
    again = replace(contacts.subset([4, 2, 2]), normal_noise=[0.6, np.nan, 0.1])
    distinct = merge_duplicates(contacts.append(again))
    np.testing.assert_array_equal(distinct.points, contacts.points)
    np.testing.assert_array_equal(distinct.normal_noise, [0.0, 0.1, 0.1, 0.3, 0.4])
    assert distinct.position_noise is None


@pytest.mark.by_default("True-lis", "True-gpis", "True-smooth", "True-patch", "True-blend")
@pytest.mark.parametrize("estimate", ESTIMATORS.values(), ids=ESTIMATORS)
@pytest.mark.parametrize("known", [True, False])
def test_repeating_contacts_changes_nothing(estimate: Estimator, known: bool) -> None:
    contacts = sphere_contacts()
    if known:
        noise = np.linspace(1e-4, 3e-3, len(contacts))
        contacts = replace(contacts, position_noise=noise, normal_noise=10.0 * noise)
    again = contacts.append(contacts.subset([0, 0, 3, 17]))
    once, twice = estimate(contacts), estimate(again)
    np.testing.assert_array_equal(twice.evaluate(queries()), once.evaluate(queries()))
    np.testing.assert_array_equal(twice.uncertainty(queries()), once.uncertainty(queries()))


@with_own_noise
def test_equal_noise_of_each_contact_is_the_noise_of_all(estimate) -> None:
    contacts = sphere_contacts()
    each = replace(contacts, position_noise=np.full(40, 1e-3), normal_noise=np.full(40, 0.1))
    of_each = estimate(each, position_noise=9e-3, normal_noise=1.0)  # for contacts without
    of_all = estimate(contacts, position_noise=1e-3, normal_noise=0.1)
    np.testing.assert_array_equal(of_each.evaluate(queries()), of_all.evaluate(queries()))
    np.testing.assert_array_equal(of_each.uncertainty(queries()), of_all.uncertainty(queries()))


@with_own_noise
def test_a_region_touched_by_a_worse_sensor_is_less_certain(estimate) -> None:
    contacts = sphere_contacts(60)
    lower = contacts.points[:, 2] < 0.0
    noisy = replace(
        contacts,
        position_noise=np.where(lower, 4e-3, 2e-4),
        normal_noise=np.where(lower, 0.3, 0.02),
    )
    surface = estimate(noisy)
    tip = np.array([0.0, 0.0, 0.05])
    around = tip + 0.01 * np.random.default_rng(0).normal(size=(50, 3))
    assert np.median(surface.uncertainty(-around) / surface.uncertainty(around)) > 1.5


def test_a_gaussian_process_trusts_each_contact_by_its_noise() -> None:
    """Errors of 4 mm on a third of the contacts vanish where their noise is known."""
    truth, rng = sphere_contacts(60), np.random.default_rng(3)
    noise = np.where(np.arange(60) % 3 == 0, 4e-3, 1e-5)
    contacts = replace(truth, points=truth.points + noise[:, None] * rng.normal(size=(60, 3)))
    directions = sphere_contacts(500, seed=1).normals

    def rms_error(contacts: Contacts, **noise: float) -> float:
        surface = GaussianProcessImplicitSurface.from_contacts(contacts, **noise)
        return float(np.sqrt(np.mean(surface.evaluate(0.05 * directions) ** 2)))

    informed = rms_error(replace(contacts, position_noise=noise))
    # The same noise of all, their root mean square, and none.
    averaged = rms_error(contacts, position_noise=float(np.sqrt(np.mean(noise**2))))
    assert informed < 0.5 * averaged
    assert informed < 0.5 * rms_error(contacts, position_noise=0.0, normal_noise=0.0)


def test_a_gaussian_process_estimates_noise_that_is_not_given() -> None:
    contacts = sphere_contacts(60)
    rng = np.random.default_rng(3)
    with_errors = replace(contacts, points=contacts.points + 3e-3 * rng.normal(size=(60, 3)))
    directions = sphere_contacts(500, seed=1).normals
    estimate = GaussianProcessImplicitSurface.from_contacts
    without, estimated = (
        estimate(with_errors, **noise).evaluate(0.05 * directions)
        for noise in ({"position_noise": 0.0, "normal_noise": 0.0}, {})
    )
    assert np.linalg.norm(estimated) < 0.7 * np.linalg.norm(without)


def test_noise_is_estimated_from_the_contacts_that_lack_it() -> None:
    rng = np.random.default_rng(3)
    clean, noisy = sphere_contacts(60), sphere_contacts(60, seed=1)
    known = replace(clean, position_noise=np.full(60, 1e-4), normal_noise=np.full(60, 1e-3))
    unknown = replace(noisy, points=noisy.points + 3e-3 * rng.normal(size=(60, 1)) * noisy.normals)
    completed = with_noise(known.append(unknown), None, 0.01)
    np.testing.assert_array_equal(completed.position_noise[:60], 1e-4)
    np.testing.assert_allclose(completed.position_noise[60:], 3e-3, rtol=0.5)
    np.testing.assert_array_equal(completed.normal_noise[60:], 0.01)
    few = Contacts(np.eye(3), np.eye(3))
    assert with_noise(few).position_noise is None
    np.testing.assert_array_equal(prepare_contacts(few).position_noise, np.zeros(3))


def test_a_noisy_cloud_is_not_one_place() -> None:
    """Links within the noise join a cloud to chains, whose means say nothing."""
    rng, truth = np.random.default_rng(0), sphere_contacts(3000)
    noise = 2e-3
    tilted = truth.normals + 0.15 * rng.normal(size=(3000, 3))
    cloud = Contacts(
        truth.points + noise * rng.normal(size=(3000, 3)),
        tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
        position_noise=np.full(3000, noise),
    )
    merged = merge_duplicates(cloud)
    assert len(merged) > 1000
