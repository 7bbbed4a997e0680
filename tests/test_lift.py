"""Grasp trials: what must hold is held, what must fail fails for the named reason, always the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import trimesh
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lis_grasp.grasping.grasp import Grasp
from lis_grasp.grasping.grip import balanced_grip
from lis_grasp.grasping.hand import Hand

# The palm looks down, the fingers reach over the object along -x, the thumb comes from +x.
_OVER_THE_TOP = np.column_stack([[0, 0, -1], [0, -1, 0], [-1, 0, 0]])
_CURLED = np.array([0.0, 0.9, 0.6, 0.5] * 3 + [1.39, 0.5, 0.3, 0.6])


def allegro_grasp(
    hand: Hand, points: np.ndarray, normals: np.ndarray, fingers: Sequence[str]
) -> Grasp:
    """Return a grasp from above with the named fingertips at points (C, 3) with normals (C, 3)."""
    index = [hand.fingers.index(finger) for finger in fingers]
    centers = points + normals * np.array([hand.pads[i].radius for i in index])[:, None]
    rest = _CURLED
    above = points.mean(axis=0) + [0.04, 0.0, 0.1]

    def pose(x: np.ndarray) -> np.ndarray:
        X_OH = np.eye(4)
        X_OH[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ _OVER_THE_TOP
        X_OH[:3, 3] = x[3:6]
        return X_OH

    def residual(x: np.ndarray) -> np.ndarray:
        reached = hand.pad_centers(pose(x), x[6:])[index]
        return np.concatenate([100.0 * (reached - centers).ravel(), 0.05 * (x[6:] - rest), x[:3]])

    start = np.concatenate([np.zeros(3), above, np.clip(rest, hand.lower, hand.upper)])
    lower = np.concatenate([[-1.0] * 3, above - 0.15, hand.lower])
    upper = np.concatenate([[1.0] * 3, above + 0.15, hand.upper])
    x = least_squares(residual, start, bounds=(lower, upper)).x
    opened = x[6:].copy()
    for finger in hand.fingers:
        opened[list(hand.finger_joints(finger))[1:]] -= [0.25, 0.15, 0.1]
    return Grasp(
        hand=hand.name,
        X_OH=pose(x),
        joint_names=hand.joint_names,
        joint_positions=x[6:],
        pregrasp_positions=np.clip(opened, hand.lower, hand.upper),
        approach_O=pose(x)[:3, :3] @ hand.approach_H,
        contact_points=points,
        contact_normals=normals,
        contact_fingers=tuple(fingers),
        contact_forces=balanced_grip(points, normals, friction=0.5, total=10.0),
        quality={"epsilon": 0.0},
        accepted="made by hand",
    )


def jaw_grasp(hand: Hand, center: np.ndarray, width: float) -> Grasp:
    """Return a grasp from above with the jaws on both sides, along x, of an object of a width."""
    X_OH = np.eye(4)
    X_OH[:3, :3] = np.column_stack([[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    q = np.full(2, 0.5 * width)
    X_OH[:3, 3] = center - hand.pad_centers(X_OH, q).mean(axis=0)
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    return Grasp(
        hand=hand.name,
        X_OH=X_OH,
        joint_names=hand.joint_names,
        joint_positions=q,
        pregrasp_positions=np.minimum(q + 0.02, hand.upper),
        approach_O=X_OH[:3, :3] @ hand.approach_H,
        contact_points=center + 0.5 * width * normals,
        contact_normals=normals,
        contact_fingers=hand.fingers,
        contact_forces=-10.0 * normals,
        quality={"epsilon": 0.0},
        accepted="made by hand",
    )


def box_grasp(hand: Hand) -> Grasp:
    """Return a four-finger grasp of the box of `box_mesh`, a little above its middle."""
    points = np.array([[-0.025, y, 0.02] for y in (-0.025, 0.0, 0.025)] + [[0.025, 0.0, 0.02]])
    normals = np.array([[-1.0, 0.0, 0.0]] * 3 + [[1.0, 0.0, 0.0]])
    return allegro_grasp(hand, points, normals, ("index", "middle", "ring", "thumb"))


def box_mesh() -> trimesh.Trimesh:
    return trimesh.creation.box([0.05, 0.07, 0.10])
