"""The blend of a sharp and a smooth estimate: its weights, and that it is their mean."""

from __future__ import annotations

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    PatchImplicitSurface,
)


def touched_shape(name: str, spacing: float = 0.045, seed: int = 1) -> Contacts:
    """Return centres of a shape's triangles, at least `spacing` apart, in random order."""
    shape = shapes.build(name, 0.2)
    points, normals = shape.mesh.triangles_center, shape.mesh.face_normals
    kept: list[int] = []
    for i in np.random.default_rng(seed).permutation(len(points)):
        if all(np.linalg.norm(points[i] - points[j]) >= spacing for j in kept):
            kept.append(int(i))
    return Contacts(points[kept], normals[kept])


def sharpness(surface: BlendedImplicitSurface, points: np.ndarray) -> np.ndarray:
    return surface._weights(points, with_gradient=False)[0]


def test_a_torus_is_no_solid_with_edges() -> None:
    contacts = touched_shape("torus")
    points = shapes.build("torus", 0.2).mesh.vertices[::20]
    error = [
        np.sqrt(np.mean(estimate.from_contacts(contacts).evaluate(points) ** 2))
        for estimate in (BlendedImplicitSurface, PatchImplicitSurface)
    ]
    assert error[0] < 0.4 * error[1]


@pytest.mark.parametrize("name", ["box", "pentagon", "cylinder"])
def test_edges_stay_those_of_the_sharp_estimate(name: str) -> None:
    surface = BlendedImplicitSurface.from_contacts(touched_shape(name))
    edges = shapes.build(name, 0.2).edges.mean(axis=1)
    assert sharpness(surface, edges).min() > 0.9


def test_a_value_lies_between_both_estimates_with_the_weight_it_states() -> None:
    surface = BlendedImplicitSurface.from_contacts(touched_shape("mallet", 0.04))
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (300, 3))
    weight = sharpness(surface, points)
    assert surface.smooth is not None
    sharp, smooth = surface.sharp.evaluate(points), surface.smooth.evaluate(points)
    np.testing.assert_allclose(
        surface.evaluate(points), weight * sharp + (1 - weight) * smooth, atol=1e-14
    )
    # The law of total variance.
    variance = weight * surface.sharp.uncertainty(points) ** 2
    variance += (1 - weight) * surface.smooth.uncertainty(points) ** 2
    variance += weight * (1 - weight) * (sharp - smooth) ** 2
    np.testing.assert_allclose(surface.uncertainty(points), np.sqrt(variance), rtol=1e-9)


def test_gradient_equals_differences_of_values() -> None:
    surface = BlendedImplicitSurface.from_contacts(touched_shape("half_cylinder"))
    points = np.random.default_rng(2).uniform(-0.1, 0.1, (300, 3))
    step = 1e-6
    differences = np.stack(
        [
            (surface.evaluate(points + m) - surface.evaluate(points - m)) / (2 * step)
            for m in step * np.eye(3)
        ],
        axis=-1,
    )
    error = np.linalg.norm(surface.gradient(points) - differences, axis=1)
    # A step of 1e-6 m meets a kink of the sharp estimate once in some hundred queries.
    assert np.mean(error < 1e-4) > 0.97


@pytest.mark.parametrize("count", [1, 5, 7])
def test_few_contacts_have_the_sharp_estimate_alone(count: int) -> None:
    contacts = touched_shape("box").subset(slice(0, count))
    surface = BlendedImplicitSurface.from_contacts(contacts)
    assert surface.smooth is None
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 3))
    sharp = PatchImplicitSurface.from_contacts(contacts)
    np.testing.assert_array_equal(surface.evaluate(points), sharp.evaluate(points))
    np.testing.assert_array_equal(surface.uncertainty(points), sharp.uncertainty(points))


def test_the_order_of_equally_far_contacts_does_not_matter() -> None:
    half = np.random.default_rng(0).normal(size=(14, 3))
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    normals = np.vstack([half, -half])
    places = shapes.build("sphere", 0.2).mesh.vertices[::7]
    values = []
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(normals))
        surface = BlendedImplicitSurface.from_contacts(
            Contacts(0.1 * normals[order], normals[order])
        )
        values.append(surface.evaluate(places))
    np.testing.assert_allclose(values[1:], [values[0]] * 2, atol=1e-9)


def test_log_ratios_are_those_of_cross_validation_errors() -> None:
    # Independently: the sharp estimate fitted without each fold, evaluated at its contacts.
    contacts = touched_shape("half_cylinder")
    surface = BlendedImplicitSurface.from_contacts(contacts)
    order = np.argsort(np.linalg.norm(contacts.points - contacts.points.mean(axis=0), axis=1))
    for fold in range(4):
        left_out = np.zeros(len(contacts), dtype=bool)
        left_out[order[fold::4]] = True
        sharp = PatchImplicitSurface.from_contacts(contacts.subset(~left_out))
        # Refitting the smooth estimate would change its scale: it is predicted in closed form.
        whole = GaussianProcessImplicitSurface.from_contacts(contacts)
        values, gradients = whole.leave_groups_out(left_out.astype(np.intp))
        for i in np.flatnonzero(left_out):
            errors = []
            point, normal = contacts.points[i], contacts.normals[i]
            for value, gradient in (
                (values[i], gradients[i]),
                (sharp.evaluate(point), sharp.gradient(point)),
            ):
                slope = np.linalg.norm(gradient)
                distance = abs(float(value)) / max(slope, 0.3) / contacts.spacing
                errors.append(
                    min(distance, 1.0) + 0.25 * np.linalg.norm(gradient / slope - normal) + 0.02
                )
            assert surface.log_ratios[i] == pytest.approx(np.log(errors[0] / errors[1]), abs=1e-6)
