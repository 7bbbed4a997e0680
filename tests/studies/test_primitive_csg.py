"""RANSAC of primitives and their CSG, against solids whose primitives are known."""

from __future__ import annotations

import numpy as np
import pytest
from random_directions import random_directions
from scipy.spatial.transform import Rotation

from lis_grasp_studies.baselines import PrimitiveCSGSurface
from lis_grasp_studies.baselines._oriented_primitives import (
    Primitives,
    cones_through,
    cylinders_through,
    planes_at,
    spheres_through,
)
from lis_grasp_studies.baselines.primitive_csg_surface import extract_primitives
from lis_grasp_studies.contact_study.contact_sets import ContactCase, contact_set
from lis_grasp_studies.contact_study.score import score_estimate
from lis_grasp_studies.estimators import Noise

X_AXIS = Rotation.from_euler("xyz", [0.3, -0.5, 0.2]).as_matrix()
CENTER = np.array([0.02, -0.01, 0.03])


def oriented_points(kind: str, hollow: bool, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return points and outward normals on a sphere, cylinder (5 cm) or cone of 25 degrees."""
    angles, along = rng.uniform(0.0, 2.0 * np.pi, 30), rng.uniform(0.03, 0.1, 30)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(30)])
    up = np.array([0.0, 0.0, 1.0])
    if kind == "sphere":
        normals = random_directions(30, rng)
        points = 0.05 * normals
    elif kind == "cylinder":
        normals, points = ring, 0.05 * ring + along[:, None] * up
    else:
        slope = np.deg2rad(25.0)
        normals = np.cos(slope) * ring - np.sin(slope) * up
        points = along[:, None] * (np.tan(slope) * ring + up)
    normals = -normals if hollow else normals
    return points @ X_AXIS.T + CENTER, normals @ X_AXIS.T


MAKERS = {
    "sphere": (spheres_through, 2),
    "cylinder": (cylinders_through, 2),
    "cone": (cones_through, 3),
}


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("kind", MAKERS)
def test_minimal_sets_recover_the_primitive_that_they_are_on(kind: str, hollow: bool) -> None:
    rng = np.random.default_rng(0)
    points, normals = oriented_points(kind, hollow, rng)
    make, size = MAKERS[kind]
    found = make(points, normals, np.argsort(rng.random((40, 30)), axis=1)[:, :size])
    assert len(found) > 20
    values, gradients = found.value_and_gradient(points)
    # Exact input; the worst conditioned of the minimal sets amplify rounding.
    np.testing.assert_allclose(values, 0.0, atol=1e-9)
    np.testing.assert_allclose(gradients, np.repeat(normals[:, None], len(found), 1), atol=1e-7)
    expected = {"sphere": 0.05, "cylinder": 0.05, "cone": np.deg2rad(25.0)}[kind]
    np.testing.assert_allclose(found.size, expected, atol=1e-7)


@pytest.mark.parametrize("kind", ["plane", *MAKERS])
def test_gradients_are_those_of_the_distance(kind: str) -> None:
    rng = np.random.default_rng(1)
    axis = X_AXIS[:, :1].T
    one = Primitives(kind, CENTER[None], axis, np.array([0.4]), np.array([-1.0]))  # type: ignore[arg-type]
    points = rng.normal(scale=0.3, size=(50, 3))
    step = 1e-6
    differences = [
        (one.value_and_gradient(points + s)[0] - one.value_and_gradient(points - s)[0])[:, 0]
        for s in step * np.eye(3)
    ]
    gradients = one.value_and_gradient(points)[1][:, 0]
    np.testing.assert_allclose(np.column_stack(differences) / (2 * step), gradients, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1.0, atol=1e-9)


def test_every_contact_is_explained_once_and_no_more_primitives_than_faces() -> None:
    data = contact_set("stairs", ContactCase("even", 60))
    found = extract_primitives(
        data.contacts.points, data.contacts.normals, distance=0.0015, angle=0.2
    )
    members = np.concatenate([members for _, members in found])
    np.testing.assert_array_equal(np.sort(members), np.arange(60))
    assert [one.kind for one, _ in found] == ["plane"] * 10


def test_tangent_planes_explain_what_nothing_else_does() -> None:
    points, normals = np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0]]), np.eye(3)[[2, 0]]
    found = extract_primitives(points, normals, distance=0.001, angle=0.1)
    assert [one.kind for one, _ in found] == ["plane", "plane"]
    np.testing.assert_array_equal(
        planes_at(points, normals).value_and_gradient(points)[0][0], [0.0, -0.1]
    )


@pytest.mark.parametrize("name", ["box", "stairs", "hollow_cylinder", "mallet", "socket"])
def test_a_solid_of_primitives_is_recovered_from_even_contacts(name: str) -> None:
    data = contact_set(name, ContactCase("even", 60, level=0))
    score = score_estimate(lambda c, _: PrimitiveCSGSurface.from_contacts(c), data)
    # Chords of 3.75 degrees are within 0.06 mm; half a millimetre permits an edge or two in a cell.
    assert max(score.truth_to_estimate, score.estimate_to_truth) < 5e-4


def test_noise_that_is_given_widens_the_tolerance() -> None:
    data = contact_set("box", ContactCase("even", 60, level=2, given=True))
    counts = [
        len(PrimitiveCSGSurface.from_contacts(data.contacts, **noise.options()).primitives)
        for noise in (Noise(), data.given_noise)
    ]
    # Six faces; contacts off by more than the tolerance make primitives of their own.
    assert counts[1] < 0.5 * counts[0]
