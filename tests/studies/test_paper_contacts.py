"""The contacts of the paper's experiments."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.evaluation.surface_error import sample_segments
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp_studies.paper.trials import walk_surface


@pytest.mark.parametrize("name", shapes.NAMES)
def test_a_walk_touches_the_true_surface_step_by_step_until_all_is_explored(name: str) -> None:
    shape = shapes.build(name, size=0.2)
    walk = walk_surface(shape, rng=np.random.default_rng(1))
    points, normals = walk.contacts.points, walk.contacts.normals
    distances, faces = distances_to_mesh(points, shape.mesh)
    np.testing.assert_allclose(distances, 0.0, atol=1e-9)
    np.testing.assert_allclose(normals, shape.mesh.face_normals[faces], atol=1e-9)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    apart[normals @ normals.T < -0.5] = np.inf  # the other side of a wall
    np.fill_diagonal(apart, np.inf)
    # Band of a step, 0.8 to 1.2 of 50 mm; pieces that edges part may start a little farther.
    assert apart.min() > 0.04
    assert np.all(np.diff(walk.coverage) >= 0.0)
    # The rest is slivers along edges, where a finger measures no normal.
    assert walk.coverage[-1] > 0.99


def test_contacts_keep_a_distance_from_edges() -> None:
    shape = shapes.build("pentagon", size=0.2)
    walk = walk_surface(shape, rng=np.random.default_rng(2))
    edge = cKDTree(sample_segments(shape.edges, 20_000))
    assert edge.query(walk.contacts.points)[0].min() > 0.06 * 0.05


def test_a_walk_can_be_cut_short() -> None:
    walk = walk_surface(shapes.build("box", size=0.2), rng=np.random.default_rng(3))
    half = walk.until(0.5)
    assert walk.coverage[len(half) - 1] >= 0.5 > walk.coverage[len(half) - 2]
    np.testing.assert_array_equal(walk.first(5).points, walk.contacts.points[:5])
    assert len(walk.first(10_000)) == len(walk.until(2.0)) == len(walk.contacts)


def test_the_seed_decides_the_walk() -> None:
    shape = shapes.build("torus", size=0.2)
    first, again, other = (
        walk_surface(shape, rng=np.random.default_rng(seed)).contacts for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points[0], other.points[0])
