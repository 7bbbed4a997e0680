"""Grasps made by hand, for tests of lifts."""

from __future__ import annotations

import numpy as np

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.robots.hand import Hand


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
