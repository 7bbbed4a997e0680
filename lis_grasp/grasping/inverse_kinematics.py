"""Batched inverse kinematics of a hand for contacts of its pads (Levenberg-Marquardt)."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import angle_between
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray, IndexArray

_ITERATIONS = 20
_DAMPING = 1e-3
# Converged: a step lowers the cost by less than this fraction; stuck: more damping than this.
_SETTLED, _STUCK = 1e-4, 1e3
# Units of the residuals: a pad off by 1 mm weighs as much as a contact outside its pad by 0.1 (in
# the cosine).
_POSITION_UNIT = 1e-3
_AXIS_UNIT = 0.1
# Contacts are kept within this fraction of a pad's half angle.
_PAD_FRACTION = 0.8


def solve_ik(hand: Hand, batch: GraspBatch, *, palm_fixed: bool = False) -> GraspBatch:
    """Return grasps with the palm poses and joint positions whose pads touch the contacts.

    Minimises for each candidate the sum of squares of two residuals: pad centres, or other points
    of the pads (`GraspBatch.offsets`), off ``p + radius n``; contacts beyond the pad's half angle.
    Levenberg-Marquardt with projection on the joint limits: a step that does not improve a
    candidate is undone and its damping raised (Marquardt 1963).

    The postures of the batch are the initial guess; damped steps go no farther from it than needed.
    With `palm_fixed` only the joints may move.
    """
    problem = _Problem(hand, batch, palm_fixed)
    X, joints = batch.X_OH.copy(), np.clip(batch.q, hand.lower, hand.upper)
    residual, jacobian = problem.linearise(X, joints)
    cost = (residual**2).sum(axis=-1)
    damping = np.full(len(X), _DAMPING)
    identity = np.eye(jacobian.shape[-1])
    moving = np.arange(len(X))  # candidates that have not converged, (M,)
    for _ in range(_ITERATIONS):
        if not len(moving):
            break
        J = jacobian[moving]
        normal = np.swapaxes(J, -1, -2) @ J  # (M, U, U)
        scale = damping[moving] * np.einsum("buu->bu", normal).mean(axis=-1)
        rhs = np.einsum("bru,br->bu", J, residual[moving])
        step = -np.linalg.solve(normal + scale[:, None, None] * identity, rhs[..., None])[..., 0]
        X_new, joints_new = problem.move(X[moving], joints[moving], step)
        residual_new, jacobian_new = problem.subset(moving).linearise(X_new, joints_new)
        cost_new = (residual_new**2).sum(axis=-1)
        better = cost_new < cost[moving]
        index = moving[better]
        X[index], joints[index] = X_new[better], joints_new[better]
        residual[index], jacobian[index] = residual_new[better], jacobian_new[better]
        settled = better & (cost[moving] - cost_new < _SETTLED * cost[moving])
        cost[index] = cost_new[better]
        factor = np.where(better, 1.0 / 3.0, 5.0)
        damping[moving] = np.maximum(damping[moving] * factor, 1e-7)
        moving = moving[~settled & (damping[moving] < _STUCK)]
    position, axis = problem.errors(X, joints)
    return replace(batch, X_OH=X, q=joints, position_error=position, axis_error=axis)


class _Problem:
    """Residuals of a batch of candidates and their Jacobian by palm and joints."""

    _BY_CANDIDATE = ("_centers", "_normals", "_used", "_offsets")

    def __init__(self, hand: Hand, batch: GraspBatch, palm_fixed: bool) -> None:
        self._hand = hand
        radii = np.array([pad.radius for pad in hand.pads])
        self._centers = batch.points + radii[:, None] * batch.normals  # (B, F, 3)
        self._normals = batch.normals
        self._used, self._offsets = batch.used, batch.offsets
        self._half_angles = np.array([pad.half_angle for pad in hand.pads])
        self._least_cosine = np.cos(_PAD_FRACTION * self._half_angles)  # (F,)
        self._free = np.ones(6 + len(hand.joint_names))
        if palm_fixed:
            self._free[:6] = 0.0

    def subset(self, index: IndexArray) -> _Problem:
        """Return the problem of some of the candidates."""
        part = copy(self)
        for name in self._BY_CANDIDATE:
            value = getattr(self, name)
            setattr(part, name, None if value is None else value[index])
        return part

    def linearise(self, X: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (B, R) and their Jacobian (B, R, 6 + J)."""
        hand, used = self._hand, self._used
        rows = (len(X), 3 * used.shape[1])
        centers, axes, J_centers, J_axes = hand.pad_jacobians(X, q, self._offsets)
        position = np.where(used[..., None], centers - self._centers, 0.0) / _POSITION_UNIT
        J_position = np.where(used[..., None, None], J_centers, 0.0) / _POSITION_UNIT
        cosine = -(axes * self._normals).sum(axis=-1)  # (B, F)
        outside = used & (cosine < self._least_cosine)
        axis = np.where(outside, self._least_cosine - cosine, 0.0) / _AXIS_UNIT
        J_cosine = -np.einsum("bfku,bfk->bfu", J_axes, self._normals)
        J_axis = np.where(outside[..., None], -J_cosine, 0.0) / _AXIS_UNIT
        residual = np.concatenate([position.reshape(rows), axis], axis=1)
        J_position = J_position.reshape(*rows, 6 + q.shape[1])
        jacobian = np.concatenate([J_position, J_axis], axis=1)
        return residual, jacobian * self._free

    def move(self, X: FloatArray, q: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return palm and joints after a step (B, 6 + J), the joints within their limits."""
        step = step * self._free
        moved = X.copy()
        moved[:, :3, :3] = Rotation.from_rotvec(step[:, :3]).as_matrix() @ X[:, :3, :3]
        moved[:, :3, 3] += step[:, 3:6]
        return moved, np.clip(q + step[:, 6:], self._hand.lower, self._hand.upper)

    def errors(self, X: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest position and axis error of the used pads, (B,) [m] and [rad]."""
        off = np.linalg.norm(self._hand.pad_centers(X, q, self._offsets) - self._centers, axis=-1)
        angles = angle_between(-self._hand.pad_axes(X, q), self._normals)
        beyond = np.maximum(angles - self._half_angles, 0.0)
        return (
            np.where(self._used, off, 0.0).max(axis=1),
            np.where(self._used, beyond, 0.0).max(axis=1),
        )
