"""Poses, rotations and directions in space: what all rooms of the package compute alike.

A pose is a rigid transform, a matrix of shape (4, 4), or where one is given a `RigidTransform` of
Drake (`as_pose`). ``X_AB`` is the pose of frame B in frame A:
a point with the coordinates ``p_B`` in B is at ``apply_pose(X_AB, p_B)`` in A. Lengths are in
metres and angles in radians. Dimensions before those that are named are a batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.records import read_only
from lis_grasp.typing import FloatArray

UNIT_TOLERANCE = 1e-2
"""Deviation of a normal's length from 1 when it is written with few digits; more is a mistake."""

UNIT_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""Upper bound of the rounding error of a normalised length."""

AXES = np.vstack([np.eye(3), -np.eye(3)])
"""Unit vectors along x, y, z and against them, shape (6, 3)."""

# Rounding in products of rotations is far below this.
_ROTATION_TOLERANCE = 1e-6


def as_pose(X: Any) -> FloatArray:
    """Return a pose as an array (..., 4, 4): of an array, or of a `RigidTransform` of Drake.

    >>> as_pose(np.eye(4).tolist()).shape
    (4, 4)
    """
    of_drake = getattr(X, "GetAsMatrix4", None)
    return np.asarray(X if of_drake is None else of_drake(), dtype=np.float64)


def make_pose(R: npt.ArrayLike, p: npt.ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return the pose (..., 4, 4) with a rotation (..., 3, 3) and a translation (..., 3) [m].

    >>> make_pose(np.eye(3), [1.0, 2.0, 3.0])[:3, 3]
    array([1., 2., 3.])
    """
    rotation, translation = np.asarray(R, np.float64), np.asarray(p, np.float64)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    X = np.zeros((*batch, 4, 4))
    X[..., :3, :3], X[..., :3, 3], X[..., 3, 3] = rotation, translation, 1.0
    return X


def apply_pose(X_AB: npt.ArrayLike, points: npt.ArrayLike) -> FloatArray:
    """Return in A the points that are given in B.

    Poses (..., 4, 4) move one point (3,) to (..., 3), or N points (..., N, 3) to (..., N, 3).

    >>> quarter_turn = make_pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.0, 0.0, 2.0])
    >>> apply_pose(quarter_turn, [1.0, 0.0, 0.0])
    array([0., 1., 2.])
    """
    pose, array = as_pose(X_AB), np.asarray(points)
    translations = pose[..., :3, 3]
    if array.ndim > 1:
        translations = translations[..., None, :]
    return np.asarray(array @ np.swapaxes(pose[..., :3, :3], -1, -2) + translations)


def apply_inverse(X_AB: FloatArray, points: FloatArray) -> FloatArray:
    """Return in B the points (..., 3) that are given in A, for one pose (4, 4).

    >>> quarter_turn = make_pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.0, 0.0, 2.0])
    >>> apply_inverse(quarter_turn, np.array([0.0, 1.0, 2.0]))
    array([1., 0., 0.])
    """
    return np.asarray((points - X_AB[:3, 3]) @ X_AB[:3, :3])


def rotate(X_AB: npt.ArrayLike, vectors: npt.ArrayLike) -> FloatArray:
    """Return along A's axes the directions that are given along B's; shapes as in `apply_pose`.

    >>> quarter_turn = make_pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.0, 0.0, 2.0])
    >>> rotate(quarter_turn, [1.0, 0.0, 0.0])
    array([0., 1., 0.])
    """
    return np.asarray(np.asarray(vectors) @ np.swapaxes(as_pose(X_AB)[..., :3, :3], -1, -2))


def rotate_back(X_AB: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return along B's axes the directions (..., 3) along A's, for one pose (4, 4)."""
    return np.asarray(vectors @ X_AB[:3, :3])


def relative_rotation(X_AB: FloatArray, X_AC: FloatArray) -> FloatArray:
    """Return the rotation R_BC (3, 3) of frame C in B, of their poses (4, 4) in A."""
    return np.asarray(X_AB[:3, :3].T @ X_AC[:3, :3])


def inverse_pose(X_AB: npt.ArrayLike) -> FloatArray:
    """Return the poses X_BA of shape (..., 4, 4).

    >>> inverse_pose(make_pose(np.eye(3), [1.0, 2.0, 3.0]))[:3, 3]
    array([-1., -2., -3.])
    """
    return np.asarray(np.linalg.inv(as_pose(X_AB)))


def require_pose(name: str, X: npt.ArrayLike) -> FloatArray:
    """Return a read-only copy of a pose of that name, such as ``"X_OH"``, shape (4, 4).

    Raises `InvalidOptionError` if it is not a rigid transform of finite numbers.
    """
    try:
        pose = as_pose(X).copy()
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (4, 4) or not are_rigid(pose):
        required = "a rigid transform of 4 x 4 finite numbers"
        raise InvalidOptionError.out_of_range(name, X, required)
    return read_only(pose)


def are_rigid(poses: FloatArray) -> bool:
    """Return whether all matrices, shape (..., 4, 4), are finite rotations with translations."""
    rotations = poses[..., :3, :3]
    error = np.abs(rotations @ rotations.swapaxes(-1, -2) - np.eye(3))
    return bool(
        np.isfinite(poses).all()
        and (poses[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
        and (error <= _ROTATION_TOLERANCE).all()
        and (np.linalg.det(rotations) > 0.0).all()
    )


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b, shape (..., 3), faster than NumPy does for few and for short vectors.

    >>> cross(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    array([0., 0., 1.])
    """
    if a.ndim == b.ndim == 1:
        (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
        return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def cross_matrix(axes: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) with which a product is the cross product of axes (..., 3).

    >>> cross_matrix(np.array([0.0, 0.0, 1.0])) @ [1.0, 0.0, 0.0]
    array([0., 1., 0.])
    """
    return np.swapaxes(cross(axes[..., None, :], np.eye(3)), -1, -2)


def unit(vectors: FloatArray, *, least: float = 0.0) -> FloatArray:
    """Return vectors (..., 3) divided by their lengths, or by `least` if that is more.

    >>> unit(np.array([0.0, 0.0, 5.0]))
    array([0., 0., 1.])
    """
    if vectors.ndim == 1:
        return np.asarray(vectors / max(float(np.linalg.norm(vectors)), least))
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), least))


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles [rad], shape (...), between unit vectors (..., 3).

    >>> float(np.degrees(angle_between(np.eye(3)[0], np.eye(3)[1])))
    90.0
    """
    return np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))


def axis_across(directions: FloatArray) -> FloatArray:
    """Return the coordinate axes (..., 3) that are least along directions (..., 3).

    >>> axis_across(np.array([0.8, 0.0, 0.6]))
    array([0., 1., 0.])
    """
    return np.eye(3)[np.argmin(np.abs(directions), axis=-1)]


def tangent_frame(normals: FloatArray) -> FloatArray:
    """Return two unit tangents of unit normals (..., 3), rows of (..., 2, 3).

    First tangent, second tangent and normal are a right-handed frame.

    >>> tangent_frame(np.array([0.0, 0.0, 1.0]))
    array([[ 0.,  1.,  0.],
           [-1.,  0.,  0.]])
    """
    first = unit(cross(normals, axis_across(normals)))
    return np.stack([first, cross(normals, first)], axis=-2)


def frame_along(z: FloatArray, x: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) whose third column is the unit vector z, the first nearest to x.

    >>> frame_along(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 5.0]))
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    first = unit(x - (x @ z) * z)
    return np.column_stack([first, cross(z, first), z])


def hull_crossing(
    equations: FloatArray, points: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where lines enter and leave a convex hull with outward equations (S, 4) [m].

    Both results have the shape of points (..., 3) and directions (..., 3) without the last:
    distances along the direction. A line that misses the hull enters it at infinity. (Clipping of
    a line by half-spaces: Cyrus and Beck 1978.)

    >>> cube = np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.full(6, -1.0)])
    >>> [float(at) for at in hull_crossing(cube, np.array([-3.0, 0.0, 0.0]), np.eye(3)[0])]
    [2.0, 4.0]
    """
    heights = points @ equations[:, :3].T + equations[:, 3]  # (..., S): outside if positive
    slopes = directions @ equations[:, :3].T
    parallel = np.abs(slopes) < 1e-12
    at = -heights / np.where(parallel, 1.0, slopes)
    enter = np.where(slopes < 0.0, at, -np.inf)
    enter = np.where(parallel, np.where(heights > 0.0, np.inf, -np.inf), enter).max(axis=-1)
    leave = np.where((slopes > 0.0) & ~parallel, at, np.inf).min(axis=-1)
    return np.where(enter <= leave, enter, np.inf), leave
