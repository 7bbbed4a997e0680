"""Grasps, objects and hands written as files of DexGraspBench, a benchmark in MuJoCo."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
import yaml

from lis_grasp.grasping.export import servo_postures
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io.atomic_writing import whole_file, write_text
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.mjcf import servo_hand


@dataclass(frozen=True, slots=True, eq=False)
class TabletopObject:
    """An object on a table, as a union of convex pieces."""

    name: str
    pieces: Sequence[trimesh.Trimesh]  #: in O [m]
    support_height: float  #: of the table in O [m]


def save_for_dexgraspbench(
    folder: Path,
    target: TabletopObject,
    hand: Hand,
    grasps: Sequence[Grasp],
    labels: Sequence[Mapping[str, Any]] = (),
) -> Path:
    """Write an object, a hand and grasps for DexGraspBench, and return its `save_dir`.

    It writes ``object/<name>/`` (convex pieces, mass), ``hand/<hand>.xml`` (MJCF),
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
    target
        The object.
    hand, grasps
        The hand, and its grasps in O.
    labels
        Outcomes of lifts (`lift_facts`), or none. Then ``evaluation/`` has each grasp again with
        ``succ_flag``, ``delta_pos`` [m] and ``delta_angle`` [deg], as the benchmark's own tests
        write them, and ``succgrasp/`` has those that were held.

    Raises
    ------
    InvalidFileError
        If a file cannot be written.
    """
    folder, name, support_height = folder.resolve(), target.name, target.support_height
    object_folder = folder / "object" / name
    _save_object(object_folder, target.pieces)
    _save_hand(folder / "hand", hand)
    for stage in ("graspdata", "evaluation", "succgrasp"):
        for earlier in (folder / stage / name).glob("*.npy"):
            earlier.unlink()
    for number, grasp in enumerate(grasps):
        postures = servo_postures(hand, grasp, support_height)
        content = {
            "pregrasp_qpos": postures.pregrasp,
            "grasp_qpos": postures.grasp,
            "squeeze_qpos": postures.squeeze,
            "obj_pose": np.array([0.0, 0.0, -support_height, 1.0, 0.0, 0.0, 0.0]),
            "obj_scale": 1.0,
            "obj_path": str(object_folder),
        }
        file = f"{name}/{number}.npy"
        _save_facts(folder / "graspdata" / file, content)
        if labels:
            label = labels[number]
            content["succ_flag"] = bool(label["held"])
            content["delta_pos"] = float(label["slip"])
            content["delta_angle"] = float(np.rad2deg(label["turn"]))
            _save_facts(folder / "evaluation" / file, content)
            if label["held"]:
                _save_facts(folder / "succgrasp" / file, content)
    return folder


def _save_facts(path: Path, content: Mapping[str, Any]) -> None:
    with whole_file(path) as temporary, temporary.open("wb") as stream:
        np.save(stream, np.array(content, dtype=object), allow_pickle=True)


def _save_object(folder: Path, pieces: Sequence[trimesh.Trimesh]) -> None:
    for number, piece in enumerate(pieces):
        _save_mesh(folder / "urdf" / "meshes" / f"convex_piece_{number:03d}.obj", piece)
    union = trimesh.util.concatenate(list(pieces))
    _save_mesh(folder / "mesh" / "simplified.obj", union)
    volumes = np.array([piece.volume for piece in pieces])
    centers = np.array([piece.center_mass for piece in pieces])
    facts = {  # at density 1: the benchmark scales it to its mass
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
    xml = folder / f"{hand.name}.xml"
    written = servo_hand(hand)
    root = Element("mujoco", {"model": hand.name})
    SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    assets = SubElement(root, "asset")
    meshes = [geometry.mesh for geometry in hand.link_geometries if geometry.kind == "mesh"]
    for asset, mesh in zip(written.parts.meshes, meshes, strict=True):
        file = f"{hand.name}_{asset.attrib['name']}.obj"
        _save_mesh(folder / file, mesh)
        SubElement(assets, "mesh", {"name": asset.attrib["name"], "file": file})
    SubElement(root, "worldbody").append(written.parts.root)
    SubElement(root, "equality").extend(written.parts.couplings)
    root.extend([written.exclusions, written.actuators])
    ElementTree.indent(root)
    write_text(xml, ElementTree.tostring(root, encoding="unicode") + "\n")
    names = written.body_names
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
