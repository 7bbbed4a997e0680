"""Robot descriptions: their links and joints, edits of them, and numbers of joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import trimesh
import yourdfpy

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.geometry import make_pose, unit
from lis_grasp.robots._mjcf_reader import parse_mjcf
from lis_grasp.robots._sdf import parse_sdf
from lis_grasp.robots._urdf import parse_urdf, parse_xml
from lis_grasp.robots.schema import UNLIMITED

_DRAKE = "{http://drake.mit.edu}"


def parse_description(
    path: Path, xacro_args: Mapping[str, str] = MappingProxyType({})
) -> yourdfpy.Robot:
    """Return the links and joints that a URDF, SDF or MJCF has, unchecked."""
    return parse_root(parse_xml(path, xacro_args), path)


def parse_root(root: ET.Element, path: Path) -> yourdfpy.Robot:
    """Return the links and joints of the root element of a description, unchecked."""
    match root.tag:
        case "robot":
            return parse_urdf(root, path)
        case "sdf":
            return parse_sdf(root, path)
        case "mujoco":
            return parse_mjcf(path)
    named = root.findtext("sdf", "").strip()  # of Gazebo's model.config
    kinds = "a URDF (<robot>), SDF (<sdf>) or MJCF (<mujoco>)"
    advice = f": give {named}, which it names" if named else ""
    raise InvalidFileError(
        f"{path} must be {kinds}; it begins with <{root.tag}>{advice}",
        path=path,
    )


@dataclass(frozen=True, slots=True)
class DescriptionEdits:
    """What a hand's YAML changes of the URDF, SDF or MJCF that it names."""

    base_link: str | None = None
    """The root of the hand: links before it, an arm's for example, are left out."""
    locked_joints: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Position at which a joint is fixed [rad or m], by its name."""
    effort_limits: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Largest effort of a joint [N m or N], by its name."""
    repair: bool = False
    """Whether impossible inertias and missing masses are replaced; see `repaired_inertial`."""
    convex_parts: tuple[str, ...] = ()
    """Links whose meshes collide as several convex parts, not as one convex hull."""
    xacro_args: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Arguments of a xacro file, by name."""

    @classmethod
    def of(cls, entry: Any) -> DescriptionEdits:
        """Return the edits of a checked YAML file, a hand's or an arm's."""
        parts = tuple(getattr(entry, "convex_parts", ()))  # an arm has none
        return cls(
            entry.base_link,
            entry.locked_joints,
            entry.effort_limits,
            entry.repair,
            parts,
            {name: str(value) for name, value in entry.xacro_args.items()},
        )


NO_EDITS = DescriptionEdits()
"""No changes."""


def apply_edits(robot: yourdfpy.Robot, edits: DescriptionEdits) -> yourdfpy.Robot:
    """Change the links and joints of a robot, and return it.

    A joint that mimics a locked one is locked as well. One that mimics a mimicking joint mimics
    that joint's leader. Raises `InvalidHandError` for a link or joint that is not in the
    description.
    """
    by_name = {joint.name: joint for joint in robot.joints}
    for joint in robot.joints:
        _follow_leader(joint, by_name)
    for key, names in (
        ("locked_joints", edits.locked_joints),
        ("effort_limits", edits.effort_limits),
    ):
        for name in names:
            if name not in by_name or by_name[name].type == "fixed":
                raise InvalidHandError(
                    f"{key} names '{name}', which is no movable joint", key=f"{key}.{name}"
                )
    for name, effort in edits.effort_limits.items():
        limit = by_name[name].limit or yourdfpy.Limit()
        limit.effort = effort
        by_name[name].limit = limit
    positions = dict(edits.locked_joints)
    for joint in robot.joints:
        leader, multiplier, offset = mimicked(joint)
        if joint.mimic is not None and leader in positions:
            positions[joint.name] = multiplier * edits.locked_joints[leader] + offset
    for name, position in positions.items():
        _lock(by_name[name], position)
    if edits.base_link is not None:
        _cut(robot, edits.base_link)
    return robot


def _follow_leader(joint: yourdfpy.Joint, by_name: Mapping[str, yourdfpy.Joint]) -> None:
    """Let a joint mimic the last one of a chain of mimicking joints, as a closed chain cannot."""
    seen = {joint.name}
    while joint.mimic is not None and joint.mimic.joint not in seen:
        mimic = joint.mimic
        seen.add(mimic.joint)
        leader = by_name.get(mimic.joint)
        if leader is None or leader.mimic is None:
            return
        _, own, offset = mimicked(joint)
        first, multiplier, before = mimicked(leader)
        joint.mimic = yourdfpy.Mimic(first, own * multiplier, own * before + offset)
    if joint.mimic is not None:
        names = ", ".join(sorted(seen))
        raise InvalidHandError(
            (
                f"joints {names} mimic each other"
                if len(seen) > 1
                else f"joint {names} mimics itself"
            )
            + ": one must be moved by a motor"
        )


def mimicked(joint: yourdfpy.Joint) -> tuple[str, float, float]:
    """Return the joint that a joint mimics, or itself, and the multiplier and offset."""
    mimic = joint.mimic
    if mimic is None:
        return joint.name, 1.0, 0.0
    multiplier = 1.0 if mimic.multiplier is None else float(mimic.multiplier)
    return mimic.joint, multiplier, float(mimic.offset or 0.0)


def links_below(robot: yourdfpy.Robot, link: str) -> set[str]:
    """Return a link and all links that it carries."""
    below, waiting = {link}, list(robot.joints)
    while found := [joint for joint in waiting if joint.parent in below]:
        waiting = [joint for joint in waiting if joint.parent not in below]
        below |= {joint.child for joint in found}
    return below


def _lock(joint: yourdfpy.Joint, position: float) -> None:
    origin = np.eye(4) if joint.origin is None else np.asarray(joint.origin, np.float64)
    axis = np.array([1.0, 0.0, 0.0] if joint.axis is None else joint.axis, np.float64)
    motion = np.eye(4)
    if joint.type in ("revolute", "continuous"):
        motion = trimesh.transformations.rotation_matrix(position, axis)
    elif joint.type == "prismatic":
        motion = make_pose(np.eye(3), position * unit(axis))
    elif position:
        raise InvalidHandError(
            f"locked_joints must lock '{joint.name}', of type '{joint.type}', at 0",
            key=f"locked_joints.{joint.name}",
        )
    joint.origin, joint.type, joint.mimic = origin @ motion, "fixed", None


def _cut(robot: yourdfpy.Robot, base: str) -> None:
    if base not in {link.name for link in robot.links}:
        raise InvalidHandError(
            f"base_link must be a link of the description; it has no link '{base}'", key="base_link"
        )
    kept = links_below(robot, base)
    robot.links = [link for link in robot.links if link.name in kept]
    robot.joints = [joint for joint in robot.joints if joint.parent in kept]


@dataclass(frozen=True, slots=True)
class JointNumbers:
    """What a file says of a joint beyond its position and effort limits; None where it does not."""

    velocity: float | None = None  # limit [rad/s or m/s]
    acceleration: float | None = None  # limit [rad/s^2 or m/s^2], Drake's extension
    damping: float | None = None  # [N m s/rad or N s/m]
    rotor_inertia: float | None = None  # [kg m^2], of the motor itself, Drake's extension
    gear_ratio: float | None = None

    @property
    def reflected_inertia(self) -> float:
        """Inertia of the motor at the joint [kg m^2 or kg]: rotor inertia x gear ratio squared."""
        ratio = 1.0 if self.gear_ratio is None else self.gear_ratio
        return 0.0 if self.rotor_inertia is None else self.rotor_inertia * ratio**2


# Of a joint, or of the transmission that moves it: an element, and the attribute that has the
# number; empty if its text has it.
_SDF_NUMBERS = {
    "velocity": ("axis/limit/velocity", ""),
    "acceleration": (f"axis/limit/{_DRAKE}acceleration", ""),
    "damping": ("axis/dynamics/damping", ""),
    "rotor_inertia": (f"{_DRAKE}rotor_inertia", ""),
    "gear_ratio": (f"{_DRAKE}gear_ratio", ""),
}
_URDF_NUMBERS = {
    "velocity": ("limit", "velocity"),
    "acceleration": ("limit", f"{_DRAKE}acceleration"),
    "damping": ("dynamics", "damping"),
    "rotor_inertia": (f"actuator/{_DRAKE}rotor_inertia", "value"),
    "gear_ratio": (f"actuator/{_DRAKE}gear_ratio", "value"),
}


def read_joint_numbers(root: ET.Element) -> Mapping[str, JointNumbers]:
    """Return the numbers of each joint in a URDF or SDF by its name; an unusable one is None."""
    places = _SDF_NUMBERS if root.tag == "sdf" else _URDF_NUMBERS
    found: defaultdict[str, dict[str, float | None]] = defaultdict(dict)
    for owner in (*root.iter("joint"), *root.iter("transmission")):
        joint = owner if owner.tag == "joint" else owner.find("joint")
        name = "" if joint is None else joint.get("name", "")
        for key, (place, attribute) in places.items():
            if (element := owner.find(place)) is not None:
                text = element.get(attribute) if attribute else element.text
                found[name][key] = _number(text, key in ("velocity", "acceleration"))
    return defaultdict(JointNumbers, {name: JointNumbers(**n) for name, n in found.items()})


def _number(text: str | None, is_limit: bool) -> float | None:
    """Return a number of at least 0; None for another text, and for a limit that is none."""
    try:
        number = float(text or "nan")
    except ValueError:
        return None
    is_used = 0.0 < number < UNLIMITED if is_limit else 0.0 <= number < np.inf
    return number if is_used else None
