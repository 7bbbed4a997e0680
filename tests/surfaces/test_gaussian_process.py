"""The Gaussian process baseline against dense algebra on kernel values alone, and its limits."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError, InvalidContactsError, InvalidOptionError
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.surfaces.contact_merging import LONE_CONTACT_SPACING
from lis_grasp.surfaces.gaussian_process_regression import GradientRegression
from lis_grasp.surfaces.gaussian_process_selection import choose_length
from lis_grasp.surfaces.kernels import Matern52, RadialKernel, SquaredExponential, ThinPlate

KERNELS = ["rbf", "matern52", "thin_plate"]
ORACLE = Path(__file__).parents[1] / "oracles" / "gpytorch_posterior.json"


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
        misfit=(1e-7, 1e-6),
    )  # fmt: skip
    np.testing.assert_allclose(surface.evaluate(contacts.points), 0.0, atol=1e-6)
    np.testing.assert_allclose(surface.gradient(contacts.points), contacts.normals, atol=1e-4)
    np.testing.assert_allclose(surface.uncertainty(contacts.points), 0.0, atol=1e-6)


def test_misfit_of_one_contact_shrinks_its_pull_as_the_closed_form_says() -> None:
    # One contact: the slope is uncorrelated with the value at the same place, so that the mean at
    # the contact is m - m k / (k + misfit^2) with k = 1.
    contact = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    surface = GaussianProcessImplicitSurface.from_contacts(
        contact, prior_mean=0.1, misfit=(0.5, 0.1), length=0.1
    )
    expected = 0.1 - 0.1 / (1.0 + 0.5**2)
    assert surface.evaluate([0.0, 0.0, 0.0]) == pytest.approx(expected, rel=1e-12)


def test_told_noise_of_one_contact_shrinks_its_pull_by_the_prior_that_scatters_as_told() -> None:
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


def test_told_noise_far_below_the_misfit_changes_nothing() -> None:
    contacts, queries = sphere_contacts(20), sphere_contacts(9, radius=0.06, seed=4).points
    plain = GaussianProcessImplicitSurface.from_contacts(contacts)
    told = GaussianProcessImplicitSurface.from_contacts(
        contacts, position_noise=1e-12, normal_noise=1e-10
    )
    # Variances of noise are (1e-10 / 1e-3)^2 of the misfit's or less.
    np.testing.assert_allclose(told.evaluate(queries), plain.evaluate(queries), atol=1e-12)
    np.testing.assert_allclose(told.uncertainty(queries), plain.uncertainty(queries), rtol=1e-6)


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
    options = {"length": 0.05}
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
    with pytest.raises(EstimationError, match="raise misfit"):
        GaussianProcessImplicitSurface.from_contacts(twice, misfit=(0.0, 0.0))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("told", [{}, {"position_noise": 0.001, "normal_noise": 0.05}])
def test_leave_one_out_equals_refitting_without_each_contact(
    kernel: str, told: dict[str, float]
) -> None:
    contacts = sphere_contacts(25)
    surface = GaussianProcessImplicitSurface.from_contacts(contacts, kernel=kernel, **told)
    values, gradients = surface.leave_one_out()
    process = surface._process
    for i in range(len(contacts)):
        others = np.arange(len(contacts)) != i
        refitted = GradientRegression.fit(
            process.kernel, process.nodes[others], process.targets[others], process.noise
        )
        left_out = process.nodes[i : i + 1]
        value = surface.scale * (surface.mean + refitted.mean(left_out)[0])
        # Conditions of some 1e5 times rounding.
        assert values[i] == pytest.approx(value, abs=1e-10)
        np.testing.assert_allclose(gradients[i], refitted.mean_gradient(left_out)[0], atol=1e-9)


def test_leave_one_out_covariance_is_the_posterior_of_the_value_plus_its_noise() -> None:
    process = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(20))._process
    _, covariances = process.leave_one_out()
    others = np.arange(20) != 7
    refitted = GradientRegression.fit(
        process.kernel, process.nodes[others], process.targets[others], process.noise
    )
    expected = refitted.variance(process.nodes[7:8])[0] + process.noise[0]
    assert covariances[7, 0, 0] == pytest.approx(expected, rel=1e-9)


def test_the_variance_is_scaled_by_what_leaving_out_contacts_shows() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(20))
    means, covariances = surface._process.leave_one_out()
    residuals = surface._process.targets - means
    squares = [r @ np.linalg.inv(c) @ r / 4.0 for r, c in zip(residuals, covariances, strict=True)]
    assert surface.amplitude**2 == pytest.approx(np.mean(squares), rel=1e-9)


def test_touching_every_place_again_makes_nothing_sure_that_lies_between() -> None:
    contacts = sphere_contacts(25)
    places = 0.05 * np.random.default_rng(5).normal(size=(40, 3))
    once = GaussianProcessImplicitSurface.from_contacts(contacts)
    for times in (2, 4):
        again = Contacts(
            np.tile(contacts.points, (times, 1)), np.tile(contacts.normals, (times, 1))
        )
        surface = GaussianProcessImplicitSurface.from_contacts(again)
        # Averaged noise makes it a little surer; that twins foretell each other does not.
        ratio = surface.uncertainty(places) / once.uncertainty(places)
        assert ratio.min() > 0.8
        assert ratio.max() < 1.05


def test_a_lone_contact_is_foretold_by_the_prior_mean_alone() -> None:
    contact = Contacts([[0.1, 0.2, 0.3]], [[0.0, 0.0, 1.0]])
    surface = GaussianProcessImplicitSurface.from_contacts(contact, prior_mean=0.07)
    values, gradients = surface.leave_one_out()
    assert values[0] == pytest.approx(0.07, rel=1e-9)
    np.testing.assert_allclose(gradients, 0.0, atol=1e-12)


def test_both_criteria_are_sums_of_normal_log_densities() -> None:
    process = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(8))._process
    matrix = process.cholesky @ process.cholesky.T
    amplitude = process.likeliest_amplitude()
    expected = normal_log_density(process.targets.reshape(-1), amplitude**2 * matrix)
    assert process.log_marginal_likelihood() == pytest.approx(expected, rel=1e-10)
    for factor in (0.9, 1.1):  # and that amplitude is the best
        other = normal_log_density(process.targets.reshape(-1), (factor * amplitude) ** 2 * matrix)
        assert other < expected

    # Conditional densities from scratch: the mean and covariance of one block given the others.
    amplitude, expected = process.leave_one_out_amplitude(), 0.0
    rows = np.arange(len(matrix))
    for i in range(8):
        out, rest = rows // 4 == i, rows // 4 != i
        pull = matrix[np.ix_(out, rest)] @ np.linalg.inv(matrix[np.ix_(rest, rest)])
        mean = pull @ process.targets.reshape(-1)[rest]
        covariance = matrix[np.ix_(out, out)] - pull @ matrix[np.ix_(rest, out)]
        expected += normal_log_density(process.targets[i] - mean, amplitude**2 * covariance)
    assert process.leave_one_out_log_density() == pytest.approx(expected, rel=1e-9)


def normal_log_density(residuals: np.ndarray, covariance: np.ndarray) -> float:
    _, log_determinant = np.linalg.slogdet(2.0 * np.pi * covariance)
    return float(-0.5 * (residuals @ np.linalg.solve(covariance, residuals) + log_determinant))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("told", [{}, {"position_noise": 0.001, "normal_noise": 0.05}])
def test_contacts_added_later_equal_a_fit_of_all_with_the_same_options(
    kernel: str, told: dict[str, float]
) -> None:
    contacts = sphere_contacts(30)
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (50, 3))
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts.subset(slice(12)), kernel=kernel, length=0.3 if kernel == "thin_plate" else None,
        margin=0.02, **told,
    )  # fmt: skip
    for part in (slice(12, 13), slice(13, 20), slice(20, 30)):
        surface = surface.with_contacts(contacts.subset(part))
    process = surface._process
    at_once = GradientRegression.fit(
        process.kernel,
        (contacts.points - surface.center) / surface.scale,
        np.column_stack([np.full(30, -surface.mean), contacts.normals]),
        process.noise,
    )
    scaled = (queries - surface.center) / surface.scale
    # Conditions of some 1e6 times rounding.
    np.testing.assert_allclose(process.mean(scaled), at_once.mean(scaled), atol=1e-9)
    np.testing.assert_allclose(process.variance(scaled), at_once.variance(scaled), atol=1e-9)
    np.testing.assert_array_equal(surface.points, contacts.points)
    np.testing.assert_array_equal(surface.normals, contacts.normals)
    expected = contacts.bounds + [[-0.02], [0.02]]
    np.testing.assert_allclose(surface.bounds, expected, rtol=1e-12)


def test_contacts_added_inside_equal_a_new_estimate() -> None:
    contacts = sphere_contacts(20)
    inner = Contacts([[0.0, 0.0, 0.01], [0.01, 0.0, 0.0]], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    added = GaussianProcessImplicitSurface.from_contacts(contacts).with_contacts(inner)
    anew = GaussianProcessImplicitSurface.from_contacts(contacts.append(inner))
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (50, 3))
    np.testing.assert_allclose(added.evaluate(queries), anew.evaluate(queries), atol=1e-10)
    variances = [s.variance(queries) / s.amplitude**2 for s in (added, anew)]
    np.testing.assert_allclose(*variances, atol=1e-10)


def test_no_contacts_added_change_nothing() -> None:
    surface = GaussianProcessImplicitSurface.from_contacts(sphere_contacts(9))
    same = surface.with_contacts(Contacts.empty())
    queries = sphere_contacts(9, seed=5).points
    np.testing.assert_allclose(same.evaluate(queries), surface.evaluate(queries), atol=1e-12)


@pytest.mark.parametrize("criterion", ["likelihood", "leave_one_out"])
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_chosen_length_is_better_than_any_of_a_fine_grid(kernel: str, criterion: str) -> None:
    contacts = sphere_contacts(25)

    def score(length: float | str | None) -> tuple[float, float]:
        surface = GaussianProcessImplicitSurface.from_contacts(
            contacts, kernel=kernel, length=length
        )
        value = (
            surface.log_marginal_likelihood()
            if criterion == "likelihood"
            else surface.leave_one_out_log_density()
        )
        return value, surface.kernel.length * surface.scale

    best, _ = score(criterion)
    _, default = score(None)
    least = 0.9 if kernel == "thin_plate" else 0.25
    # The search stops within 1e-4 of the best logarithm, or of the end of the range.
    grid = [score(default * factor)[0] for factor in np.geomspace(least * 1.001, 4.0 / 1.001, 60)]
    assert best > max(grid) - 0.1


@pytest.mark.parametrize("criterion", ["likelihood", "leave_one_out"])
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("case", ["one", "three", "plane", "twice", "noise"])
def test_a_length_is_found_for_few_flat_doubled_and_noisy_contacts(
    kernel: str, criterion: str, case: str
) -> None:
    rng = np.random.default_rng(1)
    contacts = sphere_contacts({"one": 1, "three": 3}.get(case, 12))
    if case == "plane":
        points = np.column_stack([rng.uniform(-0.1, 0.1, (12, 2)), np.zeros(12)])
        contacts = Contacts(points, np.tile([0.0, 0.0, 1.0], (12, 1)))
    if case == "twice":
        contacts = contacts.append(contacts)
    told = {"position_noise": 0.002, "normal_noise": 0.1} if case == "noise" else {}
    surface = GaussianProcessImplicitSurface.from_contacts(
        contacts, kernel=kernel, length=criterion, **told
    )
    assert np.isfinite(surface.evaluate(contacts.points)).all()
    assert np.isfinite(surface.uncertainty(contacts.points)).all()


def test_where_every_length_is_singular_the_default_stays() -> None:
    def fit(length: float) -> GradientRegression:
        raise EstimationError("singular")

    assert choose_length(fit, "likelihood", 0.7, (0.5, 2.0)) == 0.7


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
    mean = record["mean"] + process.mean(queries)
    np.testing.assert_allclose(mean, expected["mean"], atol=1e-11)
    np.testing.assert_allclose(process.mean_gradient(queries), expected["gradient"], atol=1e-11)
    np.testing.assert_allclose(process.variance(queries), expected["variance"], atol=1e-11)
    best, count = process.likeliest_amplitude(), targets.size
    for amplitude, likelihood in zip(
        record["amplitudes"], expected["log_likelihoods"], strict=True
    ):
        # -count log(a) - count best^2 / (2 a^2) + const has its maximum at a = best.
        ratio = best / amplitude
        below = count * (np.log(ratio) - 0.5 * (ratio**2 - 1.0))
        # GPyTorch keeps noise as its softplus' inverse, which rounds it to some 1e-13 of itself.
        assert process.log_marginal_likelihood() + below == pytest.approx(likelihood, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kernel": "cubic"}, "kernel must be one of rbf, matern52, thin_plate"),
        ({"length": 0.0}, "length must be above 0"),
        ({"length": "guess"}, "length must be one of likelihood, leave_one_out"),
        ({"misfit": (0.0, -0.1)}, "misfit must be at least 0"),
        ({"position_noise": -1.0}, "position_noise must be at least 0"),
        ({"normal_noise": float("nan")}, "normal_noise must be at least 0"),
        ({"prior_mean": -0.1}, "prior_mean must be above 0"),
        ({"margin": -0.1}, "margin must be at least 0"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidOptionError, match=message):
        GaussianProcessImplicitSurface.from_contacts(sphere_contacts(5), **options)
