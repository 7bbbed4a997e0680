"""Grasps for other programs: Isaac Sim, MoveIt, and postures of hands of position servos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import needed_package
from lis_grasp.geometry import inverse_pose, rotate_back
from lis_grasp.grasping.grasps import LIFT, STANDOFF, Grasp, GraspSearch
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.records import fields_of
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.mjcf import moving_joints, servo_efforts
from lis_grasp.typing import FloatArray


def save_grasp_table(
    path: Path, grasps: Sequence[Grasp], labels: Sequence[Mapping[str, Any]], *, header: str = ""
) -> None:
    """Write grasps with their labels as Parquet, one row for each; it needs the extra study.

    Columns are the fields of `Grasp`, arrays row by row as lists, each quality under its name, and
    the values of the labels. `header` is kept as metadata ``lis_grasp``.
    """
    with needed_package("pyarrow", "study"):
        import pyarrow
        from pyarrow import parquet
    rows = []
    for grasp, label in zip(grasps, labels, strict=True):
        fields = {n: v for n, v in fields_of(grasp).items() if n != "quality"}
        lists = {n: v.ravel() if isinstance(v, np.ndarray) else v for n, v in fields.items()}
        rows.append({**lists, **grasp.quality, **label})
    table = pyarrow.Table.from_pylist(rows).replace_schema_metadata({"lis_grasp": header})
    with whole_file(path) as temporary:
        parquet.write_table(table, temporary)


def save_isaac_grasps(
    path: Path | str, search: GraspSearch, hand: Hand, labels: Sequence[Mapping[str, Any]] = ()
) -> None:
    """Write grasps as an isaac_grasp file, version 1.0 (YAML).

    Each grasp has the pose of the hand's base link in the object's frame [m, unit quaternion], the
    actuated joints' positions in contact and opened [rad or m], and as confidence its success
    probability; with labels, 1 if it was held, else 0.
    """
    content: dict[str, Any] = {
        "format": "isaac_grasp",
        "format_version": 1.0,
        "object_frame": "object",
        "gripper_frame": hand.base_link,
        "grasps": {f"grasp_{i}": _plain(g, hand) for i, g in enumerate(search.grasps)},
    }
    for entry, label in zip(content["grasps"].values(), labels, strict=bool(labels)):
        entry["confidence"] = float(label["held"])
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


def save_moveit_grasps(
    path: Path | str,
    search: GraspSearch,
    hand: Hand,
    *,
    name: str = "object",
    X_FB: FloatArray | None = None,
) -> None:
    """Write grasps to a YAML file, with the arguments of `moveit_grasps`."""
    grasps = moveit_grasps(search, hand, name=name, X_FB=X_FB)
    with whole_file(Path(path)) as temporary:
        text = yaml.safe_dump(grasps, sort_keys=False, default_flow_style=None)
        temporary.write_text(text, encoding="utf-8")


def moveit_grasps(
    search: GraspSearch, hand: Hand, *, name: str = "object", X_FB: FloatArray | None = None
) -> list[dict[str, Any]]:
    """Return grasps as the fields of `moveit_msgs/msg/Grasp`, in plain values.

    Each has the pose of the link that carries the hand, the actuated joints opened and in contact,
    with the efforts of the planned contact forces, the approach that was checked and a straight
    lift, and as quality its success probability.

    Parameters
    ----------
    search, hand
        The grasps, and their hand.
    name
        The object in the planning scene, whose frame is O and which may be touched.
    X_FB
        Shape (4, 4): the hand's base link in the frame of the link that carries it, such as an
        arm's flange; None for the pose of the base link itself.
    """
    X_HF = inverse_pose(hand.X_LH)
    if X_FB is not None:
        X_HF = X_HF @ inverse_pose(X_FB)
    return [
        {"id": f"grasp_{i}", **_moveit(g, hand, g.X_OH @ X_HF, name)}
        for i, g in enumerate(search.grasps)
    ]


def _moveit(grasp: Grasp, hand: Hand, X_OF: FloatArray, name: str) -> dict[str, Any]:
    def header(frame: str) -> dict[str, Any]:
        return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}

    def posture(positions: FloatArray, efforts: FloatArray) -> dict[str, Any]:
        point = {"positions": positions.tolist(), "velocities": [], "accelerations": []}
        point |= {"effort": efforts.tolist(), "time_from_start": {"sec": 0, "nanosec": 0}}
        names = list(grasp.joint_names)
        return {"header": header(""), "joint_names": names, "points": [point]}

    def motion(direction: FloatArray, distance: float) -> dict[str, Any]:
        vector = {"header": header(name), "vector": _named("xyz", direction)}
        return {"direction": vector, "desired_distance": distance, "min_distance": distance}

    turn = Rotation.from_matrix(X_OF[:3, :3]).as_quat(canonical=True)
    pose = {"position": _named("xyz", X_OF[:3, 3]), "orientation": _named("xyzw", turn)}
    efforts = grip_efforts(hand, grasp)
    return {
        "pre_grasp_posture": posture(grasp.pregrasp_positions, np.zeros(0)),
        "grasp_posture": posture(grasp.joint_positions, efforts),
        "grasp_pose": {"header": header(name), "pose": pose},
        "grasp_quality": grasp.quality.get("success_probability", 0.0),
        "pre_grasp_approach": motion(grasp.approach_O, STANDOFF),
        "post_grasp_retreat": motion(np.array([0.0, 0.0, 1.0]), LIFT),
        "post_place_retreat": motion(-grasp.approach_O, STANDOFF),
        "max_contact_force": hand.max_contact_force,
        "allowed_touch_objects": [name],
    }


def _named(names: str, values: FloatArray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


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

    They are the grasp's positions plus `grip_efforts` divided by the servos' stiffness.
    """
    return grasp.joint_positions + servo_efforts(hand, grip_efforts(hand, grasp))


def grip_efforts(hand: Hand, grasp: Grasp) -> FloatArray:
    """Return the joints' efforts (J,) for a grasp's planned contact forces [N m or N].

    ``tau = J^T f`` of the contact points, within effort limits.
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
        offsets[f] = rotate_back(poses[hand.pads[f].link], point - centers[f])
        _, _, jacobians, _ = hand.pad_jacobians(grasp.X_OH, q, offsets)  # (F, 3, 6 + J)
        efforts += jacobians[f, :, 6:].T @ force
    return np.clip(efforts, -hand.effort_limits, hand.effort_limits)
