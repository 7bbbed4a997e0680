"""Estimated noise against the noise that was added, over shapes, numbers and levels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_preparation import estimate_noise
from lis_grasp.typing import FloatArray

SIZE = 0.2


def edged(name: str, count: int, seed: int) -> Contacts:
    """Contacts on a built-in solid, random by area."""
    mesh = shapes.build(name, SIZE).mesh
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return Contacts(points, mesh.face_normals[faces])


def curved(radius: Callable[[FloatArray], FloatArray], count: int, seed: int) -> Contacts:
    """Contacts on r = radius(direction) [m], with exact normals by differences, evenly spread."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    ring = np.sqrt(1.0 - height**2)
    directions = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])
    directions = directions @ Rotation.random(random_state=seed).as_matrix()
    points = radius(directions)[:, None] * directions

    def level(x: FloatArray) -> FloatArray:
        length = np.linalg.norm(x, axis=1)
        return length - radius(x / length[:, None])

    steps = 1e-6 * np.eye(3)
    normals = np.column_stack([level(points + step) - level(points - step) for step in steps])
    return Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def lumpy(directions: FloatArray) -> FloatArray:
    bumps = np.array([[0.8, 0.6, 0.0], [-0.6, 0.0, 0.8], [0.0, -0.6, -0.8]])
    return 0.07 + 0.02 * np.exp(3.0 * (directions @ bumps.T - 1.0)).sum(axis=1)


def ellipsoid(directions: FloatArray) -> FloatArray:
    return 1.0 / np.linalg.norm(directions / [0.1, 0.07, 0.05], axis=1)


SHAPES: dict[str, Callable[[int, int], Contacts]] = {
    "box": lambda count, seed: edged("box", count, seed),
    "mallet": lambda count, seed: edged("mallet", count, seed),
    "pentagon": lambda count, seed: edged("pentagon", count, seed),
    "half_cylinder": lambda count, seed: edged("half_cylinder", count, seed),
    "ellipsoid": lambda count, seed: curved(ellipsoid, count, seed),
    "lumpy": lambda count, seed: curved(lumpy, count, seed),
}


def with_noise(contacts: Contacts, position: float, normal: float, seed: int) -> Contacts:
    """Move contacts along their normals, and tilt the normals."""
    rng = np.random.default_rng(seed)
    normals = contacts.normals
    tilt = normal * rng.normal(size=normals.shape)
    tilt -= np.einsum("nk,nk->n", tilt, normals)[:, None] * normals
    tilted = normals + tilt
    return Contacts(
        contacts.points + position * rng.normal(size=(len(contacts), 1)) * normals,
        tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
    )


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize(
    ("position", "degrees"), [(0.002, 6.0), pytest.param(0.007, 20.0, marks=pytest.mark.slow)]
)
def test_estimated_noise_is_within_a_factor_of_one_and_a_half(
    shape: str, position: float, degrees: float
) -> None:
    assert_noise_is_found(shape, 50, position, np.deg2rad(degrees))


@pytest.mark.parametrize("shape", ["box", "mallet", "pentagon", "ellipsoid"])
def test_small_noise_is_estimated_from_many_contacts(shape: str) -> None:
    assert_noise_is_found(shape, 100, 0.0005, np.deg2rad(2.0))


def assert_noise_is_found(shape: str, count: int, position: float, normal: float) -> None:
    sets = [with_noise(SHAPES[shape](count, k), position, normal, k) for k in range(3)]
    estimates = np.array([estimate_noise(contacts) for contacts in sets])
    ratios = np.median(estimates, axis=0) / [position, normal]
    assert (ratios < 1.5).all(), ratios
    assert (ratios > 1.0 / 1.5).all(), ratios


@pytest.mark.parametrize("name", ["box", "mallet", "pentagon", "half_cylinder"])
@pytest.mark.parametrize("count", [30, 100])
def test_clean_contacts_of_edged_solids_have_hardly_any_noise(name: str, count: int) -> None:
    contacts = edged(name, count, 0)
    position, normal = estimate_noise(contacts)
    assert position < 0.02 * contacts.spacing
    assert normal < np.deg2rad(1.0)  # tessellated curves have normals that differ by 1 degree


@pytest.mark.parametrize("shape", ["ellipsoid", "lumpy", "torus"])
@pytest.mark.parametrize("count", [30, 60])
def test_clean_contacts_that_only_a_smooth_surface_explains_have_no_noise(
    shape: str, count: int
) -> None:
    """Neighbours on a torus are too far apart for quadrics."""
    if shape == "torus":
        turns = np.arange(count) * np.array([[1.0], [(np.sqrt(5.0) - 1.0) / 2.0]])
        ring, tube = 2.0 * np.pi * (turns / [[count], [1.0]])
        axis = np.column_stack([np.cos(ring), np.sin(ring), np.zeros(count)])
        normals = np.cos(tube)[:, None] * axis + np.sin(tube)[:, None] * [0.0, 0.0, 1.0]
        contacts = Contacts(0.07 * axis + 0.03 * normals, normals)
    else:
        contacts = SHAPES[shape](count, 0)
    position, normal = estimate_noise(contacts)
    assert position < 0.005 * contacts.spacing
    assert normal < np.deg2rad(1.5)


def test_clusters_of_contacts_tell_their_noise() -> None:
    """Three contacts within 5 mm at each of 20 places, as of a pad with taxels."""
    rng = np.random.default_rng(0)
    centers = curved(ellipsoid, 20, 0)
    near = 0.005 * rng.uniform(-1.0, 1.0, (60, 3))
    directions = np.repeat(centers.points, 3, axis=0) + near
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = ellipsoid(directions)[:, None] * directions
    normals = points / np.array([0.1, 0.07, 0.05]) ** 2
    clean = Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    position, normal = estimate_noise(with_noise(clean, 0.002, 0.1, 1))
    assert position == pytest.approx(0.002, rel=0.5)
    assert normal == pytest.approx(0.1, rel=0.5)


def test_noise_follows_the_scale_and_neither_frame_nor_order_nor_repetition() -> None:
    contacts = with_noise(SHAPES["box"](60, 0), 0.002, 0.1, 0)
    position, normal = estimate_noise(contacts)
    rotation = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    order = np.random.default_rng(0).permutation(60)
    moved = Contacts(
        3.0 * contacts.points[order] @ rotation.T + 0.5, contacts.normals[order] @ rotation.T
    )
    again = moved.append(moved.subset([5, 5, 7]))
    # The search stops at changes of the likelihood by 1e-4.
    assert estimate_noise(again) == pytest.approx((3.0 * position, normal), rel=1e-3)


@pytest.mark.parametrize("count", [0, 1, 4, 8])
def test_few_contacts_do_not_determine_the_noise(count: int) -> None:
    contacts = SHAPES["box"](count, 0) if count else Contacts.empty()
    assert np.isnan(estimate_noise(contacts)).all()


def test_contacts_at_one_place_do_not_determine_the_noise() -> None:
    one = Contacts(np.zeros((9, 3)), np.eye(3)[np.arange(9) % 3])
    assert np.isnan(estimate_noise(one)).all()
