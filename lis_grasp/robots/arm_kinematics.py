"""Batched forward kinematics and Jacobian of an arm's flange (product of exponentials)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.geometry import cross, cross_matrix, rotate
from lis_grasp.robots.hand_parts import Joint, joints_to
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
                axes.append(rotate(X_AL, joint.axis_J))
                points.append(X_AL[:3, 3])
                turns.append(joint.kind == "revolute")
        self._turns = np.array(turns)  # (J,)
        # Columns: the axis as a direction, and a point on it, in homogeneous coordinates.
        self._lines = np.zeros((len(axes), 4, 2))
        self._lines[:, :3, 0], self._lines[:, :3, 1] = axes, points
        self._lines[:, 3, 1] = 1.0
        self._screws = np.array([_screw(*joint) for joint in zip(axes, points, turns, strict=True)])
        self._squares = self._screws @ self._screws  # zero for joints that slide
        self._X_AF = X_AL @ X_LF

    def flange_poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the poses X_AF, shape (..., 4, 4), at joint positions q (..., J) [rad or m]."""
        return np.asarray(self._moved(np.asarray(q, np.float64))[-1] @ self._X_AF)

    def reach(self, q: FloatArray) -> tuple[FloatArray, float]:
        """Return the middle (3,) of the flange's places in postures q (N, J), and the reach [m].

        The reach is the distance from the middle that 98 % of the places are within.
        """
        places = self.flange_poses(q)[:, :3, 3]
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        return middle, float(np.quantile(np.linalg.norm(places - middle, axis=1), 0.98))

    def jacobians(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the flange's poses X_AF (..., 4, 4) and its Jacobians (..., 6, J) in A.

        Rows 0 to 2 are the velocity of F's origin along A's axes [m/rad or 1], rows 3 to 5 the
        angular velocity [1 or 0], for each joint's rate.
        """
        moved = self._moved(np.asarray(q, np.float64))
        X_AF = moved[-1] @ self._X_AF
        axes, points = self._moved_axes(moved)
        turns = self._turns.reshape(-1, *(1,) * (axes.ndim - 1))
        rows = np.empty((*axes.shape[:-1], 6))  # (J, ..., 6)
        rows[..., :3] = np.where(turns, cross(axes, X_AF[..., :3, 3] - points), axes)
        rows[..., 3:] = turns * axes
        order = (*range(1, rows.ndim), 0)
        return X_AF, rows.transpose(order)

    def axes(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the joints' axes at positions q (..., J), in A.

        They are points on the axes (..., J, 3) [m], directions (..., J, 3), unit, and which joints
        turn, (J,); the others slide.
        """
        axes, points = self._moved_axes(self._moved(np.asarray(q, np.float64)))
        return np.moveaxis(points, 0, -2), np.moveaxis(axes, 0, -2), self._turns

    def _moved_axes(self, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return directions and points of the axes, each (J, ..., 3)."""
        # A joint's axis has been moved by the joints before it, the first by none.
        wide = (1,) * (moved.ndim - 3)
        lines = moved[:-1] @ self._lines.reshape(-1, *wide, 4, 2)
        return lines[..., :3, 0], lines[..., :3, 1]

    def _moved(self, q: FloatArray) -> FloatArray:
        """Return the motions of A by the first 0 to J joints, (J + 1, ..., 4, 4)."""
        wide = (1,) * (q.ndim - 1)
        positions = q.transpose(-1, *range(q.ndim - 1))  # (J, ...)
        turns = self._turns.reshape(-1, *wide)
        first = np.where(turns, np.sin(positions), positions)[..., None, None]
        second = (1.0 - np.cos(positions))[..., None, None]
        # exp(S q) of a screw of no pitch, and of a translation, for which S^2 = 0.
        single = (
            np.eye(4)
            + first * self._screws.reshape(-1, *wide, 4, 4)
            + second * self._squares.reshape(-1, *wide, 4, 4)
        )
        moved = np.empty((len(single) + 1, *single.shape[1:]))
        moved[0] = np.eye(4)
        for j in range(len(single)):
            np.matmul(moved[j], single[j], out=moved[j + 1])
        return moved


def _screw(axis: FloatArray, point: FloatArray, turns: bool) -> FloatArray:
    """Return the matrix (4, 4) of a joint's screw: its rate of motion for a rate of 1."""
    screw = np.zeros((4, 4))
    if turns:
        screw[:3, :3] = cross_matrix(axis)
        screw[:3, 3] = -cross(axis, point)
    else:
        screw[:3, 3] = axis
    return screw
