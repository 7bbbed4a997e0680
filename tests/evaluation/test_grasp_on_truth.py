"""Quality of a planned grasp on the true object."""

import numpy as np
import pytest
import trimesh

from lis_grasp import ForceClosureSampler, Grasp, Hand
from lis_grasp.evaluation.grasp_on_truth import epsilon_on_truth, true_contacts

JAW = Hand.load("wsg50")
BOX = trimesh.creation.box((0.05, 0.06, 0.1))


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    search = ForceClosureSampler(JAW, candidates=150).sample(
        BOX, rng=np.random.default_rng(0), support_height=-0.05, count=1
    )
    return search.grasps[0]


def test_a_grasp_planned_on_the_truth_keeps_its_epsilon(grasp: Grasp) -> None:
    on_truth = epsilon_on_truth(grasp, BOX, JAW, friction=0.8)
    # By a whole hull here, by an expanding polytope there, which is within 6e-6 of it.
    assert on_truth == pytest.approx(grasp.quality["epsilon"], abs=6e-6)


def test_fingers_close_until_they_meet_a_smaller_object(grasp: Grasp) -> None:
    smaller = trimesh.creation.box((0.04, 0.05, 0.1))
    points, normals = true_contacts(grasp, smaller)
    assert len(points) == 2
    # Each finger moves 5 mm further, along its normal; the faces keep theirs.
    expected = grasp.contact_points - 0.005 * grasp.contact_normals
    np.testing.assert_allclose(points, expected, atol=1e-6)
    np.testing.assert_allclose(normals, grasp.contact_normals, atol=1e-6)


def test_epsilon_is_zero_where_fingers_miss_the_object(grasp: Grasp) -> None:
    away = BOX.copy().apply_translation([0.0, 0.0, 1.0])
    assert epsilon_on_truth(grasp, away, JAW, friction=0.8) == 0.0
