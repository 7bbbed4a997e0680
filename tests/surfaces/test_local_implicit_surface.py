"""Local implicit surfaces against literal loops over the equations, closed forms and laws."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from analytic_surfaces import differences
from random_directions import random_directions

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import LocalImplicitSurface

BETA_SIGNS = {"corrected": -1.0, "as_published": 1.0, "none": 0.0}


def scattered_contacts(count: int, seed: int = 0) -> Contacts:
    """Random contacts of no object: no term of the formulas vanishes by chance."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    points = 0.1 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    normals += 0.7 * rng.normal(size=(count, 3))
    return Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def cube_contacts(half: float = 0.05) -> Contacts:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    return Contacts(half * normals, normals)


def box_contacts(half: float = 0.06) -> Contacts:
    """Four contacts a face, at the middles of its quarters."""
    points, normals = [], []
    for normal in np.vstack([np.eye(3), -np.eye(3)]):
        across = np.eye(3)[np.abs(normal) < 0.5]
        for a in (-0.5, 0.5):
            for b in (-0.5, 0.5):
                points.append(half * (normal + a * across[0] + b * across[1]))
                normals.append(normal)
    return Contacts(np.array(points), np.array(normals))


def literal_values(surface: LocalImplicitSurface, beta: str, queries: np.ndarray) -> np.ndarray:
    arguments = (
        surface.points,
        surface.normals,
        np.exp(surface.mean.log_weights),
        surface.mean.sigma,
        BETA_SIGNS[beta],
    )
    return np.array([reference.local_implicit_surface(x, *arguments) for x in queries])


@pytest.mark.by_default("corrected", "none")
@pytest.mark.parametrize("beta", ["corrected", "as_published", "none"])
def test_equals_the_equations_term_by_term(beta: str) -> None:
    surface = LocalImplicitSurface.from_contacts(scattered_contacts(40), beta=beta, sigma=0.02)
    queries = np.random.default_rng(1).uniform(-0.15, 0.15, (10, 3))
    expected = literal_values(surface, beta, queries)
    # Terms below 1e-13 are left out; the largest values are some 0.1.
    np.testing.assert_allclose(surface.evaluate(queries), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.by_default("None", "0.25")
@pytest.mark.parametrize("factor", [0.2, 0.25, 1.0, None])
def test_equals_the_equations_at_any_kernel_width_and_straight_above(factor: float | None) -> None:
    contacts = cube_contacts() if factor is None else scattered_contacts(100, seed=4)
    options = {} if factor is None else {"sigma": factor * contacts.spacing}
    surface = LocalImplicitSurface.from_contacts(contacts, **options)
    queries = np.random.default_rng(1).uniform(-0.1, 0.1, (60 if factor is None else 3, 3))
    expected = literal_values(surface, "corrected", queries)
    np.testing.assert_allclose(surface.evaluate(queries), expected, rtol=1e-9, atol=1e-12)


def test_density_weights_equal_their_formula() -> None:
    surface = LocalImplicitSurface.from_contacts(scattered_contacts(40), sigma=0.03)
    expected = [
        reference.density_weight(i, surface.points, surface.mean.sigma)
        for i in range(len(surface.points))
    ]
    # The kernel is cut at 8 sigma, exp(-32) = 1e-14.
    np.testing.assert_allclose(np.exp(surface.mean.log_weights), expected, rtol=1e-12)


def test_coinciding_contacts_with_different_normals_have_one_weight_together() -> None:
    contacts = box_contacts()
    twice = contacts.append(Contacts(contacts.points[:1], np.array([[0.0, 1.0, 0.0]])))
    single = LocalImplicitSurface.from_contacts(contacts).mean.log_weights[0]
    double = LocalImplicitSurface.from_contacts(twice).mean.log_weights
    assert len(double) == len(contacts) + 1
    # Neighbours three sigma away and further enter the density with exp(-8) and less.
    assert np.exp(double[[0, -1]]).sum() == pytest.approx(np.exp(single), rel=1e-3)


@pytest.mark.parametrize("beta", ["corrected", "as_published", "none"])
def test_gradient_equals_differences_of_values(beta: str) -> None:
    surface = LocalImplicitSurface.from_contacts(scattered_contacts(40), beta=beta, sigma=0.03)
    queries = np.random.default_rng(2).uniform(-0.12, 0.12, (200, 3))
    expected = differences(surface, queries, 1e-7)
    # Narrow angular kernels make second derivatives of some 1e5 / m in places: compare where the
    # function is smooth on the scale of the step, which is nearly everywhere.
    error = np.linalg.norm(surface.gradient(queries) - expected, axis=1)
    scale = 1.0 + np.linalg.norm(expected, axis=1)
    assert np.mean(error < 1e-5 * scale) > 0.97


def test_one_contact_is_its_plane_exactly() -> None:
    normal = np.array([1.0, 2.0, -2.0]) / 3.0
    point = np.array([0.1, 0.2, 0.3])
    surface = LocalImplicitSurface.from_contacts(Contacts([point], [normal]))
    queries = np.random.default_rng(1).uniform(-5, 5, (100, 3))
    np.testing.assert_allclose(surface.evaluate(queries), (queries - point) @ normal, atol=1e-14)
    np.testing.assert_allclose(surface.gradient(queries), np.tile(normal, (100, 1)), atol=1e-14)


@pytest.mark.parametrize("beta", ["corrected", "as_published", "none"])
def test_coplanar_contacts_are_their_plane_exactly(beta: str) -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (20, 2)), np.zeros(20)])
    contacts = Contacts(points, np.tile([0.0, 0.0, 1.0], (20, 1)))
    surface = LocalImplicitSurface.from_contacts(contacts, beta=beta)
    queries = rng.uniform(-0.3, 0.3, (200, 3))
    np.testing.assert_allclose(surface.evaluate(queries), queries[:, 2], atol=1e-14)


def test_two_contacts_make_the_exact_sharp_edge() -> None:
    # Planes x = 0 and z = 0 of an edge along y, each touched 50 mm from it.
    contacts = Contacts([[0.0, 0.0, -0.05], [-0.05, 0.0, 0.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    surface = LocalImplicitSurface.from_contacts(contacts)
    along = np.linspace(-0.1, 0.0, 51)
    near_edge = np.array([[x, 0.0, 0.0] for x in along] + [[0.0, 0.0, x] for x in along])
    # beta* is clamped to -0.98, so that the other plane keeps a weight of 1 - 0.98 of 1.98 here,
    # where it lies inside by at most 0.1.
    assert np.abs(surface.evaluate(near_edge)).max() <= 0.1 * 0.02
    # By symmetry the two planes weigh the same on the bisector: the edge itself is exact.
    assert surface.evaluate([0.0, 0.0, 0.0]) == pytest.approx(0.0, abs=1e-15)
    inside = np.array([[-0.002, 0.0, -0.002], [-0.03, 0.0, -0.003]])
    outside = np.array([[0.002, 0.0, 0.002], [-0.03, 0.0, 0.003], [0.002, 0.0, -0.002]])
    assert (surface.evaluate(inside) < 0).all()
    assert (surface.evaluate(outside) > 0).all()


def volume_difference(surface: LocalImplicitSurface, half: float) -> float:
    """Volume of the places where the estimate and the cube disagree, over the cube's volume."""
    axis = (np.arange(30) + 0.5) / 30 * 3 * half - 1.5 * half
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    cube = np.abs(grid).max(axis=-1) < half
    return float(((surface.evaluate(grid) < 0) != cube).sum() / cube.sum())


def test_six_contacts_make_a_cube_except_with_the_published_sign() -> None:
    error = {
        beta: volume_difference(
            LocalImplicitSurface.from_contacts(cube_contacts(), beta=beta), 0.05
        )
        for beta in BETA_SIGNS
    }
    assert error["corrected"] == error["none"] == 0.0
    assert error["as_published"] > 0.3


@pytest.mark.by_default("0.25", "0.15")
@pytest.mark.parametrize("factor", [0.15, 0.25, 0.4])
def test_a_cube_of_four_contacts_a_face_is_exact_at_any_kernel_width(factor: float) -> None:
    contacts = box_contacts(0.06)
    surface = LocalImplicitSurface.from_contacts(contacts, sigma=factor * contacts.spacing)
    assert volume_difference(surface, 0.06) == 0.0


def test_values_are_finite_and_right_however_far_away() -> None:
    surface = LocalImplicitSurface.from_contacts(box_contacts())
    directions = random_directions(50, np.random.default_rng(1))
    for distance in (1.0, 1e3, 1e6):
        values = surface.evaluate(distance * directions)
        assert np.isfinite(values).all()
        assert (values > 0).all()
        assert np.isfinite(surface.gradient(distance * directions)).all()


def test_a_value_does_not_depend_on_what_else_is_asked() -> None:
    surface = LocalImplicitSurface.from_contacts(scattered_contacts(60))
    queries = np.random.default_rng(1).uniform(-0.2, 0.2, (5000, 3))
    together = surface.evaluate(queries)
    alone = np.array([surface.evaluate(x) for x in queries[:40]])
    np.testing.assert_allclose(together[:40], alone, rtol=1e-9, atol=1e-13)


def test_uncertainty_is_the_sensor_s_at_contacts_and_grows_away_from_them() -> None:
    contacts = box_contacts()
    surface = LocalImplicitSurface.from_contacts(contacts, position_noise=0.001, normal_noise=0.1)
    np.testing.assert_allclose(surface.uncertainty(contacts.points), 0.001)
    away = contacts.points[0] + np.linspace(0.0, 0.2, 30)[:, None] * contacts.normals[0]
    assert (np.diff(surface.uncertainty(away)) > 0).all()
    assert LocalImplicitSurface.from_contacts(contacts).uncertainty(contacts.points[0]) == 0.0


@pytest.mark.parametrize("distance", [0.002, 0.03])
def test_uncertainty_is_the_root_sum_of_squares_of_noise_and_extrapolation(
    distance: float,
) -> None:
    contacts = Contacts([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], [[0.0, 0.0, 1.0]] * 2)
    surface = LocalImplicitSurface.from_contacts(contacts, position_noise=0.001, normal_noise=0.2)
    expected = np.hypot(np.hypot(0.001, 0.2 * distance), 0.27 * distance**2 / 0.1)
    points = np.array([[[0.0, 0.0, distance]], [[0.1, 0.0, -distance]]])
    np.testing.assert_allclose(surface.uncertainty(points), [[expected]] * 2, rtol=1e-12)


def test_bounds_are_the_contacts_box_grown_by_one_spacing() -> None:
    contacts = box_contacts()
    surface = LocalImplicitSurface.from_contacts(contacts)
    np.testing.assert_allclose(surface.bounds[0], contacts.points.min(axis=0) - contacts.spacing)
    np.testing.assert_allclose(surface.bounds[1], contacts.points.max(axis=0) + contacts.spacing)
