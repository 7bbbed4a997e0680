"""Writing of grasps, objects and hands in the files of DexGraspBench, a benchmark in MuJoCo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.hands.hand_mjcf import hand_mjcf, numbers
from lis_grasp.hands.hand_parts import Joint
from lis_grasp.io.atomic_writing import whole_file, write_text
from lis_grasp.typing import FloatArray

# Servos of the benchmark's own hands have this stiffness and damping [N m/rad, N m s/rad]. Those of
# prismatic joints [N/m, N s/m] give 40 N at an error of 8 mm, as usual grippers do.
_STIFFNESS = {"revolute": 5.0, "prismatic": 5000.0}
_DAMPING = {"revolute": 0.1, "prismatic": 100.0}
_PALM = "palm"  # of the bodies that belong to no finger


def save_for_dexgraspbench(
    folder: Path,
    name: str,
    pieces: Sequence[trimesh.Trimesh],
    hand: Hand,
    grasps: Sequence[Grasp],
    support_height: float,
) -> Path:
    """Write an object, a hand and grasps for DexGraspBench, and return its `save_dir`.

    Written are ``object/<name>/`` (convex pieces, mass), ``hand/<hand>.xml`` (MJCF),
    ``hand/lis_<hand>.yaml`` (to be copied to the benchmark's ``config/hand``) and
    ``graspdata/<name>/<k>.npy``: for each grasp ``pregrasp_qpos``, ``grasp_qpos`` and
    ``squeeze_qpos`` (base link's position [m] and unit quaternion w, x, y, z; then the joints in
    the MJCF's order), ``obj_pose``, ``obj_scale`` and ``obj_path``. The table is at z = 0.

    The benchmark's hands are position servos that run open loop: the squeeze is the posture in
    which the servos exert the planned contact forces, ``q + J^T f / kp``.

    Parameters
    ----------
    folder
        Made if it is missing. Paths in the files are absolute.
    name
        Name of the object.
    pieces
        The object's convex pieces in O [m].
    hand, grasps
        The hand, and its grasps in O.
    support_height
        Height of the table in O [m].

    Raises
    ------
    InvalidFileError
        If a file cannot be written.
    """
    folder = folder.resolve()
    object_folder = folder / "object" / name
    _save_object(object_folder, pieces)
    _save_hand(folder / "hand", hand)
    above_table = np.array([0.0, 0.0, -support_height])
    for earlier in (folder / "graspdata" / name).glob("*.npy"):
        earlier.unlink()
    for number, grasp in enumerate(grasps):
        q, opened = grasp.joint_positions, grasp.pregrasp_positions
        content = {
            "pregrasp_qpos": _qpos(hand, grasp, opened, above_table),
            "grasp_qpos": _qpos(hand, grasp, q, above_table),
            "squeeze_qpos": _qpos(hand, grasp, squeeze_posture(hand, grasp), above_table),
            "obj_pose": np.array([*above_table, 1.0, 0.0, 0.0, 0.0]),
            "obj_scale": 1.0,
            "obj_path": str(object_folder),
        }
        path = folder / "graspdata" / name / f"{number}.npy"
        with whole_file(path) as temporary, temporary.open("wb") as stream:
            np.save(stream, np.array(content, dtype=object), allow_pickle=True)
    return folder


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
    efforts = np.clip(efforts, -hand.effort_limits, hand.effort_limits)
    kinds = {joint.index: joint.kind for joint in hand.joints if joint.is_actuated}
    return np.asarray(q + efforts / [_STIFFNESS[kinds[j]] for j in range(len(q))])


def _qpos(hand: Hand, grasp: Grasp, q: FloatArray, shift: FloatArray) -> FloatArray:
    X_OL = grasp.X_OH @ np.linalg.inv(hand.X_LH)
    turn = Rotation.from_matrix(X_OL[:3, :3]).as_quat(canonical=True, scalar_first=True)
    moved = [hand_joint.position(q) for hand_joint in _joints_in_order(hand)]
    return np.concatenate([X_OL[:3, 3] + shift, turn, moved])


def _joints_in_order(hand: Hand) -> list[Joint]:
    """Return the joints that move, in MuJoCo's order: depth first."""
    children: dict[str, list[Joint]] = {}
    for joint in hand.joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered, waiting = [], list(reversed(children.get(hand.base_link, [])))
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += reversed(children.get(joint.child, []))
    return [joint for joint in ordered if joint.kind != "fixed"]


def _save_object(folder: Path, pieces: Sequence[trimesh.Trimesh]) -> None:
    for number, piece in enumerate(pieces):
        _save_mesh(folder / "urdf" / "meshes" / f"convex_piece_{number:03d}.obj", piece)
    union = trimesh.util.concatenate(list(pieces))
    _save_mesh(folder / "mesh" / "simplified.obj", union)
    volumes = np.array([piece.volume for piece in pieces])
    centers = np.array([piece.center_mass for piece in pieces])
    facts = {  # of density 1: the benchmark scales the density to its mass
        "gravity_center": (volumes @ centers / volumes.sum()).tolist(),
        "obb": union.extents.tolist(),
        "scale": 1.0,
        "density": 1.0,
        "mass": float(volumes.sum()),
    }
    write_text(folder / "info" / "simplified.json", json.dumps(facts, indent=1) + "\n")


def _save_mesh(path: Path, mesh: trimesh.Trimesh) -> None:
    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    write_text(path, str(plain.export(file_type="obj", header="", digits=9)))


def _save_hand(folder: Path, hand: Hand) -> None:
    fingers = hand.link_fingers
    names = {link: f"{fingers.get(link, _PALM)}_{link}" for link in hand.links}
    xml = folder / f"{hand.name}.xml"
    root = Element("mujoco", {"model": hand.name})
    SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    written = hand_mjcf(hand, np.eye(4))
    for body in written.root.iter("body"):
        body.set("name", names[body.attrib["name"]])
    kinds = {joint.name: joint.kind for joint in hand.joints}
    for element in written.root.iter("joint"):
        element.set("damping", numbers([_DAMPING[kinds[element.attrib["name"]]]]))
    assets = SubElement(root, "asset")
    meshes = [geometry.mesh for geometry in hand.link_geometries if geometry.kind == "mesh"]
    for asset, mesh in zip(written.meshes, meshes, strict=True):
        file = f"{hand.name}_{asset.attrib['name']}.obj"
        _save_mesh(folder / file, mesh)
        SubElement(assets, "mesh", {"name": asset.attrib["name"], "file": file})
    SubElement(root, "worldbody").append(written.root)
    contact = SubElement(root, "contact")
    for first, second in sorted(hand.self_collision_exclusions):
        SubElement(contact, "exclude", {"body1": names[first], "body2": names[second]})
    SubElement(root, "equality").extend(written.couplings)
    actuators = SubElement(root, "actuator")
    for j, joint in enumerate(hand.joint_names):
        limit = hand.effort_limits[j]
        attributes = {"name": joint, "joint": joint, "kp": numbers([_STIFFNESS[kinds[joint]]])}
        attributes["forcerange"] = numbers([-limit, limit])
        SubElement(actuators, "position", attributes)
    ElementTree.indent(root)
    write_text(xml, ElementTree.tostring(root, encoding="unicode") + "\n")
    config = {
        "xml_path": str(xml),
        "mocap": True,
        "exclude_table_contact": None,
        "color": [0.5, 0.6, 0.7, 1.0],
        "finger_prefix": [f"{finger}_" for finger in hand.fingers],
        "valid_body_name": list(names.values()),
        "tip_body_name": [names[link] for link in hand.links if link in hand.pad_links],
    }
    write_text(folder / f"lis_{hand.name}.yaml", yaml.safe_dump(config, sort_keys=False))
