"""Corrected copy of a URDF or SDF: impossible inertias and missing masses replaced."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.io.atomic_writing import write_text
from lis_grasp.robots._build_model import link_inertial, read_description
from lis_grasp.robots._description import DescriptionEdits, apply_edits, parse_description
from lis_grasp.robots._urdf import parse_xml
from lis_grasp.robots.inertias import is_possible
from lis_grasp.robots.link_bodies import points_of_bodies
from lis_grasp.robots.robot_model import Inertial

_MOMENTS = {
    "ixx": (0, 0),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyy": (1, 1),
    "iyz": (1, 2),
    "izz": (2, 2),
}


def write_repaired(path: Path, edits: DescriptionEdits, output: Path) -> list[str]:
    """Write a copy of a description whose links have possible inertias, and return what changed.

    Paths of meshes are rewritten relative to the copy. The new values are those of
    `repaired_inertial`; the other links stay as they are. For errors see `Hand.load`.
    """
    model = read_description(path, replace(edits, repair=True))
    repaired = model.inertials
    robot = apply_edits(parse_description(path, edits.xacro_args), edits)
    given = {each.name: _given(each) for each in robot.links}
    root = parse_xml(path, edits.xacro_args)
    form = {"sdf": "sdf", "robot": "urdf"}.get(root.tag)
    if form is None:
        raise InvalidHandError(
            f"{path} must be a URDF or SDF to be rewritten; `repair: true` in the YAML does"
            " the same for an MJCF",
            file=path.name,
        )
    changed = []
    for link in root.iter("link"):
        name = link.get("name", "")
        if name not in repaired or repaired[name].mass <= 0.0:
            continue
        points = points_of_bodies(model.link_geometries, name)
        has_mass, made = given[name].mass > 0.0, repaired[name]
        if has_mass and is_possible(given[name], points):
            continue
        _write(link, form, made)
        was = "" if has_mass else " (was missing)"
        moments = ", ".join(f"{moment:.3g}" for moment in np.linalg.eigvalsh(made.inertia_L))
        changed.append(f"{name}: mass {made.mass:.4g} kg{was}, principal moments {moments} kg m^2")
    for element in root.iter("mesh" if form == "urdf" else "uri"):
        _move(element, form, path.resolve().parent, output.resolve().parent)
    write_text(output, ET.tostring(root, encoding="unicode") + "\n")
    return changed


def _given(link: Any) -> Inertial:
    """Return the file's own mass properties of a link, its axes as they are and not rounded."""
    read = link_inertial(link)
    own = getattr(link.inertial, "inertia", None)
    matrix = np.zeros((3, 3)) if own is None else np.asarray(own, np.float64)
    return Inertial(read.mass, read.center_L, matrix)


def _write(link: ET.Element, form: str, inertial: Inertial) -> None:
    """Replace a link's inertial element: at the centre of mass, along the link's axes."""
    old = link.find("inertial")
    if old is not None:
        link.remove(old)
    element = ET.Element("inertial")
    link.insert(0, element)
    center = " ".join(f"{value:.8g}" for value in inertial.center_L)
    mass = f"{inertial.mass:.8g}"
    moments = {name: f"{inertial.inertia_L[at]:.8g}" for name, at in _MOMENTS.items()}
    if form == "urdf":
        ET.SubElement(element, "origin", {"xyz": center, "rpy": "0 0 0"})
        ET.SubElement(element, "mass", {"value": mass})
        ET.SubElement(element, "inertia", moments)
        return
    ET.SubElement(element, "pose").text = f"{center} 0 0 0"
    ET.SubElement(element, "mass").text = mass
    inertia = ET.SubElement(element, "inertia")
    for name, moment in moments.items():
        ET.SubElement(inertia, name).text = moment


def _move(element: ET.Element, form: str, before: Path, after: Path) -> None:
    uri = element.get("filename", "") if form == "urdf" else (element.text or "").strip()
    if not uri or "://" in uri or os.path.isabs(uri):
        return
    moved = os.path.relpath(before / uri, after)
    if form == "urdf":
        element.set("filename", moved)
    else:
        element.text = moved
