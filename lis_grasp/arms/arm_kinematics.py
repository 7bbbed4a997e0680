"""Batched forward kinematics and Jacobian of an arm's flange (product of exponentials)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.hands.hand_parts import Joint, joints_to
from lis_grasp.typing import BoolArray, FloatArray


class ArmKinematics:
    """The joints from an arm's base link A to its flange frame F, as screws in A.

    ``X_AF(q) = exp(S_1 q_1) ... exp(S_J q_J) X_AF(0)`` (Brockett, 1984; Lynch and Park, Modern
    Robotics, 2017, eq. 4.14): each joint turns about, or slides along, its axis in the arm's zero
    posture.

    Parameters
    ----------
    joints
        All joints of the arm, a parent before its children.
    flange
        The link that carries the flange frame.
    X_LF
        Shape (4, 4): the flange frame in that link.
    """

    def __init__(self, joints: Sequence[Joint], flange: str, X_LF: FloatArray) -> None:
        X_AL = np.eye(4)
        axes, points, turns = [], [], []
        for joint in joints_to(joints, flange):
            X_AL = X_AL @ joint.X_PJ
            if joint.kind != "fixed":
                axes.append(X_AL[:3, :3] @ joint.axis_J)
                points.append(X_AL[:3, 3])
                turns.append(joint.kind == "revolute")
        self._axes = np.array(axes)  # (J, 3)
        self._points = np.array(points)  # (J, 3)
        self._turns = np.array(turns)[:, None]  # (J, 1)
        self._X_AF = X_AL @ X_LF
        self._crossed = np.swapaxes(np.cross(self._axes[:, None], np.eye(3)), 1, 2)  # [axis]x
        self._crossed_twice = self._crossed @ self._crossed

    def flange_poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the poses X_AF, shape (..., 4, 4), at joint positions q (..., J) [rad or m]."""
        R, p = self._moved(np.asarray(q, np.float64))
        return _pose(R[-1] @ self._X_AF[:3, :3], R[-1] @ self._X_AF[:3, 3] + p[-1])

    def jacobians(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the flange's poses X_AF (..., 4, 4) and its Jacobians (..., 6, J) in A.

        Rows 0 to 2 are the velocity of F's origin along A's axes [m/rad or 1], rows 3 to 5 the
        angular velocity [1 or 0], for each joint's rate.
        """
        R, p = self._moved(np.asarray(q, np.float64))
        X_AF = _pose(R[-1] @ self._X_AF[:3, :3], R[-1] @ self._X_AF[:3, 3] + p[-1])
        axes, points = self._moved_axes(R, p)
        turns = self._turns.reshape(-1, *(1,) * (axes.ndim - 1))
        linear = np.where(turns, np.cross(axes, X_AF[..., :3, 3] - points), axes)
        rows = np.concatenate([linear, np.where(turns, axes, 0.0)], axis=-1)  # (J, ..., 6)
        return X_AF, np.moveaxis(rows, 0, -1)

    def axes(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the joints' axes at positions q (..., J), in A.

        They are points on the axes (..., J, 3) [m], directions (..., J, 3), unit, and which joints
        turn, (J,); the others slide.
        """
        axes, points = self._moved_axes(*self._moved(np.asarray(q, np.float64)))
        return np.moveaxis(points, 0, -2), np.moveaxis(axes, 0, -2), self._turns[:, 0]

    def _moved_axes(self, R: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return directions and points of the axes, each (J, ..., 3)."""
        # A joint's axis has been moved by the joints before it: R[j], p[j], the first by none.
        axes = (R[:-1] @ _column(self._axes, R))[..., 0]
        return axes, (R[:-1] @ _column(self._points, R))[..., 0] + p[:-1]

    def _moved(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the motions of A by the first 0 to J joints: (J + 1, ..., 3, 3), (..., 3)."""
        batch = q.shape[:-1]
        wide = (-1, *(1,) * len(batch))
        angle = np.moveaxis(q, -1, 0)[..., None, None]  # (J, ..., 1, 1)
        turned = np.where(self._turns[..., None].reshape(*wide, 1, 1), angle, 0.0)
        # Rodrigues' formula.
        turn = (
            np.eye(3)
            + np.sin(turned) * self._crossed.reshape(*wide, 3, 3)
            + (1.0 - np.cos(turned)) * self._crossed_twice.reshape(*wide, 3, 3)
        )
        points, axes = (a.reshape(*wide, 3) for a in (self._points, self._axes))
        shift = np.where(
            self._turns.reshape(*wide, 1),
            points - (turn @ points[..., None])[..., 0],
            angle[..., 0] * axes,
        )
        R = np.empty((len(turn) + 1, *batch, 3, 3))
        p = np.empty((len(turn) + 1, *batch, 3))
        R[0], p[0] = np.eye(3), 0.0
        for j in range(len(turn)):
            p[j + 1] = (R[j] @ shift[j][..., None])[..., 0] + p[j]
            np.matmul(R[j], turn[j], out=R[j + 1])
        return R, p


def _column(vectors: FloatArray, R: FloatArray) -> FloatArray:
    return vectors.reshape(len(vectors), *(1,) * (R.ndim - 3), 3, 1)


def _pose(R: FloatArray, p: FloatArray) -> FloatArray:
    X = np.zeros((*p.shape[:-1], 4, 4))
    X[..., :3, :3], X[..., :3, 3], X[..., 3, 3] = R, p, 1.0
    return X
