"""Poses, cross products, angles and frames across normals, against closed forms and laws."""

import doctest

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lis_grasp import geometry
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import (
    angle_between,
    apply_inverse,
    apply_pose,
    axis_across,
    cross,
    cross_matrix,
    frame_along,
    inverse_pose,
    make_pose,
    relative_rotation,
    require_pose,
    rotate,
    rotate_back,
    tangent_frame,
    unit,
)
from lis_grasp.typing import FloatArray


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def _poses(rng: np.random.Generator, count: int) -> FloatArray:
    return make_pose(Rotation.random(count, rng=rng).as_matrix(), rng.normal(size=(count, 3)))


def _directions(rng: np.random.Generator, count: int) -> FloatArray:
    """Return random unit vectors, the axes of all signs, and vectors very near to the axes."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    near = axes + 1e-9 * rng.normal(size=axes.shape)
    return np.vstack([unit(rng.normal(size=(count, 3))), axes, unit(near)])


def test_the_examples_of_the_docstrings_are_true() -> None:
    done = doctest.testmod(geometry)
    assert done.failed == 0
    assert done.attempted > 10


def test_a_pose_turns_about_its_origin_and_then_moves() -> None:
    X = make_pose(Rotation.from_euler("z", 90.0, degrees=True).as_matrix(), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(apply_pose(X, [1.0, 0.0, 0.0]), [0.1, 1.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(rotate(X, [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(X[3], [0.0, 0.0, 0.0, 1.0])


def test_poses_agree_with_homogeneous_coordinates(rng: np.random.Generator) -> None:
    X, points = _poses(rng, 1)[0], rng.normal(size=(50, 3))
    homogeneous = np.column_stack([points, np.ones(50)]) @ X.T
    np.testing.assert_allclose(apply_pose(X, points), homogeneous[:, :3], atol=1e-14)


def test_poses_are_a_group(rng: np.random.Generator) -> None:
    X, Y = _poses(rng, 20), _poses(rng, 20)
    points = rng.normal(size=(20, 5, 3))
    np.testing.assert_allclose(
        apply_pose(X @ Y, points), apply_pose(X, apply_pose(Y, points)), atol=1e-13
    )
    np.testing.assert_allclose(apply_pose(make_pose(np.eye(3)), points), points, atol=0.0)
    np.testing.assert_allclose(inverse_pose(X) @ X, np.tile(np.eye(4), (20, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(inverse_pose(X @ Y), inverse_pose(Y) @ inverse_pose(X), atol=1e-13)


def test_an_inverse_is_the_transpose_and_the_point_moved_back(rng: np.random.Generator) -> None:
    for X in _poses(rng, 20):
        R, p, points = X[:3, :3], X[:3, 3], rng.normal(size=(4, 3))
        np.testing.assert_allclose(inverse_pose(X), make_pose(R.T, -R.T @ p), atol=1e-14)
        np.testing.assert_allclose(apply_inverse(X, apply_pose(X, points)), points, atol=1e-14)
        np.testing.assert_allclose(
            apply_inverse(X, points[0]), apply_pose(inverse_pose(X), points[0]), atol=1e-14
        )


def test_poses_keep_distances_and_the_sense_of_turning(rng: np.random.Generator) -> None:
    X, (a, b) = _poses(rng, 1)[0], rng.normal(size=(2, 3))
    assert np.linalg.norm(apply_pose(X, a) - apply_pose(X, b)) == pytest.approx(
        np.linalg.norm(a - b)
    )
    np.testing.assert_allclose(cross(rotate(X, a), rotate(X, b)), rotate(X, cross(a, b)))


def test_batches_of_poses_are_single_poses(rng: np.random.Generator) -> None:
    X, points, point = _poses(rng, 6).reshape(2, 3, 4, 4), rng.normal(size=(2, 3, 5, 3)), [1, 2, 3]
    for i, j in np.ndindex(2, 3):
        for function in (apply_pose, rotate):
            np.testing.assert_allclose(
                function(X, points)[i, j], function(X[i, j], points[i, j]), atol=1e-14
            )
            np.testing.assert_allclose(function(X, point)[i, j], function(X[i, j], point))
            np.testing.assert_allclose(
                function(X[i, j], points)[i, j], function(X[i, j], points[i, j]), atol=1e-14
            )
        np.testing.assert_allclose(inverse_pose(X)[i, j], inverse_pose(X[i, j]))
    assert apply_pose(X, point).shape == (2, 3, 3)
    assert apply_pose(X[0, 0], np.zeros((0, 3))).shape == (0, 3)
    assert make_pose(X[..., :3, :3], np.zeros((7, 1, 1, 3))).shape == (7, 2, 3, 4, 4)


@pytest.mark.parametrize(("a", "b"), [((3,), (3,)), ((4, 3), (3,)), ((5, 1, 3), (1, 4, 3))])
def test_cross_is_that_of_numpy(
    rng: np.random.Generator, a: tuple[int, ...], b: tuple[int, ...]
) -> None:
    first, second = rng.normal(size=a), rng.normal(size=b)
    np.testing.assert_array_equal(cross(first, second), np.cross(first, second))
    product = (cross_matrix(first) @ second[..., None])[..., 0]
    np.testing.assert_allclose(product, np.cross(first, second), atol=1e-15)


def test_unit_vectors_have_length_one(rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(4, 5, 3)) * 10.0 ** rng.uniform(-9.0, 9.0, size=(4, 5, 1))
    np.testing.assert_allclose(np.linalg.norm(unit(vectors), axis=-1), 1.0)
    np.testing.assert_allclose(unit(vectors)[2, 3], unit(vectors[2, 3]), atol=1e-15)
    np.testing.assert_array_equal(unit(np.zeros(3), least=1e-9), np.zeros(3))
    np.testing.assert_allclose(unit(np.full((2, 3), 1e-9), least=1.0), 1e-9)


def test_angles_are_those_of_turns_and_never_nan(rng: np.random.Generator) -> None:
    angles = np.linspace(0.0, np.pi, 19)
    turned = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(19)])
    np.testing.assert_allclose(angle_between(turned, np.eye(3)[0]), angles, atol=1e-7)
    directions = _directions(rng, 1000)
    assert angle_between(directions, directions).max() < 1e-7
    np.testing.assert_allclose(angle_between(directions, -directions), np.pi, atol=1e-7)


def test_tangents_and_normal_are_a_right_handed_frame(rng: np.random.Generator) -> None:
    normals = _directions(rng, 500)
    frames = np.concatenate([tangent_frame(normals), normals[:, None]], axis=1)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, -1, -2), np.tile(np.eye(3), (len(normals), 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    for normal, frame in zip(normals, tangent_frame(normals), strict=True):
        np.testing.assert_allclose(tangent_frame(normal), frame, atol=1e-15)


def test_the_axis_across_a_direction_is_far_from_it(rng: np.random.Generator) -> None:
    directions = _directions(rng, 500)
    assert np.abs(np.sum(axis_across(directions) * directions, axis=1)).max() <= 1 / np.sqrt(3.0)


def test_a_frame_along_z_has_its_x_nearest_to_the_wanted_one(rng: np.random.Generator) -> None:
    for z, x in zip(unit(rng.normal(size=(50, 3))), rng.normal(size=(50, 3)), strict=True):
        R = frame_along(z, x)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_array_equal(R[:, 2], z)
        assert R[:, 0] @ x == pytest.approx(np.linalg.norm(np.cross(z, x)))
        assert R[:, 1] @ x == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "X",
    [
        2.0 * np.eye(4),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.full((4, 4), np.nan),
        np.eye(3),
        "X_OH",
        np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [1.0, 0, 0, 1.0]]),
    ],
)
def test_what_is_no_pose_is_refused(X: object) -> None:
    with pytest.raises(InvalidOptionError) as error:
        require_pose("X_OH", X)  # type: ignore[arg-type]
    assert error.value.option == "X_OH"


def test_a_required_pose_is_a_copy_that_cannot_be_changed(rng: np.random.Generator) -> None:
    X = _poses(rng, 1)[0]
    pose = require_pose("X_OH", X)
    np.testing.assert_array_equal(pose, X)
    assert not pose.flags.writeable
    assert X.flags.writeable


def test_directions_turned_back_and_relative_rotations_undo_poses() -> None:
    rng = np.random.default_rng(0)
    X, Y = make_pose(Rotation.random(2, random_state=0).as_matrix(), rng.normal(size=(2, 3)))
    vectors = rng.normal(size=(5, 3))
    # Sums of three products of numbers of about 1.
    np.testing.assert_allclose(rotate_back(X, rotate(X, vectors)), vectors, atol=1e-14)
    np.testing.assert_allclose(relative_rotation(X, X @ Y), Y[:3, :3], atol=1e-14)
