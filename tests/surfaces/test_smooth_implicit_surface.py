"""The smooth estimate: what free gradient lengths and stretched kernels are for, and its guard."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from analytic_surfaces import differences
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    SmoothImplicitSurface,
)
from lis_grasp.surfaces._gaussian_process_regression import GradientRegression
from lis_grasp.surfaces._kernels import Matern72


def ellipsoid_contacts(axes: tuple[float, ...], count: int, seed: int = 0) -> Contacts:
    directions = random_directions(count, np.random.default_rng(seed))
    normals = directions / np.array(axes)
    return Contacts(directions * axes, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def distance_of_zero_set(surface: object, axes: tuple[float, ...]) -> float:
    """Return the root mean square distance of the true ellipsoid, to first order [m]."""
    points = random_directions(400, np.random.default_rng(9)) * axes
    slopes = np.linalg.norm(surface.gradient(points), axis=1)
    return float(np.sqrt(np.mean((surface.evaluate(points) / slopes) ** 2)))


def test_the_gradient_of_one_contact_has_the_length_of_the_closed_form() -> None:
    # The slope at a contact is uncorrelated with its value: prior variance k_1 = 7 / (5 length^2),
    # observed as 1 with variance misfit^2 + l^2 along the normal and misfit^2 across.
    length, misfit, free = 0.8, 0.1, 0.7
    normal = np.array([0.6, 0.0, 0.8])
    process = GradientRegression.fit(
        Matern72(length), np.zeros((1, 3)), np.array([[-1.0, *normal]]),
        np.array([0.001, misfit, misfit, misfit]) ** 2, length_noise=free,
    )  # fmt: skip
    prior = 7.0 / (5.0 * length**2)
    expected = prior / (prior + misfit**2 + free**2) * normal
    np.testing.assert_allclose(process.mean.gradient(np.zeros((1, 3)))[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("axes", "count"), [((0.05, 0.05, 0.05), 12), ((0.1, 0.05, 0.03), 20), ((0.1, 0.04, 0.04), 40)]
)
def test_an_ellipsoid_is_at_least_a_third_closer_than_by_gpis(
    axes: tuple[float, ...], count: int
) -> None:
    contacts = ellipsoid_contacts(axes, count)
    ours, theirs = (
        distance_of_zero_set(estimate.from_contacts(contacts), axes)
        for estimate in (SmoothImplicitSurface, GaussianProcessImplicitSurface)
    )
    assert ours < theirs / 1.5


def test_the_kernel_is_stretched_where_that_predicts_better() -> None:
    long = SmoothImplicitSurface.from_contacts(ellipsoid_contacts((0.1, 0.03, 0.03), 40))
    # In its own coordinates the ellipsoid is a ball: the eigenvalues are the ratios of its axes,
    # to the scatter of moments of 40 places.
    np.testing.assert_allclose(
        np.linalg.eigvalsh(long.free.squeeze), [1.0, 10 / 3, 10 / 3], rtol=0.25
    )


def test_the_gradient_equals_differences_of_values_where_both_processes_mix() -> None:
    surface = SmoothImplicitSurface.from_contacts(ellipsoid_contacts((0.1, 0.04, 0.03), 25))
    points = np.random.default_rng(2).uniform(-0.12, 0.12, (400, 3))
    apart = np.abs(surface.free.evaluate(points) - surface.bound.evaluate(points))
    mixed = (apart > 0.25 * surface.spacing) & (apart < 0.5 * surface.spacing)
    assert mixed.sum() > 20
    # Truncation step^2 f''' / 6 with f''' of some 1e6 / m^2 in v, rounding 1e-16 / step.
    expected = differences(surface, points, 1e-6)
    np.testing.assert_allclose(surface.gradient(points), expected, atol=1e-5)


def test_far_from_every_contact_is_outside() -> None:
    surface = SmoothImplicitSurface.from_contacts(ellipsoid_contacts((0.1, 0.04, 0.03), 12))
    for distance in (0.3, 1.0, 30.0):
        directions = random_directions(50, np.random.default_rng(1))
        assert (surface.evaluate(distance * directions) > 0.0).all()


def test_the_estimate_is_gpis_where_that_predicts_left_out_places_better() -> None:
    smooth = SmoothImplicitSurface.from_contacts(ellipsoid_contacts((0.1, 0.05, 0.04), 30))
    assert smooth.free is not smooth.bound
    torus, rng = shapes.build("torus", 0.2).mesh, np.random.default_rng(0)
    exact, faces = trimesh.sample.sample_surface(torus, 30, seed=0)
    normals = torus.face_normals[faces] + rng.normal(0.0, 0.1, (30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    contacts = Contacts(exact + rng.normal(0.0, 0.003, (30, 3)), normals)
    noise = {"position_noise": 0.003, "normal_noise": 0.1}
    surface = SmoothImplicitSurface.from_contacts(contacts, **noise)
    plain = GaussianProcessImplicitSurface.from_contacts(contacts, **noise)
    points = rng.uniform(-0.15, 0.15, (50, 3))
    np.testing.assert_array_equal(surface.evaluate(points), plain.evaluate(points))
    np.testing.assert_array_equal(surface.uncertainty(points), plain.uncertainty(points))


def test_the_uncertainty_covers_the_difference_of_the_processes_and_is_never_zero() -> None:
    contacts = ellipsoid_contacts((0.1, 0.04, 0.03), 60)
    surface = SmoothImplicitSurface.from_contacts(contacts)
    points = np.vstack([contacts.points, ellipsoid_contacts((0.1, 0.04, 0.03), 50, seed=1).points])
    apart = surface.free.evaluate(points) - surface.bound.evaluate(points)
    least = 0.0003 * max(np.linalg.norm(a - b) for a in contacts.points for b in contacts.points)
    expected = np.sqrt(surface.free.uncertainty(points) ** 2 + (0.35 * apart) ** 2)
    np.testing.assert_allclose(surface.uncertainty(points), expected, rtol=1e-12)
    assert surface.uncertainty(points).min() >= least


@pytest.mark.parametrize("estimate", [SmoothImplicitSurface, BlendedImplicitSurface])
def test_a_plate_touched_on_both_sides_keeps_its_thickness(estimate: type) -> None:
    thickness = 0.004
    places = np.random.default_rng(3).uniform(-1.0, 1.0, (30, 2)) * (0.05, 0.04)
    sides = np.where(np.arange(30) % 2, 1.0, -1.0)
    normals = np.column_stack([np.zeros((30, 2)), sides])
    contacts = Contacts(np.column_stack([places, 0.5 * thickness * sides]), normals)
    surface = estimate.from_contacts(contacts)
    across = np.linspace(-thickness, thickness, 81)
    inner = places[np.abs(places).max(axis=1) < 0.035]  # the plate's rim was not touched
    columns = np.empty((len(inner), len(across), 3))
    columns[..., :2], columns[..., 2] = inner[:, None], across
    found = (surface.evaluate(columns) < 0.0).mean(axis=1) * 2.0 * thickness
    # One step of the ray, 2.5 % of the thickness, at either side.
    np.testing.assert_allclose(found, thickness, rtol=0.05)
