"""Batched forward kinematics of a hand's links and pads, and Jacobians of the pads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.geometry import as_pose, cross, cross_matrix, inverse_pose, rotate
from lis_grasp.robots.robot_model import Joint, Pad, RobotModel, joints_to
from lis_grasp.typing import BoolArray, FloatArray


class Kinematics:
    """The joints and pads of a hand, as arrays.

    Batches are small and frequent, so the number of NumPy calls counts: all joints turn in one, and
    all pads move with all of their joints in one. In this class the joint, link or pad is the first
    dimension of an array, and the batch (...) follows. Arguments are as in `Hand`; `actuated` is J,
    the number of joints with a motor.
    """

    def __init__(
        self,
        links: Sequence[str],
        joints: Sequence[Joint],
        pads: Sequence[Pad],
        *,
        X_LH: FloatArray,
        actuated: int,
    ) -> None:
        self._links, self._actuated = tuple(links), actuated
        self._X_HL = inverse_pose(X_LH)
        number = {link: i for i, link in enumerate(links)}
        self._parents = [number[joint.parent] for joint in joints]
        self._children = [number[joint.child] for joint in joints]
        self._X_PJ = np.array([joint.X_PJ for joint in joints]).reshape(-1, 4, 4)
        axes = np.array([joint.axis_J for joint in joints]).reshape(-1, 3)
        turns = np.array([joint.kind == "revolute" for joint in joints], dtype=bool)
        slides = np.array([joint.kind == "prismatic" for joint in joints], dtype=bool)
        # A fixed joint takes the position of joint 0, and has no axis to move along.
        self._index = np.array([max(joint.index, 0) for joint in joints], dtype=np.intp)
        self._multipliers = np.array([joint.multiplier for joint in joints])
        self._offsets = np.array([joint.offset for joint in joints])
        turn_axes, self._slide_axes = axes * turns[:, None], axes * slides[:, None]
        # (N, 3, 3): the matrices [axis]x of Rodrigues' formula.
        self._crossed = cross_matrix(turn_axes)
        self._crossed_twice = self._crossed @ self._crossed

        self._pad_links = [number[pad.link] for pad in pads]
        self._pad_centers = np.array([pad.center_L for pad in pads]).reshape(-1, 3)
        self._pad_axes = np.array([pad.axis_L for pad in pads]).reshape(-1, 3)
        # Pairs of a pad and a joint that moves it, P of them.
        by_child = {joint.child: n for n, joint in enumerate(joints)}
        chains = [[by_child[j.child] for j in joints_to(joints, pad.link)[::-1]] for pad in pads]
        pairs = [(f, n) for f, chain in enumerate(chains) for n in chain if turns[n] or slides[n]]
        self._moved, moving = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        self._moving_links = np.array(self._children, dtype=np.intp)[moving]
        self._moving_turns, self._moving_slides = turn_axes[moving], self._slide_axes[moving]
        # Column of the Jacobian for the motion of each pair, with the joint's multiplier.
        self._columns = np.zeros((len(pads), 6 + actuated, len(pairs)))
        column = 6 + self._index[moving]
        self._columns[self._moved, column, range(len(pairs))] = self._multipliers[moving]

    def poses(self, X_OH: npt.ArrayLike, q: npt.ArrayLike) -> dict[str, FloatArray]:
        """Return the pose of each link; see `Hand.forward_kinematics`."""
        return dict(zip(self._links, self.arrays(X_OH, q), strict=True))

    def arrays(self, X_OH: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
        """Return the poses of all links, (L, ..., 4, 4)."""
        return self._poses(*self._broadcast(X_OH, q))

    def pads(
        self, X_OH: npt.ArrayLike, q: npt.ArrayLike, offsets: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the pads' centres and axes; see `Hand.pad_centers`."""
        centers, axes = self._pads(self._poses(*self._broadcast(X_OH, q)), offsets)
        return np.moveaxis(centers, 0, -2), np.moveaxis(axes, 0, -2)

    def pad_jacobians(
        self, X_OH: npt.ArrayLike, q: npt.ArrayLike, offsets: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the pads' centres, axes and Jacobians; see `Hand.pad_jacobians`."""
        X_OH, q = self._broadcast(X_OH, q)
        poses = self._poses(X_OH, q)
        centers, axes = self._pads(poses, offsets)
        X_OC = poses[self._moving_links]  # (P, ..., 4, 4)
        # A joint's axis is the same in the child link's frame as in the joint frame.
        turn = _rotated(X_OC, self._moving_turns)
        slide = _rotated(X_OC, self._moving_slides)
        arms = centers[self._moved] - X_OC[..., :3, 3]
        of_centers = np.tensordot(self._columns, cross(turn, arms) + slide, axes=1)
        of_axes = np.tensordot(self._columns, cross(turn, axes[self._moved]), axes=1)
        along = np.eye(3).reshape(3, *(1,) * (q.ndim - 1), 3)  # O's axes, (3, ..., 3)
        of_centers[:, 0:3] = cross(along, (centers - X_OH[..., :3, 3])[:, None])
        of_centers[:, 3:6] = along
        of_axes[:, 0:3] = cross(along, axes[:, None])
        return (
            np.moveaxis(centers, 0, -2),
            np.moveaxis(axes, 0, -2),
            np.moveaxis(of_centers, (0, 1), (-3, -1)),
            np.moveaxis(of_axes, (0, 1), (-3, -1)),
        )

    def _broadcast(self, X_OH: npt.ArrayLike, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return palm poses (..., 4, 4) and joint positions (..., J) of one batch."""
        poses, positions = as_pose(X_OH), np.asarray(q, np.float64)
        batch = np.broadcast_shapes(poses.shape[:-2], positions.shape[:-1])
        return (
            np.broadcast_to(poses, (*batch, 4, 4)),
            np.broadcast_to(positions, (*batch, self._actuated)),
        )

    def _poses(self, X_OH: FloatArray, q: FloatArray) -> FloatArray:
        """Return the poses of all links, shape (L, ..., 4, 4)."""
        poses = np.empty((len(self._links), *q.shape[:-1], 4, 4))
        poses[0] = X_OH @ self._X_HL
        for parent, child, X_PC in zip(self._parents, self._children, self._X_PC(q), strict=True):
            np.matmul(poses[parent], X_PC, out=poses[child])
        return poses

    def _X_PC(self, q: FloatArray) -> FloatArray:
        """Return the pose of each joint's child in its parent, shape (N, ..., 4, 4)."""
        batch = (1,) * (q.ndim - 1)
        positions = np.moveaxis(self._multipliers * q[..., self._index] + self._offsets, -1, 0)
        sine, cosine = np.sin(positions)[..., None, None], np.cos(positions)[..., None, None]
        X_JC = np.zeros((*positions.shape, 4, 4))
        # Rodrigues' formula.
        X_JC[..., :3, :3] = (
            np.eye(3)
            + sine * self._crossed.reshape(-1, *batch, 3, 3)
            + (1.0 - cosine) * self._crossed_twice.reshape(-1, *batch, 3, 3)
        )
        X_JC[..., :3, 3] = positions[..., None] * self._slide_axes.reshape(-1, *batch, 3)
        X_JC[..., 3, 3] = 1.0
        return np.asarray(self._X_PJ.reshape(-1, *batch, 4, 4) @ X_JC)

    def _pads(self, poses: FloatArray, offsets: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return the pads' centres and axes, each of shape (F, ..., 3)."""
        X_OL = poses[self._pad_links]
        centers = _rotated(X_OL, self._pad_centers) + X_OL[..., :3, 3]
        if offsets is not None:
            centers += rotate(X_OL, np.moveaxis(offsets, -2, 0)[..., None, :])[..., 0, :]
        return centers, _rotated(X_OL, self._pad_axes)


class ArmKinematics:
    """The flange frame F of an arm in its base link's frame A, and how the joints move it.

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
        chain = joints_to(joints, flange)
        links = [chain[0].parent, *(joint.child for joint in chain)]
        moving = [n for n, joint in enumerate(chain) if joint.kind != "fixed"]
        self._chain = Kinematics(links, chain, (), X_LH=np.eye(4), actuated=len(moving))
        self._moved = [n + 1 for n in moving]
        self._axes = np.array([chain[n].axis_J for n in moving])
        self._turns = np.array([chain[n].kind == "revolute" for n in moving])  # (J,)
        self._X_LF = X_LF

    def flange_poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the poses X_AF, shape (..., 4, 4), at joint positions q (..., J) [rad or m]."""
        return np.asarray(self._chain.arrays(np.eye(4), q)[-1] @ self._X_LF)

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
        links = self._chain.arrays(np.eye(4), q)
        X_AF = links[-1] @ self._X_LF
        moved = links[self._moved]
        axes = _rotated(moved, self._axes)  # (J, ..., 3)
        turns = self._turns.reshape(-1, *(1,) * (axes.ndim - 1))
        rows = np.empty((*axes.shape[:-1], 6))  # (J, ..., 6)
        rows[..., :3] = np.where(turns, cross(axes, X_AF[..., :3, 3] - moved[..., :3, 3]), axes)
        rows[..., 3:] = turns * axes
        return X_AF, rows.transpose(*range(1, rows.ndim), 0)

    def axes(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the joints' axes at positions q (..., J), in A.

        They are points on the axes (..., J, 3) [m], directions (..., J, 3), unit, and which joints
        turn, (J,); the others slide.
        """
        moved = self._chain.arrays(np.eye(4), q)[self._moved]
        points, axes = moved[..., :3, 3], _rotated(moved, self._axes)
        return np.moveaxis(points, 0, -2), np.moveaxis(axes, 0, -2), self._turns


def link_kinematics(model: RobotModel) -> Kinematics:
    """Return the kinematics of a tree without pads, in the frame of its base link."""
    actuated = len(model.joint_names)
    return Kinematics(model.links, model.joints, (), X_LH=np.eye(4), actuated=actuated)


def body_poses(model: RobotModel, q: FloatArray) -> FloatArray:
    """Return the poses of all bodies in the base link, (..., G, 4, 4), at postures q (..., J)."""
    links = link_kinematics(model).poses(np.eye(4), q)
    return np.stack([links[g.link] @ g.X_LG for g in model.link_geometries], axis=-3)


def _rotated(X: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate each vector (K, 3) by its poses (K, ..., 4, 4); shape (K, ..., 3)."""
    rows = vectors.reshape(len(vectors), *(1,) * (X.ndim - 2), 3)
    return np.asarray(rotate(X, rows)[..., 0, :])
