"""Writing of isaac_grasp files, the format of NVIDIA's Isaac Sim and Isaac ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import inverse_pose
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.robots.hand import Hand


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
