"""Grasps for other programs: isaac_grasp files, and postures of hands of position servos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import inverse_pose
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.mjcf import moving_joints, servo_efforts
from lis_grasp.typing import FloatArray


def save_isaac_grasps(path: Path | str, search: GraspSearch, hand: Hand) -> None:
    """Write grasps as an isaac_grasp file, version 1.0 (YAML).

    Each grasp has the pose of the hand's base link in the object's frame [m, unit quaternion], the
    actuated joints' positions in contact and opened [rad or m], and as confidence its success
    probability. The format has no contacts and other qualities.
    """
    content = {
        "format": "isaac_grasp",
        "format_version": 1.0,
        "object_frame": "object",
        "gripper_frame": hand.base_link,
        "grasps": {f"grasp_{i}": _plain(g, hand) for i, g in enumerate(search.grasps)},
    }
    with whole_file(Path(path)) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _plain(grasp: Grasp, hand: Hand) -> dict[str, Any]:
    X_OL = grasp.X_OH @ inverse_pose(hand.X_LH)
    x, y, z, w = Rotation.from_matrix(X_OL[:3, :3]).as_quat(canonical=True).tolist()
    return {
        "confidence": grasp.quality.get("success_probability", 0.0),
        "position": X_OL[:3, 3].tolist(),
        "orientation": {"w": w, "xyz": [x, y, z]},
        "cspace_position": dict(
            zip(grasp.joint_names, grasp.joint_positions.tolist(), strict=True)
        ),
        "pregrasp_cspace_position": dict(
            zip(grasp.joint_names, grasp.pregrasp_positions.tolist(), strict=True)
        ),
    }


@dataclass(frozen=True, slots=True, eq=False)
class ServoPostures:
    """Postures of hand and palm in a grasp, on a table at z = 0.

    Each is of shape (7 + K,): position [m] and unit quaternion w, x, y, z of the base link, then
    the joints that move, in the order of `moving_joints` [rad or m].
    """

    pregrasp: FloatArray
    grasp: FloatArray
    squeeze: FloatArray


def servo_postures(hand: Hand, grasp: Grasp, support_height: float) -> ServoPostures:
    """Return the postures of a grasp in O whose table is at a height in O [m]."""
    X_OL = grasp.X_OH @ inverse_pose(hand.X_LH)
    place = X_OL[:3, 3] - [0.0, 0.0, support_height]
    turn = Rotation.from_matrix(X_OL[:3, :3]).as_quat(canonical=True, scalar_first=True)
    joints = moving_joints(hand)

    def posture(q: FloatArray) -> FloatArray:
        return np.concatenate([place, turn, [joint.position(q) for joint in joints]])

    return ServoPostures(
        posture(grasp.pregrasp_positions),
        posture(grasp.joint_positions),
        posture(squeeze_posture(hand, grasp)),
    )


def squeeze_posture(hand: Hand, grasp: Grasp) -> FloatArray:
    """Return the joint positions (J,) at which servos exert a grasp's planned contact forces.

    Efforts ``tau = J^T f`` of the contact points, by the servos' stiffness; within effort limits.
    """
    q = grasp.joint_positions
    poses = hand.forward_kinematics(grasp.X_OH, q)
    centers = hand.pad_centers(grasp.X_OH, q)  # (F, 3)
    efforts = np.zeros(len(q))
    for finger, point, force in zip(
        grasp.contact_fingers, grasp.contact_points, grasp.contact_forces, strict=True
    ):
        if finger not in hand.fingers:
            continue
        f = hand.fingers.index(finger)
        offsets = np.zeros((len(hand.pads), 3))
        offsets[f] = poses[hand.pads[f].link][:3, :3].T @ (point - centers[f])
        _, _, jacobians, _ = hand.pad_jacobians(grasp.X_OH, q, offsets)  # (F, 3, 6 + J)
        efforts += jacobians[f, :, 6:].T @ force
    return q + servo_efforts(hand, np.clip(efforts, -hand.effort_limits, hand.effort_limits))
