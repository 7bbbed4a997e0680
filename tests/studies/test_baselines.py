"""Baselines: their guarantees, and the ImplicitSurface protocol."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, LisGraspError
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp_studies.baselines import BASELINES
from lis_grasp_studies.paper.trials import walk_surface

every_baseline = pytest.mark.parametrize("name", BASELINES)


@pytest.fixture(scope="module")
def ball() -> Contacts:
    """Contacts spread over a sphere of 50 mm."""
    index = np.arange(60)
    z = 1.0 - (2.0 * index + 1.0) / 60
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z**2)
    normals = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    return Contacts(0.05 * normals, normals)


@every_baseline
def test_a_baseline_is_an_implicit_surface_of_a_ball(name: str, ball: Contacts) -> None:
    surface = BASELINES[name](ball)
    assert isinstance(surface, ImplicitSurface)
    directions = ball.normals[::7]
    assert surface.evaluate(np.zeros(3)) < 0.0
    assert (surface.evaluate(0.065 * directions) > 0.0).all()
    between = directions @ Rotation.from_euler("xyz", [0.1, 0.05, 0.02]).as_matrix().T
    radii = np.linspace(0.04, 0.06, 201)
    values = surface.evaluate(radii[:, None, None] * between)  # (R, D)
    found = radii[np.argmax(values > 0.0, axis=0)]
    np.testing.assert_allclose(found, 0.05, atol=1e-3)  # between contacts the sagitta is 0.5 mm
    assert (surface.uncertainty(0.05 * between) >= 0.0).all()
    assert surface.gradient(np.zeros((2, 0, 3))).shape == (2, 0, 3)


def test_hermite_interpolates_values_and_gradients_exactly() -> None:
    contacts = walk_surface(shapes.build("mallet", 0.2), rng=np.random.default_rng(0)).contacts
    surface = BASELINES["hermite_rbf"](contacts)
    # Conditioned at about 1e6 in coordinates of unit size.
    np.testing.assert_allclose(surface.evaluate(contacts.points), 0.0, atol=1e-9)
    np.testing.assert_allclose(surface.gradient(contacts.points), contacts.normals, atol=1e-7)


@every_baseline
def test_a_plane_is_reproduced(name: str) -> None:
    rng = np.random.default_rng(1)
    normal = np.array([0.6, 0.0, 0.8])
    spread = rng.uniform(-0.05, 0.05, (20, 3))
    points = spread - (spread @ normal)[:, None] * normal
    surface = BASELINES[name](Contacts(points, np.tile(normal, (20, 1))))
    queries = rng.uniform(-0.06, 0.06, (100, 3))
    np.testing.assert_allclose(surface.evaluate(queries), queries @ normal, atol=1e-8)


@every_baseline
def test_moving_and_scaling_the_object_moves_and_scales_the_surface(
    name: str, ball: Contacts
) -> None:
    rotation = Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix()
    factor, shift = 3.0, np.array([0.4, -0.2, 1.0])
    moved = Contacts(factor * ball.points @ rotation.T + shift, ball.normals @ rotation.T)
    queries = np.random.default_rng(2).uniform(-0.07, 0.07, (200, 3))
    here, there = BASELINES[name](ball), BASELINES[name](moved)
    at = factor * queries @ rotation.T + shift
    np.testing.assert_allclose(there.evaluate(at), factor * here.evaluate(queries), atol=1e-6)
    np.testing.assert_allclose(there.uncertainty(at), factor * here.uncertainty(queries), atol=1e-9)


def test_hermite_gradient_equals_differences(ball: Contacts) -> None:
    surface = BASELINES["hermite_rbf"](ball)
    queries = np.random.default_rng(3).uniform(-0.07, 0.07, (50, 3))
    step = 1e-5
    differences = [
        (surface.evaluate(queries + s) - surface.evaluate(queries - s)) / (2.0 * step)
        for s in step * np.eye(3)
    ]
    # Third derivatives of r^3 at this size, times the step squared, and rounding over the step.
    np.testing.assert_allclose(surface.gradient(queries), np.stack(differences, -1), atol=1e-5)


@every_baseline
@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_contacts_give_finite_values_or_an_error(name: str, count: int, ball: Contacts) -> None:
    queries = np.random.default_rng(4).uniform(-0.07, 0.07, (50, 3))
    try:
        surface = BASELINES[name](ball.subset(slice(0, count)))
    except LisGraspError:
        return
    assert np.isfinite(surface.evaluate(queries)).all()
    assert np.isfinite(surface.gradient(queries)).all()


@every_baseline
def test_repeated_contacts_count_once(name: str, ball: Contacts) -> None:
    once, twice = BASELINES[name](ball), BASELINES[name](ball.append(ball.subset(slice(0, 9))))
    queries = np.random.default_rng(5).uniform(-0.06, 0.06, (50, 3))
    np.testing.assert_allclose(twice.evaluate(queries), once.evaluate(queries), atol=1e-7)


@every_baseline
def test_no_contacts_are_refused(name: str) -> None:
    with pytest.raises(InvalidContactsError):
        BASELINES[name](Contacts.empty())
