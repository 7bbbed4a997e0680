"""Contact sets of the study: where contacts are, how many, their noise, and their scores."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.exploration import POLICIES
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.surfaces import GaussianProcessImplicitSurface, ImplicitSurface
from lis_grasp_studies.contact_study.contact_sets import (
    CASES,
    KINDS,
    ContactCase,
    balanced,
    contact_set,
)
from lis_grasp_studies.contact_study.draws import CLUSTER_RADIUS, DRAWS, EXPLORATIONS
from lis_grasp_studies.contact_study.score import (
    EXPLORED,
    meshing_box,
    score_estimate,
)
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import Noise, compared_estimator
from lis_grasp_studies.test_objects.shape_sets import build_shape


@pytest.mark.parametrize("draw", [*DRAWS, "spread", "random_targets"])
def test_exact_contacts_are_on_the_surface_and_repeat_bit_for_bit(draw: str) -> None:
    case = ContactCase(draw, 30)
    first, again = contact_set("socket", case), contact_set("socket", case)
    assert len(first.contacts) == 30
    np.testing.assert_array_equal(first.contacts.points, again.contacts.points)
    assert distances_to_mesh(first.exact.points, first.shape.mesh)[0].max() < 1e-4
    other = contact_set("socket", case, seed=1)
    assert not np.array_equal(other.contacts.points, first.contacts.points)


def test_every_policy_is_a_case() -> None:
    assert set(EXPLORATIONS.values()) == set(POLICIES)
    assert {*DRAWS, *EXPLORATIONS} == {case.draw for case in CASES}
    assert {case.kind for case in CASES} == set(KINDS)
    assert len({case.name for case in CASES}) == len(CASES)


def test_normals_of_a_tessellated_cylinder_are_radial() -> None:
    # The side has 96 faces, whose own normals are off by up to 1.9 degrees.
    surface = SurfacePoints.of(build_shape("socket"))
    z, radii = surface.points[:, 2], np.linalg.norm(surface.points[:, :2], axis=1)
    side = (radii > 0.0399) & (z > -0.055) & (z < -0.015)
    radial = surface.points[side] * [1.0, 1.0, 0.0] / radii[side, None]
    cosines = np.einsum("pk,pk->p", radial, surface.normals[side])
    assert side.sum() > 1000
    assert np.degrees(np.arccos(cosines.clip(-1.0, 1.0))).max() < 0.5


def test_clusters_are_as_large_as_a_pad_and_far_apart() -> None:
    points = contact_set("box", ContactCase("clustered", 40)).exact.points
    near = cKDTree(points).query_pairs(2.0 * CLUSTER_RADIUS, output_type="ndarray")
    distances = pdist(points)
    assert len(near) >= 40  # clusters of at least 3, but for the last
    between = distances[distances > 2.0 * CLUSTER_RADIUS + 1e-9]
    assert between.min() > 0.02


def test_half_contacts_leave_a_half_untouched() -> None:
    data = contact_set("sphere", ContactCase("half", 40))
    directions = data.exact.points / np.linalg.norm(data.exact.points, axis=1, keepdims=True)
    assert (directions @ directions.mean(axis=0) > -0.1).all()


def test_even_contacts_are_farther_apart_than_random_ones() -> None:
    gaps = {
        draw: cKDTree(contact_set("sphere", ContactCase(draw, 60)).exact.points).query(
            contact_set("sphere", ContactCase(draw, 60)).exact.points, k=2
        )[0][:, 1]
        for draw in ("even", "random")
    }
    assert gaps["even"].min() > 2.0 * gaps["random"].min()


def test_noise_is_that_of_the_case_and_is_withheld_or_given() -> None:
    case = ContactCase("random", 400, level=2, given=True)
    data = contact_set("sphere", case)
    moved = data.contacts.points - data.exact.points
    # 1200 normal numbers: their deviation is known to 2 % (one sigma).
    assert moved.std() == pytest.approx(0.002, rel=0.1)
    withheld = contact_set("sphere", ContactCase("random", 400, level=2))
    np.testing.assert_array_equal(withheld.contacts.points, data.contacts.points)
    assert data.given_noise == case.noise
    assert withheld.given_noise == Noise()


def test_balanced_pairs_meet_every_case_and_every_shape() -> None:
    names = ["a", "b", "c"]
    pairs = balanced(names, CASES, 3)
    assert len(pairs) == len(CASES)  # three shapes, a third of the cases each
    assert {case for _, case in pairs} == set(CASES)
    assert len(balanced(names, CASES, 1)) == 3 * len(CASES)


def test_a_score_is_that_of_a_known_estimate() -> None:
    data = contact_set("sphere", ContactCase("even", 100))

    class Ball:
        """A ball that is 1 mm too large, and says so."""

        bounds = np.array([[-0.06] * 3, [0.06] * 3])

        def evaluate(self, points: np.ndarray) -> np.ndarray:
            return np.linalg.norm(points, axis=-1) - 0.051

        def gradient(self, points: np.ndarray) -> np.ndarray:
            return points / np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-12)

        def uncertainty(self, points: np.ndarray) -> np.ndarray:
            return np.full(points.shape[:-1], 0.0007)

    def estimator(contacts: Contacts, noise: Noise) -> ImplicitSurface:
        return Ball()

    score = score_estimate(estimator, data, box="own")
    # Chords of both meshes: 0.1 mm of the truth, 0.05 mm of cells of 2.5 mm.
    assert score.truth_to_estimate == pytest.approx(0.001, abs=2e-4)
    assert score.estimate_to_truth == pytest.approx(0.001, abs=2e-4)
    assert score.edge is None
    assert score.within_68 < 0.1
    assert score.within_95 > 0.9
    assert not score.failure
    Ball.bounds = np.array([[-0.06] * 3, [0.06, 0.06, 0.03]])  # ends the ball, which counts nowhere
    clipped = score_estimate(estimator, data, box="own")
    assert clipped.truth_to_estimate > 0.002
    assert clipped.within_95 > 0.9
    assert clipped.truth_within_95 > 0.9


def test_a_failed_estimate_is_scored_as_one_that_misses_everything() -> None:
    data = contact_set("box", ContactCase("even", 12))

    def failing(contacts: Contacts, noise: Noise) -> ImplicitSurface:
        raise EstimationError("no surface")

    score = score_estimate(failing, data)
    radius = EXPLORED * data.shape.size
    assert (score.truth_to_estimate, score.estimate_to_truth, score.edge) == (radius,) * 3
    assert "no surface" in score.failure


def test_every_estimate_is_meshed_in_the_box_of_gpis() -> None:
    data = contact_set("box", ContactCase("clustered", 30))
    gpis = GaussianProcessImplicitSurface.from_contacts(data.contacts)
    np.testing.assert_allclose(meshing_box(data, "contacts"), gpis.bounds)
    own, common = (
        score_estimate(compared_estimator("gpis"), data, box=box) for box in ("own", "contacts")
    )
    assert own.truth_to_estimate == common.truth_to_estimate
