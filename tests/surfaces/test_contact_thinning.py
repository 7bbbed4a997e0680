"""Thinning of clouds: accuracy, stated noise, and laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_directions import random_directions
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import GaussianProcessImplicitSurface
from lis_grasp.surfaces.contact_preparation import thin_contacts

RADIUS = 0.05


def cloud(count: int, noise: float, *, normal_noise: float = 0.05, seed: int = 0) -> Contacts:
    """Contacts anywhere on a sphere, with noise, which they carry."""
    rng = np.random.default_rng(seed)
    normals = random_directions(count, rng)
    tilted = normals + normal_noise * rng.normal(size=(count, 3))
    return Contacts(
        RADIUS * normals + noise * rng.normal(size=(count, 3)),
        tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
        position_noise=np.full(count, noise),
        normal_noise=np.full(count, normal_noise),
    )


def test_means_are_on_the_surface_with_the_noise_that_they_state() -> None:
    contacts = cloud(5000, 1e-3)
    thinned = thin_contacts(contacts, 300)
    assert len(thinned) == 300
    errors = (np.linalg.norm(thinned.points, axis=1) - RADIUS) / thinned.position_noise
    # 300 draws know their deviation to 4 %; noise of normals moves means by a quarter of that more.
    assert errors.std() == pytest.approx(1.0, rel=0.2)
    # Plain means of cells of 10 mm would be 0.25 mm or more inside.
    assert abs(np.mean(np.linalg.norm(thinned.points, axis=1) - RADIUS)) < 1e-4
    cosines = np.einsum("nk,nk->n", thinned.normals, thinned.points) / RADIUS
    assert np.median(cosines) > np.cos(0.05)


def test_exact_points_of_a_sphere_stay_on_it() -> None:
    exact = cloud(2000, 0.0, normal_noise=0.0)
    thinned = thin_contacts(replace(exact, position_noise=None, normal_noise=None), 100)
    # Cells of 20 mm are 1 mm high; the mean normal is off by the skewness of its cell.
    np.testing.assert_allclose(np.linalg.norm(thinned.points, axis=1), RADIUS, atol=2e-4)
    assert thinned.position_noise is None


def test_edges_of_a_box_stay_sharp() -> None:
    rng = np.random.default_rng(0)
    face, place = rng.integers(6, size=3000), rng.uniform(-0.05, 0.05, (3000, 3))
    normals = np.vstack([np.eye(3), -np.eye(3)])[face]
    points = np.where(normals != 0.0, 0.05 * normals, place)
    thinned = thin_contacts(Contacts(points, normals), 200)
    # Normals of two faces are twice as far apart as cells.
    np.testing.assert_allclose(np.abs(thinned.points).max(axis=1), 0.05, atol=1e-12)
    np.testing.assert_allclose(np.abs(thinned.normals).max(axis=1), 1.0, atol=1e-12)


def test_precise_contacts_keep_their_precision_among_noisy_ones() -> None:
    touches, noisy = cloud(30, 1e-5, seed=1), cloud(4000, 2e-3)
    thinned = thin_contacts(noisy.append(touches), 200)
    assert np.sum(thinned.position_noise < 1.1e-5) >= 25
    nearest = np.linalg.norm(thinned.points[:, None] - touches.points, axis=2).min(axis=0)
    assert np.median(nearest) < 1e-4


def test_few_contacts_are_returned_as_they_are() -> None:
    contacts = cloud(50, 1e-3)
    assert thin_contacts(contacts, 50) is contacts
    again = contacts.append(contacts.subset([3, 4]))
    np.testing.assert_array_equal(thin_contacts(again, 50).points, contacts.points)


def test_thinning_follows_motion_and_scale_and_not_the_order() -> None:
    contacts = cloud(800, 1e-3)
    thinned = thin_contacts(contacts, 80)
    rotation = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    order = np.random.default_rng(0).permutation(800)
    moved = replace(
        contacts,
        points=3.0 * contacts.points @ rotation.T + 0.5,
        normals=contacts.normals @ rotation.T,
        position_noise=3.0 * contacts.position_noise,
    ).subset(order)
    expected = 3.0 * thinned.points @ rotation.T + 0.5
    there = thin_contacts(moved, 80)
    gaps = np.linalg.norm(there.points[:, None] - expected, axis=2).min(axis=1)
    assert gaps.max() < 1e-12


@pytest.mark.slow
def test_a_gaussian_process_of_a_cloud_is_as_accurate_as_the_noise_allows() -> None:
    touches, noisy = cloud(30, 1e-4, seed=1), cloud(5000, 2e-3, normal_noise=0.2)
    surface = GaussianProcessImplicitSurface.from_contacts(noisy.append(touches))
    directions = random_directions(500, np.random.default_rng(2))
    errors = surface.evaluate(RADIUS * directions)
    # 2 mm averaged over 50 neighbours, about three cells of thirteen points.
    assert np.sqrt(np.mean(errors**2)) < 2e-3 / np.sqrt(50.0)
