"""Normals from points: errors, stated deviations, evidence of sides, fingertip centres."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from reference import hoppe_normals
from scipy.stats import special_ortho_group

from lis_grasp import Contacts, shapes
from lis_grasp.exceptions import EstimationError, InvalidContactsError
from lis_grasp.surfaces import estimate_normals
from lis_grasp.typing import FloatArray

SHAPES = ("box", "cylinder", "sphere", "torus", "mallet", "pentagon")


def sampled(name: str, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    mesh = shapes.build(name).mesh
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(points), np.asarray(mesh.face_normals[faces])


def approaches(normals: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Directions of straight motions that hit surface elements anywhere: the cosine law."""
    uniform = rng.normal(size=normals.shape)
    uniform /= np.linalg.norm(uniform, axis=1, keepdims=True)
    into = uniform - (1.0 + 1e-9) * normals  # a unit sphere that touches the surface from inside
    return into / np.linalg.norm(into, axis=1, keepdims=True)


def angles(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.arccos(np.clip(np.sum(first * second, axis=1), -1.0, 1.0))


def components(errors: FloatArray, estimated: FloatArray, true: FloatArray) -> FloatArray:
    """Angular error of each normal along two directions across it, shape (N, 2) [rad]."""
    first = np.cross(estimated, np.eye(3)[np.argmin(np.abs(estimated), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.column_stack(
        [np.sum(true * axis, axis=1) for axis in (first, np.cross(estimated, first))]
    )
    return across * (errors / np.maximum(np.sin(errors), 1e-9))[:, None]


def test_normals_of_a_sphere_are_radial() -> None:
    points, _ = sampled("sphere", 30, 0)
    contacts = estimate_normals(points)
    radial = (points - shapes.build("sphere").mesh.center_mass) / np.linalg.norm(
        points - shapes.build("sphere").mesh.center_mass, axis=1, keepdims=True
    )
    assert np.degrees(angles(contacts.normals, radial).max()) < 10.0
    assert np.array_equal(contacts.points, points)
    assert contacts.position_noise is None


@pytest.mark.slow
@pytest.mark.parametrize(("count", "most"), [(20, 21.5), (50, 17.0), (100, 13.5)])
def test_the_error_is_half_of_that_of_propagated_planes(count: int, most: float) -> None:
    """`most` [deg] is a recorded error plus a tenth, without approach."""
    errors, of_planes = [], []
    for seed, name in enumerate(SHAPES):
        points, normals = sampled(name, count, seed)
        errors.append(angles(estimate_normals(points).normals, normals).mean())
        of_planes.append(angles(hoppe_normals(points), normals).mean())
    assert np.degrees(np.mean(errors)) < most
    assert np.mean(errors) < 0.6 * np.mean(of_planes)


@pytest.mark.slow
def test_directions_of_approach_lower_the_error() -> None:
    rng = np.random.default_rng(0)
    errors, alone = [], []
    for seed, name in enumerate(shapes.NAMES):
        points, normals = sampled(name, 20, seed)
        approach = approaches(normals, rng)
        errors.append(angles(estimate_normals(points, approach=approach).normals, normals).mean())
        alone.append(angles(estimate_normals(points).normals, normals).mean())
    assert np.mean(errors) < 0.95 * np.mean(alone)
    # An approach alone is 45 degrees off: the median of the cosine law.
    assert np.degrees(np.mean(errors)) < 30.0


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_the_deviations_cover_the_errors(noise: float) -> None:
    """Edges make errors that are not normal: the 68 % band is wide, the 95 % band right."""
    rng = np.random.default_rng(1)
    scores = []
    for count in (20, 60):
        for seed, name in enumerate(shapes.NAMES):
            points, normals = sampled(name, count, seed)
            points = points + noise * rng.normal(size=points.shape)
            found = estimate_normals(points, approach=approaches(normals, rng))
            errors = components(angles(found.normals, normals), found.normals, normals)
            scores.append(np.abs(errors) / found.normal_noise[:, None])
    pooled = np.concatenate(scores)
    assert 0.63 < np.mean(pooled < 1.0) < 0.83
    assert 0.90 < np.mean(pooled < 1.96) < 0.99


def test_estimation_commutes_with_rigid_motion_and_scale() -> None:
    points, normals = sampled("mallet", 25, 3)
    approach = approaches(normals, np.random.default_rng(2))
    rotation = special_ortho_group.rvs(3, random_state=4)
    plain = estimate_normals(points, approach=approach)
    moved = estimate_normals(
        7.0 * points @ rotation.T + [1.0, -2.0, 3.0], approach=approach @ rotation.T
    )
    # Both are found to the tolerance of the optimiser.
    assert np.degrees(angles(moved.normals, plain.normals @ rotation.T).max()) < 2.0
    assert plain.normal_noise == pytest.approx(moved.normal_noise, rel=0.1)


def test_one_point_needs_a_direction_of_approach() -> None:
    found = estimate_normals([[0.1, 0.0, 0.0]], approach=[[0.0, 0.0, -2.0]])
    assert found.normals == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=1e-3)
    # sqrt(1 / concentration), or less, as the process agrees with nothing else
    assert 0.3 < found.normal_noise[0] < 0.7
    with pytest.raises(InvalidContactsError) as error:
        estimate_normals([[0.1, 0.0, 0.0]])
    assert error.value.field == "points"


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.15, 0.25])
def test_directions_of_known_noise_are_improved_upon(noise: float) -> None:
    rng = np.random.default_rng(10)
    errors, alone, scores = [], [], []
    for seed, name in enumerate(shapes.NAMES):
        for count in (12, 50):
            points, normals = sampled(name, count, seed)
            into = -normals + noise * rng.normal(size=normals.shape)
            into /= np.linalg.norm(into, axis=1, keepdims=True)
            found = estimate_normals(points, approach=into, approach_noise=noise)
            errors.append(angles(found.normals, normals))
            alone.append(angles(-into, normals))
            across = np.abs(components(errors[-1], found.normals, normals))
            scores.append(across / found.normal_noise[:, None])
    assert np.mean(np.concatenate(errors)) < 0.9 * np.mean(np.concatenate(alone))
    pooled = np.concatenate(scores)
    assert 0.68 < np.mean(pooled < 1.0) < 0.88
    assert 0.92 < np.mean(pooled < 1.96) < 0.99


def test_a_flat_patch_is_ambiguous_without_other_evidence() -> None:
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), [0.0]), axis=-1).reshape(-1, 3)
    points = 0.01 * grid
    with pytest.raises(EstimationError, match="outside: add"):
        estimate_normals(points)
    above = [[0.015, 0.015, 0.012]]
    found = estimate_normals(points, free_points=above)
    assert np.all(found.normals[:, 2] > 0.95)
    down = np.tile([0.0, 0.0, -1.0], (16, 1))
    assert np.all(estimate_normals(points, approach=down).normals[:, 2] > 0.95)


def test_some_directions_of_approach_may_be_unknown() -> None:
    points, normals = sampled("torus", 20, 5)
    approach = -normals.copy()
    approach[::2] = 0.0
    found = estimate_normals(points, approach=approach)
    assert np.degrees(angles(found.normals, normals).mean()) < 25.0


@pytest.mark.parametrize("radius", [0.004, pytest.param(0.012, marks=pytest.mark.slow)])
def test_fingertip_centres_are_moved_to_the_surface(radius: float) -> None:
    for name, most in (("sphere", 0.1), ("cylinder", 0.35), ("box", 0.35)):
        mesh = shapes.build(name).mesh
        points, normals = sampled(name, 60, 6)
        found = estimate_normals(points + radius * normals, fingertip_radius=radius)
        _, distances, _ = trimesh.proximity.closest_point(mesh, found.points)
        # radius * (1 - cos(angle)) of normals that are wrong, mostly at edges
        assert np.sqrt(np.mean(distances**2)) < most * radius


@pytest.mark.slow
def test_many_points_take_their_normals_from_neighbours() -> None:
    rng = np.random.default_rng(7)
    points, normals = sampled("torus", 1500, 7)
    found = estimate_normals(points + 0.0002 * rng.normal(size=points.shape))
    errors = angles(found.normals, normals)
    assert np.degrees(errors.mean()) < 6.0
    assert np.mean(errors > 0.5 * np.pi) < 0.005
    scores = np.abs(components(errors, found.normals, normals)) / found.normal_noise[:, None]
    assert 0.58 < np.mean(scores < 1.0) < 0.85


def test_misshapen_input_is_refused() -> None:
    points, _ = sampled("sphere", 10, 0)
    with pytest.raises(InvalidContactsError) as error:
        estimate_normals(points, approach=np.zeros((9, 3)))
    assert error.value.field == "approach"
    with pytest.raises(InvalidContactsError) as error:
        estimate_normals(points[:, :2])
    assert error.value.field == "points"


@pytest.mark.slow
def test_known_noise_is_kept_and_used() -> None:
    rng = np.random.default_rng(8)
    points, normals = sampled("sphere", 60, 8)
    noisy = points + 0.008 * rng.normal(size=points.shape)
    found = estimate_normals(noisy, position_noise=0.008)
    assert np.array_equal(found.position_noise, np.full(60, 0.008))
    unaware = estimate_normals(noisy)
    assert angles(found.normals, normals).mean() < angles(unaware.normals, normals).mean()
    assert isinstance(found, Contacts)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.003, 0.007])
def test_noise_that_is_given_widens_the_deviations_as_much_as_the_errors(noise: float) -> None:
    rng = np.random.default_rng(9)
    scores = []
    for seed, name in enumerate(SHAPES):
        points, normals = sampled(name, 60, seed)
        approach = approaches(normals, rng)
        noisy = points + noise * rng.normal(size=points.shape)
        found = estimate_normals(noisy, approach=approach, position_noise=noise)
        scores.append(angles(found.normals, normals) / np.sqrt(2.0) / found.normal_noise)
    assert 0.75 < np.sqrt(np.mean(np.concatenate(scores) ** 2)) < 1.25
