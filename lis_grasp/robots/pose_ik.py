"""Batched inverse kinematics of an arm by damped least squares, and the error of a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.geometry import as_pose
from lis_grasp.records import read_only
from lis_grasp.robots.kinematics import ArmKinematics
from lis_grasp.typing import BoolArray, FloatArray

POSITION_TOLERANCE = 1e-4
"""Largest distance of a solution from its target [m]."""
ANGLE_TOLERANCE = 1e-3
"""Largest angle between a solution and its target [rad]."""

_ITERATIONS = 15  # most steps from a seed
_DAMPING = 1e-8  # [m^2]: regularises the pseudoinverse
_LARGEST_STEP = 0.4  # of one joint in one iteration [rad or m]
_LENGTH = 0.3  # a turn of 1 rad counts as much as this distance [m]
_STORED = 3000  # random postures from which seeds are taken


@dataclass(frozen=True, slots=True, eq=False)
class ArmSolutions:
    """Joint positions for N targets from S seeds each."""

    q: FloatArray  # (N, S, J) [rad or m]
    solved: BoolArray  # (N, S): within the tolerances and the limits

    @property
    def reached(self) -> BoolArray:
        """Which targets have a solution, shape (N,)."""
        return np.asarray(self.solved.any(axis=1))


class ArmIK:
    """Solves X_AF(q) = target for many targets at once, within joint limits.

    Each iteration takes the step ``dq = J' (J J' + damping)^-1 e`` (Wampler, 1986; Nakamura and
    Hanafusa, 1986) and clips it to the limits. Seeds are the stored random postures whose flange is
    nearest to the target, so that few iterations are enough.

    Parameters
    ----------
    kinematics
        The arm's.
    lower, upper
        Shape (J,): joint limits [rad or m].
    """

    def __init__(self, kinematics: ArmKinematics, lower: FloatArray, upper: FloatArray) -> None:
        self._kinematics, self._lower, self._upper = kinematics, lower, upper
        rng = np.random.default_rng(0)
        # More than a turn of range only repeats postures.
        middle = np.clip(0.0, lower, upper)
        low, high = np.maximum(lower, middle - np.pi), np.minimum(upper, middle + np.pi)
        self.postures = read_only(rng.uniform(low, high, size=(_STORED, len(lower))))
        self._near = cKDTree(_place(kinematics.flange_poses(self.postures)))

    def solve(
        self, X_AF: FloatArray, *, seeds: int = 8, first: FloatArray | None = None
    ) -> ArmSolutions:
        """Return joint positions for targets X_AF, shape (N, 4, 4).

        With `first` (J,) or (N, K, J), these seeds come before the stored ones; then the solutions
        are in the order of the seeds.
        """
        targets = as_pose(X_AF)
        count = len(targets)
        _, nearest = self._near.query(_place(targets), k=seeds)
        start = self.postures[np.reshape(nearest, (count, seeds))]  # (N, S, J)
        if first is not None:
            given = np.asarray(first, np.float64)
            given = np.broadcast_to(given, (count, *np.atleast_2d(given).shape[-2:]))
            start = np.concatenate([given, start], axis=1)
        flat = start.reshape(-1, start.shape[-1]).copy()
        solved = self._descend(flat, np.repeat(targets, start.shape[1], axis=0))
        return ArmSolutions(flat.reshape(start.shape), solved.reshape(start.shape[:2]))

    def follow(self, q: FloatArray, X_AF: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return solutions near given joint positions q (B, J), for a target each, (B, 4, 4)."""
        near = np.array(q, np.float64)
        return near, self._descend(near, X_AF)

    def _descend(self, q: FloatArray, targets: FloatArray) -> BoolArray:
        """Move joint positions (B, J) in place to their targets; return which got there, (B,)."""
        solved = np.zeros(len(q), dtype=bool)
        active = np.arange(len(q))
        weights = np.array([1.0] * 3 + [_LENGTH] * 3)
        for _ in range(_ITERATIONS):
            X, J = self._kinematics.jacobians(q[active])
            error = pose_error(X, targets[active])
            distance = np.linalg.norm(error[:, :3], axis=1)
            angle = np.linalg.norm(error[:, 3:], axis=1)
            there = (distance < POSITION_TOLERANCE) & (angle < ANGLE_TOLERANCE)
            solved[active[there]] = True
            active, J, error = active[~there], J[~there], error[~there]
            if not len(active):
                break
            step = damped_step(J * weights[:, None], error * weights, _DAMPING)
            largest = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-12))
            q[active] = np.clip(q[active] + step, self._lower, self._upper)
        return solved


def damped_step(J: FloatArray, motion: FloatArray, damping: npt.ArrayLike) -> FloatArray:
    """Return joint motions (..., J) for motions (..., 6) of a body, by damped least squares.

    They are ``J' (J J' + damping)^-1 motion``, for Jacobians (..., 6, J) and dampings (...).
    """
    transposed = np.swapaxes(J, -1, -2)
    square = J @ transposed + np.asarray(damping)[..., None, None] * np.eye(6)
    return np.asarray((transposed @ np.linalg.solve(square, motion[..., None]))[..., 0])


def pose_error(X: FloatArray, target: FloatArray) -> FloatArray:
    """Return the motion from poses X to targets, (..., 6): translation [m], rotation vector [rad].

    Both are along the axes in which the poses are given.
    """
    R = target[..., :3, :3] @ np.swapaxes(X[..., :3, :3], -1, -2)
    twice_sine = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]],
        axis=-1,
    )
    length = np.linalg.norm(twice_sine, axis=-1)
    angle = np.arctan2(length, np.trace(R, axis1=-2, axis2=-1) - 1.0)
    # At half a turn the axis is lost; any axis across starts the descent.
    scale = np.where(length > 1e-9, angle / np.maximum(length, 1e-9), 0.5)
    turn = scale[..., None] * twice_sine
    turn[(length <= 1e-9) & (angle > 1.0)] = [np.pi, 0.0, 0.0]
    return np.concatenate([target[..., :3, 3] - X[..., :3, 3], turn], axis=-1)


def _place(X: FloatArray) -> FloatArray:
    """Return poses as points, (N, 9), in which near poses are near."""
    axes = X[:, :3, [0, 2]].reshape(len(X), 6)
    return np.concatenate([X[:, :3, 3], _LENGTH / np.sqrt(2.0) * axes], axis=1)
