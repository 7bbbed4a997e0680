"""Planned contacts are on the surface, not on tangent planes of its samples."""

import numpy as np
import pytest
import trimesh

from lis_grasp import Hand
from lis_grasp.grasping._antipodal_sampling import sample_contact_sets
from lis_grasp.grasping._contact_samples import SurfaceSamples

RADIUS = 0.02


def _samples(mesh: trimesh.Trimesh) -> SurfaceSamples:
    return SurfaceSamples(mesh, lowest=-1.0, rng=np.random.default_rng(0))


def test_contacts_on_a_tube_are_on_it_and_normal_to_it() -> None:
    tube = trimesh.creation.cylinder(RADIUS, 0.2, sections=256)
    samples = _samples(tube)
    hand = Hand.load("allegro")
    sets, _ = sample_contact_sets(hand, samples, count=60, rng=np.random.default_rng(1))
    points, normals = sets.points[sets.used], sets.normals[sets.used]
    assert len(points) >= 20
    radial = points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    # 256 sides: their middles are 1.5 um inside, and their normals are off by up to 0.7 degrees.
    np.testing.assert_allclose(np.linalg.norm(points[:, :2], axis=1), RADIUS, atol=2e-6)
    assert (radial * normals[:, :2]).sum(axis=1).min() > np.cos(np.deg2rad(0.71))


def test_projection_keeps_contacts_of_planes_and_does_not_cross_edges() -> None:
    box = trimesh.creation.box((0.06, 0.05, 0.08)).subdivide().subdivide()
    samples = _samples(box)
    points, normals = samples.points[:50], samples.normals[:50]
    kept, same = samples.project(points, normals)
    np.testing.assert_allclose(kept, points, atol=1e-12)
    np.testing.assert_allclose(same, normals, atol=1e-12)
    # On the plane of the side x = 0.03, but 2 mm beyond its upper edge.
    beyond, up = np.array([[0.03, 0.0, 0.042]]), np.array([[1.0, 0.0, 0.0]])
    there, normal = samples.project(beyond, up)
    assert np.linalg.norm(there - beyond) <= 0.002 + 1e-12
    assert normal[0] @ up[0] == pytest.approx(1.0)


def test_a_line_along_a_plane_meets_it_at_its_sample() -> None:
    samples = _samples(trimesh.creation.box((0.06, 0.05, 0.08)))
    for j in (0, 100):
        along = np.roll(samples.normals[j], 1)
        np.testing.assert_array_equal(samples.intersect(np.zeros(3), along, j), samples.points[j])
