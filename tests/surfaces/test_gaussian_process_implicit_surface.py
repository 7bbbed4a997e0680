"""Gaussian process implicit surfaces against dense algebra, GPyTorch and closed forms."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import weakref
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference
import trimesh
from analytic_surfaces import differences
from random_directions import random_directions

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.meshing import extract_mesh
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    _gaussian_process_regression,
)
from lis_grasp.surfaces._gaussian_process_regression import GradientRegression, gradient_covariance
from lis_grasp.surfaces._kernels import (
    Matern52,
    Matern72,
    RadialKernel,
    SquaredExponential,
    ThinPlate,
)
from lis_grasp.surfaces.contact_places import (
    LONE_CONTACT_SPACING,
    ContactPlaces,
    farthest_point_order,
)
from lis_grasp_studies.test_objects.shape_sets import EVALUATION, graspable_shape

ALL_KERNELS = [SquaredExponential(0.7), Matern52(0.7), Matern72(0.7), ThinPlate(3.0)]
KERNELS = ["rbf", "matern52", "thin_plate"]
NO_NOISE = {"position_noise": 0.0, "normal_noise": 0.0}
ORACLE = Path(__file__).parents[1] / "oracles" / "gpytorch_posterior.json"


def sphere_contacts(count: int, radius: float = 0.05, seed: int = 0) -> Contacts:
    normals = random_directions(count, np.random.default_rng(seed))
    return Contacts(radius * normals, normals)


@pytest.mark.parametrize("kernel", ALL_KERNELS)
def test_kernel_derivatives_equal_differences(kernel: RadialKernel) -> None:
    r = np.linspace(0.05, 1.5, 40)
    h = 1e-4
    slope = (kernel.value(r + h) - kernel.value(r - h)) / (2 * h)
    curvature = (kernel.value(r + h) - 2 * kernel.value(r) + kernel.value(r - h)) / h**2
    # Truncation h^2 k''' / 6 and rounding 1e-16 / h^2 are both below 1e-7 here, over r^2 at worst.
    np.testing.assert_allclose(kernel.first(r), -slope / r, atol=1e-6)
    np.testing.assert_allclose(kernel.second(r), (curvature - slope / r) / r**2, atol=1e-4)


@pytest.mark.parametrize("kernel", ALL_KERNELS)
def test_kernels_are_one_and_finite_at_distance_zero(kernel: RadialKernel) -> None:
    zero = np.zeros(1)
    assert kernel.value(zero)[0] == 1.0
    assert np.isfinite([kernel.first(zero)[0], kernel.second(zero)[0]]).all()


@pytest.mark.parametrize("kernel", KERNELS)
def test_posterior_equals_dense_algebra_on_kernel_values(kernel: str) -> None:
    contacts = sphere_contacts(9)
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, misfit=(0.01, 0.1)
    )
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (12, 3))
    scale, center = surface.scale, surface.center
    mean, variance = reference.gaussian_process(
        kernel,
        (queries - center) / scale,
        (contacts.points - center) / scale,
        contacts.normals,
        length=surface.kernel.length,
        value_noise=0.01,
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
    # Truncation step^2 f''' / 6 with f''' of some 1e3 / m^2, rounding 1e-13 / step.
    expected = differences(surface, queries, 1e-5)
    np.testing.assert_allclose(surface.gradient(queries), expected, atol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
def test_contacts_are_interpolated_without_noise(kernel: str) -> None:
    contacts = sphere_contacts(15)
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, length=0.3 if kernel == "thin_plate" else 0.05,
        misfit=(1e-7, 1e-6), **NO_NOISE,
    )  # fmt: skip
    np.testing.assert_allclose(surface.evaluate(contacts.points), 0.0, atol=1e-6)
    np.testing.assert_allclose(surface.gradient(contacts.points), contacts.normals, atol=1e-4)
    np.testing.assert_allclose(surface.variance(contacts.points), 0.0, atol=1e-12)


def test_misfit_of_one_contact_shrinks_its_pull_as_in_closed_form() -> None:
    # One contact: the slope is uncorrelated with the value at the same place, so that the mean at
    # the contact is m - m k / (k + misfit^2) with k = 1.
    contact = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    surface = GaussianProcessImplicitSurface.from_contacts(
        contact, prior_mean=0.1, misfit=(0.5, 0.1), length=0.1
    )
    expected = 0.1 - 0.1 / (1.0 + 0.5**2)
    assert surface.evaluate([0.0, 0.0, 0.0]) == pytest.approx(expected, rel=1e-12)


def test_noise_of_one_contact_shrinks_its_pull_as_the_fitted_prior_says() -> None:
    # A prior of deviation a: value and slopes are uncorrelated, of variances a^2 and (a / length)^2
    # with the noise added. a solves (m^2 / (a^2 + s^2) + 1 / (a / length)^2) / 4 = 1, all scaled: a
    # quadratic equation for a^2.
    contact = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    mean, noise, length = 2.0, 0.5, 3.0
    surface = GaussianProcessImplicitSurface.from_contacts(
        contact,
        kernel="rbf",
        prior_mean=mean * LONE_CONTACT_SPACING,
        position_noise=noise * LONE_CONTACT_SPACING,
        length=length * LONE_CONTACT_SPACING,
        misfit=(0.0, 0.0),
    )
    half = (mean**2 + length**2 - 4.0 * noise**2) / 8.0
    variance = half + np.sqrt(half**2 + (length * noise) ** 2 / 4.0)
    expected = mean - mean * variance / (variance + noise**2)
    value = surface.evaluate([0.0, 0.0, 0.0]) / LONE_CONTACT_SPACING
    assert value == pytest.approx(expected, rel=1e-8)  # the root is found to 1e-9


def test_contacts_that_are_all_noise_leave_the_prior_mean() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(
        sphere_contacts(10), prior_mean=0.07, position_noise=1e3, normal_noise=1e3
    )
    # The least amplitude is about 1e-3, of noises 1e3 (in radians) and more: pulls of 1e-12.
    assert surface.evaluate([0.0, 0.0, 0.05]) == pytest.approx(0.07, rel=1e-9)


def test_noise_far_below_the_misfit_changes_nothing() -> None:
    contacts, queries = sphere_contacts(20), sphere_contacts(9, radius=0.06, seed=4).points
    plain = GaussianProcessImplicitSurface.from_contacts(contacts, **NO_NOISE)
    noisy = GaussianProcessImplicitSurface.from_contacts(
        contacts, position_noise=1e-12, normal_noise=1e-10
    )
    # Variances of noise are (1e-10 / 1e-3)^2 of the misfit's or less.
    np.testing.assert_allclose(noisy.evaluate(queries), plain.evaluate(queries), atol=1e-12)
    np.testing.assert_allclose(noisy.uncertainty(queries), plain.uncertainty(queries), rtol=1e-6)


def test_no_cycle_of_references_keeps_a_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[weakref.ref[np.ndarray]] = []

    def recorded(*arguments: Any) -> np.ndarray:
        covariance = gradient_covariance(*arguments)
        made.append(weakref.ref(covariance))
        return covariance

    monkeypatch.setattr(_gaussian_process_regression, "gradient_covariance", recorded)
    gc.disable()
    try:
        GaussianProcessImplicitSurface.from_contacts(
            sphere_contacts(30), position_noise=0.001, normal_noise=0.05
        )
        assert made
        assert all(covariance() is None for covariance in made)
    finally:
        gc.enable()


def test_the_prior_mean_returns_far_away() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(20), prior_mean=0.07)
    assert surface.evaluate([5.0, 0.0, 0.0]) == pytest.approx(0.07, rel=1e-12)


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
    options = {"length": 0.05}
    fewer = GaussianProcessImplicitSurface.from_contacts(contacts, **options)
    center = Contacts([[0.0, 0.0, 0.01]], [[0.0, 0.0, 1.0]])  # inside: it keeps the scale
    more = GaussianProcessImplicitSurface.from_contacts(contacts.append(center), **options)
    assert fewer.scale == more.scale
    before, after = (s.variance(queries) / (s.amplitude * s.scale) ** 2 for s in (fewer, more))
    assert (after <= before + 1e-9).all()


def test_singular_equations_are_refused() -> None:
    contacts = sphere_contacts(5)
    turned = Contacts(contacts.points, np.roll(contacts.normals, 1, axis=1))
    twice = contacts.append(turned)  # other normals at the same places
    with pytest.raises(EstimationError, match="raise misfit"):
        GaussianProcessImplicitSurface.from_contacts(twice, misfit=(0.0, 0.0))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("noise", [{}, {"position_noise": 0.001, "normal_noise": 0.05}])
@pytest.mark.parametrize("size", [1, 9])
def test_leave_group_out_predictions_equal_refitting_without_each_group(
    kernel: str, noise: dict[str, float], size: int
) -> None:
    contacts = sphere_contacts(25)
    surface = GaussianProcessImplicitSurface.from_contacts(contacts, kernel=kernel, **noise)
    groups = np.arange(len(contacts)) // size
    values, gradients = surface.leave_groups_out(groups)
    process = surface._process
    for group in np.unique(groups):
        left_out = groups == group
        refitted = GradientRegression.fit(
            process.kernel,
            process.nodes[~left_out],
            process.targets[~left_out],
            process.noise[~left_out],
        )
        nodes = process.nodes[left_out]
        expected = surface.scale * (surface.mean + refitted.mean.value(nodes))
        np.testing.assert_allclose(values[left_out], expected, atol=1e-10)
        np.testing.assert_allclose(gradients[left_out], refitted.mean.gradient(nodes), atol=1e-9)


def test_the_amplitude_is_that_of_standardised_residuals_of_left_out_places() -> None:
    contacts = sphere_contacts(20)
    beside = Contacts(contacts.points[:5] + 1e-4, contacts.normals[:5])
    surface = GaussianProcessImplicitSurface.from_contacts(contacts.append(beside))
    process, places = surface._process, ContactPlaces.of(surface.points)
    assert len(places.nodes) <= 20
    squares = []
    for place, node in enumerate(places.nodes):
        others = places.place != place
        kept = GradientRegression.fit(
            process.kernel, process.nodes[others], process.targets[others], process.noise[others]
        )
        alone = process.nodes[[node]]
        cross = gradient_covariance(process.kernel, np.vstack([alone, kept.nodes]))
        covariance = cross[:4, :4] + np.diag(process.noise[node])
        inverse = np.linalg.inv(cross[4:, 4:] + np.diag(kept.noise.ravel()))
        covariance -= cross[:4, 4:] @ inverse @ cross[4:, :4]
        mean = cross[:4, 4:] @ inverse @ kept.targets.ravel()
        residual = process.targets[node] - mean
        squares.append(residual @ np.linalg.inv(covariance) @ residual / 4.0)
    of_t = 1.0 + 2.0 / len(squares)  # variance of Student's t of so many degrees and 2
    assert surface.amplitude**2 == pytest.approx(of_t * np.mean(squares), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4, 6, 8])
def test_few_contacts_state_about_the_right_uncertainty(count: int) -> None:
    within = []
    for seed, name in enumerate(n for names in EVALUATION.values() for n in names[:4]):
        mesh = graspable_shape(name).mesh
        points, faces = trimesh.sample.sample_surface(mesh, 300, seed=seed)
        order, _ = farthest_point_order(points, count)
        contacts = Contacts(points, mesh.face_normals[faces]).subset(order)
        surface = BlendedImplicitSurface.from_contacts(
            contacts, position_noise=0.0005, normal_noise=0.05
        )
        estimate = extract_mesh(surface)
        nearest, distances, _ = trimesh.proximity.closest_point(estimate, points)
        within.append(distances < surface.uncertainty(nearest))
    # Of a normal distribution 68 %; here 58, 63, 73 and 73 %.
    assert 0.55 < np.mean(within) < 0.78


def test_repeated_contacts_hardly_lower_the_uncertainty_between_them() -> None:
    contacts = sphere_contacts(25)
    places = 0.05 * np.random.default_rng(5).normal(size=(40, 3))
    once = GaussianProcessImplicitSurface.from_contacts(contacts)
    for times in (2, 4):
        apart = 1e-9 * np.random.default_rng(6).normal(size=(times * len(contacts), 3))
        again = Contacts(
            np.tile(contacts.points, (times, 1)) + apart, np.tile(contacts.normals, (times, 1))
        )
        surface = GaussianProcessImplicitSurface.from_contacts(again)
        # Averaged noise lowers it a little; that repeated contacts predict each other does not.
        ratio = surface.uncertainty(places) / once.uncertainty(places)
        assert ratio.min() > 0.8
        assert ratio.max() < 1.05


@pytest.mark.parametrize("kernel", ["rbf", "matern52"])
def test_posterior_and_likelihood_equal_gpytorch_s(kernel: str) -> None:
    check_oracle(json.loads(ORACLE.read_text(encoding="utf-8")), kernel)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["rbf", "matern52"])
def test_posterior_and_likelihood_equal_the_installed_gpytorch_s(
    kernel: str, tmp_path: Path
) -> None:
    if find_spec("gpytorch") is None:  # not imported here: torch warns when it is
        pytest.skip("GPyTorch is not installed")
    output = tmp_path / "posterior.json"
    subprocess.run([sys.executable, ORACLE.with_suffix(".py"), output], check=True, timeout=300)
    check_oracle(json.loads(output.read_text(encoding="utf-8")), kernel)


def check_oracle(record: dict[str, Any], name: str) -> None:
    expected = record[name]
    normals, queries = np.array(record["normals"]), np.array(record["queries"])
    kernel = {"rbf": SquaredExponential, "matern52": Matern52}[name](expected["length"])
    noise = np.array([record["value_noise"], *[record["gradient_noise"]] * 3]) ** 2
    targets = np.column_stack([np.full(len(normals), -record["mean"]), normals])
    process = GradientRegression.fit(kernel, np.array(record["nodes"]), targets, noise)
    # Conditions of some 1e3 times rounding, in both.
    mean = record["mean"] + process.mean.value(queries)
    np.testing.assert_allclose(mean, expected["mean"], atol=1e-11)
    np.testing.assert_allclose(process.mean.gradient(queries), expected["gradient"], atol=1e-11)
    np.testing.assert_allclose(process.variance(queries), expected["variance"], atol=1e-11)
    best, count = process.likeliest_amplitude(), targets.size
    # Rasmussen and Williams 2006, eq. 5.8, at the likeliest amplitude.
    highest = -count * (np.log(best) + 0.5 * (1.0 + np.log(2.0 * np.pi)))
    highest -= np.log(np.diag(process.cholesky)).sum()
    for amplitude, likelihood in zip(
        record["amplitudes"], expected["log_likelihoods"], strict=True
    ):
        # -count log(a) - count best^2 / (2 a^2) + const has its maximum at a = best.
        ratio = best / amplitude
        below = count * (np.log(ratio) - 0.5 * (ratio**2 - 1.0))
        # GPyTorch keeps noise as its softplus' inverse, which rounds it to some 1e-13 of itself.
        assert highest + below == pytest.approx(likelihood, abs=1e-9)
