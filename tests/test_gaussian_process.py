"""The Gaussian process baseline against dense algebra on kernel values alone, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
import reference

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError, InvalidOptionError
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.surfaces.contact_merging import LONE_CONTACT_SPACING
from lis_grasp.surfaces.kernels import Matern52, RadialKernel, SquaredExponential, ThinPlate

KERNELS = ["rbf", "matern52", "thin_plate"]


def sphere_contacts(count: int, radius: float = 0.05, seed: int = 0) -> Contacts:
    normals = np.random.default_rng(seed).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Contacts(radius * normals, normals)


@pytest.mark.parametrize("kernel", [SquaredExponential(0.7), Matern52(0.7), ThinPlate(3.0)])
def test_kernel_derivatives_equal_differences(kernel: RadialKernel) -> None:
    r = np.linspace(0.05, 1.5, 40)
    h = 1e-4
    slope = (kernel.value(r + h) - kernel.value(r - h)) / (2 * h)
    curvature = (kernel.value(r + h) - 2 * kernel.value(r) + kernel.value(r - h)) / h**2
    # Truncation h^2 k''' / 6 and rounding 1e-16 / h^2 are both below 1e-7 here, over r^2 at worst.
    np.testing.assert_allclose(kernel.first(r), -slope / r, atol=1e-6)
    np.testing.assert_allclose(kernel.second(r), (curvature - slope / r) / r**2, atol=1e-4)


@pytest.mark.parametrize("kernel", [SquaredExponential(0.7), Matern52(0.7), ThinPlate(3.0)])
def test_kernels_are_one_and_finite_at_distance_zero(kernel: RadialKernel) -> None:
    zero = np.zeros(1)
    assert kernel.value(zero)[0] == 1.0
    assert np.isfinite([kernel.first(zero)[0], kernel.second(zero)[0]]).all()


@pytest.mark.parametrize("kernel", KERNELS)
def test_posterior_equals_dense_algebra_on_kernel_values(kernel: str) -> None:
    contacts = sphere_contacts(9)
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, position_noise=0.001, normal_noise=0.1
    )
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (12, 3))
    scale, center = surface.scale, surface.center
    mean, variance = reference.gaussian_process(
        kernel,
        (queries - center) / scale,
        (contacts.points - center) / scale,
        contacts.normals,
        length=surface.kernel.length,
        value_noise=0.001 / scale,
        gradient_noise=0.1,
        mean=1.0,
    )
    # The oracle's slopes are differences over 2e-4: off by step^2 / 6 of a third derivative, and
    # rounded at 1e-16 / step^2 = 1e-8; the inverse magnifies that by up to 1 / noise^2 = 1e2. The
    # thin plate's third derivative jumps at 0, where its slopes are off by as much as step itself.
    tolerance = 1e-4 if kernel == "thin_plate" else 1e-5
    np.testing.assert_allclose(surface.evaluate(queries), scale * mean, atol=tolerance * scale)
    variance *= (surface.amplitude * scale) ** 2
    np.testing.assert_allclose(surface.variance(queries), variance, atol=tolerance * scale**2)


@pytest.mark.parametrize("kernel", KERNELS)
def test_gradient_equals_differences_of_values(kernel: str) -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(30), kernel=kernel)
    queries = np.random.default_rng(2).uniform(-0.08, 0.08, (200, 3))
    step = 1e-5
    differences = np.stack(
        [
            (surface.evaluate(queries + m) - surface.evaluate(queries - m)) / (2 * step)
            for m in step * np.eye(3)
        ],
        axis=-1,
    )
    # Truncation step^2 f''' / 6 with f''' of some 1e3 / m^2, rounding 1e-13 / step.
    np.testing.assert_allclose(surface.gradient(queries), differences, atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
def test_contacts_are_interpolated_without_noise(kernel: str) -> None:
    contacts = sphere_contacts(15)
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, length=0.3 if kernel == "thin_plate" else 0.05,
        position_noise=1e-8, normal_noise=1e-6,
    )  # fmt: skip
    np.testing.assert_allclose(surface.evaluate(contacts.points), 0.0, atol=1e-6)
    np.testing.assert_allclose(surface.gradient(contacts.points), contacts.normals, atol=1e-4)
    np.testing.assert_allclose(surface.uncertainty(contacts.points), 0.0, atol=1e-6)


def test_noise_on_one_contact_shrinks_its_pull_as_the_closed_form_says() -> None:
    # One contact: the slope is uncorrelated with the value at the same place, so that the mean at
    # the contact is m - m k / (k + noise^2) with k = 1.
    contact = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    surface = GaussianProcessImplicitSurface.from_contacts(
        contact, prior_mean=0.1, position_noise=0.5 * LONE_CONTACT_SPACING, length=0.1
    )
    expected = 0.1 - 0.1 / (1.0 + 0.5**2)  # noise in units of the scale
    assert surface.evaluate([0.0, 0.0, 0.0]) == pytest.approx(expected, rel=1e-12)


def test_the_prior_mean_returns_far_away() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(20), prior_mean=0.07)
    assert surface.evaluate([5.0, 0.0, 0.0]) == pytest.approx(0.07, rel=1e-12)


def test_a_sphere_s_inside_is_negative_and_its_surface_is_found() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(40))
    directions = sphere_contacts(300, radius=1.0, seed=9).points
    assert surface.evaluate([0.0, 0.0, 0.0]) < 0
    assert (surface.evaluate(0.045 * directions) < 0).all()
    assert (surface.evaluate(0.055 * directions) > 0).all()


@pytest.mark.parametrize("kernel", KERNELS)
def test_variance_grows_away_from_the_contacts_and_never_above_the_prior(kernel: str) -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(20), kernel=kernel)
    away = np.outer(np.linspace(0.06, 0.09, 12), [1.0, 0.0, 0.0])
    variance = surface.variance(away)
    assert (np.diff(variance) > 0).all()
    assert variance.max() <= (surface.amplitude * surface.scale) ** 2 * (1 + 1e-12)


def test_a_contact_more_never_raises_the_variance_before_it_is_scaled() -> None:
    contacts = sphere_contacts(20)
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (100, 3))
    options = {"length": 0.05, "position_noise": 1e-4}
    fewer = GaussianProcessImplicitSurface.from_contacts(contacts, **options)
    center = Contacts([[0.0, 0.0, 0.01]], [[0.0, 0.0, 1.0]])  # inside: it keeps the scale
    more = GaussianProcessImplicitSurface.from_contacts(contacts.append(center), **options)
    assert fewer.scale == more.scale
    before, after = (s.variance(queries) / (s.amplitude * s.scale) ** 2 for s in (fewer, more))
    assert (after <= before + 1e-9).all()


def test_no_contacts_are_refused() -> None:
    with pytest.raises(InvalidContactsError, match="at least one contact"):
        GaussianProcessImplicitSurface.from_contacts(Contacts.empty())


def test_singular_equations_are_reported_in_one_sentence() -> None:
    contacts = sphere_contacts(5)
    twice = contacts.append(contacts)
    with pytest.raises(EstimationError, match="raise position_noise or normal_noise"):
        GaussianProcessImplicitSurface.from_contacts(twice, position_noise=0.0, normal_noise=0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kernel": "cubic"}, "kernel must be one of rbf, matern52, thin_plate"),
        ({"length": 0.0}, "length must be above 0"),
        ({"position_noise": -1.0}, "position_noise must be at least 0"),
        ({"normal_noise": float("nan")}, "normal_noise must be at least 0"),
        ({"prior_mean": -0.1}, "prior_mean must be above 0"),
        ({"margin": -0.1}, "margin must be at least 0"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidOptionError, match=message):
        GaussianProcessImplicitSurface.from_contacts(sphere_contacts(5), **options)
