"""The blend of a sharp and a smooth estimate: its weights, and that it is their mean."""

from __future__ import annotations

import numpy as np
import pytest
from random_directions import random_directions

import lis_grasp as lg
from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation import surface_error
from lis_grasp.surfaces import (
    BlendedImplicitSurface,
    GaussianProcessImplicitSurface,
    PatchImplicitSurface,
)
from lis_grasp.surfaces.contact_places import ContactPlaces
from lis_grasp_studies.paper.trials import explored


def touched_shape(name: str, spacing: float = 0.045, seed: int = 1) -> Contacts:
    """Return centres of a shape's triangles, at least `spacing` apart, in random order."""
    shape = shapes.build(name, 0.2)
    points, normals = shape.mesh.triangles_center, shape.mesh.face_normals
    kept: list[int] = []
    for i in np.random.default_rng(seed).permutation(len(points)):
        if all(np.linalg.norm(points[i] - points[j]) >= spacing for j in kept):
            kept.append(int(i))
    return Contacts(points[kept], normals[kept])


def smoothstep(values: np.ndarray, low: float, high: float) -> np.ndarray:
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return 3.0 * t**2 - 2.0 * t**3


def weights_by_definition(surface: BlendedImplicitSurface, points: np.ndarray) -> np.ndarray:
    """Return w v at points, term by term from the description in the class."""
    ratios, spacing = surface.log_ratios, surface.spacing
    overall = ratios.sum() / (len(ratios) + 3.0) - 0.5 * ratios.std() / np.sqrt(len(ratios))
    weights = []
    for x in points:
        kernel = np.exp(-0.5 * np.sum((surface.places - x) ** 2, axis=1) / (1.2 * spacing) ** 2)
        evidence = (kernel @ ratios + 3.0 * overall) / (kernel.sum() + 3.0)
        apart = abs(surface.sharp.evaluate(x) - surface.smooth.evaluate(x)) / spacing
        weights.append(smoothstep(evidence, 0.0, 0.3) * (1.0 - smoothstep(apart, 0.5, 1.0)))
    return np.array(weights)


@pytest.mark.slow
def test_a_torus_is_as_good_as_its_smooth_estimate() -> None:
    contacts = touched_shape("torus")
    points = shapes.build("torus", 0.2).mesh.vertices[::20]
    errors = [
        np.sqrt(np.mean(estimate.from_contacts(contacts).evaluate(points) ** 2))
        for estimate in (BlendedImplicitSurface, GaussianProcessImplicitSurface)
    ]
    assert errors[0] < 1.1 * errors[1]


@pytest.mark.by_default("box", "cylinder")
@pytest.mark.parametrize("name", ["box", "pentagon", "cylinder"])
def test_edges_stay_those_of_the_sharp_estimate(name: str) -> None:
    surface = BlendedImplicitSurface.from_contacts(touched_shape(name))
    edges = shapes.build(name, 0.2).edges.mean(axis=1)[::7]
    assert np.median(weights_by_definition(surface, edges)) > 0.9


def test_sparse_contacts_keep_their_edges() -> None:
    # 28 contacts of a mallet look noisy until they are divided into patches.
    shape, walk = explored("mallet", 0)
    error = surface_error(lg.extract_mesh(lg.estimate(walk.contacts)), shape)
    assert error.edge_rmsd is not None
    assert error.edge_rmsd < 0.02 * shape.size


def test_a_value_lies_between_both_estimates_with_the_weight_it_states() -> None:
    surface = BlendedImplicitSurface.from_contacts(touched_shape("mallet", 0.04))
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (300, 3))
    weight = weights_by_definition(surface, points)
    assert np.mean((weight > 0.01) & (weight < 0.99)) > 0.05
    sharp, smooth = surface.sharp.evaluate(points), surface.smooth.evaluate(points)
    np.testing.assert_allclose(
        surface.evaluate(points), weight * sharp + (1 - weight) * smooth, atol=1e-12
    )
    # The law of total variance; the sharp estimate is believed less where it is far from the other.
    some, weights = surface._weights(points)
    weight = np.zeros(len(points))
    weight[some] = weights
    weight *= np.maximum(1.0 - np.abs(sharp - smooth) / surface.spacing, 0.0)
    variance = weight * surface.sharp.uncertainty(points) ** 2
    variance += (1 - weight) * surface.smooth.uncertainty(points) ** 2
    variance += weight * (1 - weight) * (sharp - smooth) ** 2
    np.testing.assert_allclose(surface.uncertainty(points), np.sqrt(variance), rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_fewer_than_four_places_have_the_smooth_estimate(count: int) -> None:
    contacts = touched_shape("box").subset(slice(0, count))
    surface = BlendedImplicitSurface.from_contacts(contacts)
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (100, 3))
    np.testing.assert_array_equal(surface.evaluate(points), surface.smooth.evaluate(points))


def test_the_order_of_equally_far_contacts_does_not_matter() -> None:
    half = random_directions(14, np.random.default_rng(0))
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


@pytest.mark.slow
def test_log_ratios_are_those_of_cross_validation_errors() -> None:
    # Independently: both estimates without each fold of places, evaluated at its contacts.
    contacts = touched_shape("half_cylinder", 0.03)
    surface = BlendedImplicitSurface.from_contacts(contacts)
    places = ContactPlaces.of(contacts.points)
    found = [[] for _ in places.nodes]
    for i, place in enumerate(places.place):
        left_out = places.place % 5 == place % 5
        values, gradients = surface.smooth.free.leave_groups_out(left_out.astype(np.intp))
        sharp = surface.sharp.without(left_out)
        errors = []
        point, normal = contacts.points[i], contacts.normals[i]
        for value, gradient in (
            (values[i], gradients[i]),
            (sharp.evaluate(point), sharp.gradient(point)),
        ):
            slope = np.linalg.norm(gradient)
            distance = abs(float(value)) / max(slope, 0.3) / places.spacing
            errors.append(
                min(distance, 1.0) + 0.25 * np.linalg.norm(gradient / slope - normal) + 0.02
            )
        found[place].append(np.log(errors[0] / errors[1]))
    expected = [np.mean(logs) for logs in found]
    np.testing.assert_allclose(surface.log_ratios, expected, atol=1e-6)


def test_a_part_of_the_patches_left_out_keeps_the_segmentation_of_the_rest() -> None:
    surface = PatchImplicitSurface.from_contacts(touched_shape("cylinder"))
    left_out = np.arange(len(surface.points)) % 5 == 0
    rest = surface.without(left_out)
    together = surface.patch_of[~left_out]
    same = together[:, None] == together
    kept = rest.patch_of
    np.testing.assert_array_equal(kept[:, None] == kept, same)
    assert rest.spacing == surface.spacing
