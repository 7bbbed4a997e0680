"""Reading of the YAML files of hands and arms, and of the URDF, SDF or MJCF that they name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
import yourdfpy
from pydantic import BaseModel

from lis_grasp.exceptions import (
    InvalidArmError,
    InvalidFileError,
    InvalidHandError,
    InvalidRobotError,
)
from lis_grasp.geometry import unit
from lis_grasp.io.schemas import parse_entry
from lis_grasp.io.yaml_files import read_yaml
from lis_grasp.records import fields_of
from lis_grasp.robots._build_model import build_model, read_description
from lis_grasp.robots._description import (
    DescriptionEdits,
    JointNumbers,
    links_below,
    parse_root,
    read_joint_numbers,
)
from lis_grasp.robots._urdf import parse_xml
from lis_grasp.robots.arm_defaults import find_arm_exclusions, find_home, flange_frame
from lis_grasp.robots.kinematics import ArmKinematics
from lis_grasp.robots.model_uri import resolve_model
from lis_grasp.robots.robot_model import (
    Cup,
    GraspFamily,
    Pad,
    ProbePosture,
    RobotModel,
    by_joint_kind,
    rpy_pose,
)
from lis_grasp.robots.schema import FEW_DIGITS, ArmEntry, HandEntry
from lis_grasp.robots.shipped_models import arm_path, hand_path
from lis_grasp.typing import FloatArray

# Where a file gives no limits: a slow arm's speed [rad/s, m/s], reached in this time [s].
_SPEED: Mapping[str, float] = {"revolute": 1.0, "prismatic": 0.25}
_RISE = 0.2
# Stiffness of the joint with the largest effort [N m/rad]; the others' are as their efforts.
_STIFFNESS = 4000.0


def read_hand_file(path_or_name: str | Path) -> dict[str, Any]:
    """Return the fields of a `Hand`; for arguments and errors see `Hand.load`."""
    path = hand_path(path_or_name)
    file = _read_file(path, "hand", HandEntry, InvalidHandError)
    try:
        model = read_description(file.description, DescriptionEdits.of(file.entry))
    except (InvalidHandError, InvalidFileError) as error:
        if isinstance(error, InvalidHandError) and error.file:
            raise
        key = error.key if isinstance(error, InvalidHandError) else "urdf"
        raise InvalidHandError(f"{file.name}: {error}", file=file.name, key=key) from None
    low = file.entry.low_objects
    return _hand_fields(_Checks(file, model)) | {"low_objects": low and path.with_name(low)}


def read_arm_file(path_or_name: str | Path) -> dict[str, Any]:
    """Return the fields of an `Arm`; for arguments and errors see `Arm.load`."""
    file = _read_file(arm_path(path_or_name), "arm", ArmEntry, InvalidArmError)
    try:
        edits = DescriptionEdits.of(file.entry)
        root = parse_xml(file.description, edits.xacro_args)
        robot, numbers = parse_root(root, file.description), read_joint_numbers(root)
        _cut_at_flange(robot, file.entry)
        model = build_model(robot, file.description, edits)
    except (InvalidRobotError, InvalidFileError) as error:
        key = error.key if isinstance(error, InvalidRobotError) and error.key else "urdf"
        raise InvalidArmError(f"{file.name}: {error}", file=file.name, key=key) from None
    return _arm_fields(_Checks(file, model), [numbers[name] for name in model.joint_names])


def description_of(path_or_name: str | Path) -> tuple[Path, DescriptionEdits]:
    """Return the description of a hand, and what its YAML changes of it; errors as `Hand.load`."""
    file = _read_file(hand_path(path_or_name), "hand", HandEntry, InvalidHandError)
    return file.description, DescriptionEdits.of(file.entry)


@dataclass(frozen=True, slots=True)
class _File:
    """A YAML file, its content by the schema, and the URDF, SDF or MJCF that it names."""

    name: str
    entry: Any
    description: Path
    error: type[InvalidRobotError]


def _read_file(
    path: Path, what: str, schema: type[BaseModel], invalid: type[InvalidRobotError]
) -> _File:
    try:
        document = read_yaml(path)
    except InvalidFileError as error:
        raise invalid(f"the {what} file {error}", file=path.name) from None
    entry: Any = parse_entry(schema, document, path.name, invalid)
    try:
        description = resolve_model(entry.urdf, path, entry.model_from)
    except InvalidFileError as error:
        raise invalid(str(error), file=path.name, key="urdf") from None
    return _File(path.name, entry, description, invalid)


class _Checks:
    """Checks of what a YAML file says by the links and joints of its description."""

    def __init__(self, file: _File, model: RobotModel) -> None:
        self.file, self.entry, self.model = file, file.entry, model
        if not model.link_geometries:
            self.fail("urdf", f"{file.description} must give links collision bodies; none is there")

    def joints(self, described: str) -> None:
        names, given = self.model.joint_names, self.entry.joints
        if given is not None and tuple(given) != names:
            listed = ", ".join(given)
            self.fail("joints", f"must name {described} {', '.join(names)}; it is {listed}")

    def known_joints(self, key: str, names: Iterable[str]) -> None:
        for name in names:
            if name not in self.model.joint_names:
                listed = ", ".join(self.model.joint_names)
                self.fail(f"{key}.{name}", f"must be one of the joints, {listed}")

    def per_joint(self, key: str, values: Sequence[float]) -> FloatArray:
        count = len(self.model.joint_names)
        if len(values) != count:
            self.fail(key, f"must be a list of {count} numbers; it has {len(values)}")
        return np.array(values)

    def posture(self, key: str, values: Sequence[float]) -> FloatArray:
        model, positions = self.model, self.per_joint(key, values)
        low, high = model.lower - FEW_DIGITS, model.upper + FEW_DIGITS
        for j in np.flatnonzero((positions < low) | (positions > high)):
            self.fail(
                key,
                f"must be within the joint limits; {model.joint_names[j]} is {positions[j]},"
                f" outside [{model.lower[j]:g}, {model.upper[j]:g}]",
            )
        return np.clip(positions, model.lower, model.upper)

    def link(self, key: str, name: str) -> str:
        if name not in self.model.links:
            self.fail(key, f"must be a link of the URDF; it has no link '{name}'")
        return name

    def exclusions(self) -> frozenset[tuple[str, str]]:
        links = (
            sorted(self.link(f"self_collision_exclusions[{i}]", link) for link in pair)
            for i, pair in enumerate(self.entry.self_collision_exclusions)
        )
        return frozenset((first, second) for first, second in links)

    def fail(self, key: str, reason: str) -> NoReturn:
        file = self.file.name
        raise self.file.error(f"{file}: {key} {reason}", file=file, key=key)


def _hand_fields(checks: _Checks) -> dict[str, Any]:
    entry, model = checks.entry, checks.model
    checks.joints("the URDF's movable joints in the URDF's order, which is")
    pregrasps = {
        name: checks.posture(f"pregrasps.{name}", q) for name, q in entry.pregrasps.items()
    }
    return {
        **fields_of(model),
        "name": entry.name,
        "kind": entry.kind,
        "pads": _cups(checks) if entry.kind == "suction_cup" else _pads(checks),
        "X_LH": _pose(entry.palm_frame),
        "approach_H": _unit(entry.approach),
        "pregrasps": MappingProxyType(pregrasps),
        "probe_postures": MappingProxyType(_probe_postures(checks)),
        "self_collision_exclusions": checks.exclusions() | model.joined_links,
        "max_contact_force": entry.max_contact_force,
        "X_FB": None if entry.mount is None else _pose(entry.mount),
        "families": _families(checks),
    }


def _pads(checks: _Checks) -> tuple[Pad, ...]:
    if checks.entry.cups:
        checks.fail("cups", "is only for a hand of kind suction_cup: leave it out, or change kind")
    if not checks.entry.pads:
        checks.fail("pads", "is missing: it must name the pad of each finger")
    return tuple(
        Pad(
            finger=finger,
            link=checks.link(f"pads.{finger}.link", pad.link),
            center_L=np.array(pad.center),
            radius=pad.radius,
            axis_L=_unit(pad.axis),
            half_angle=pad.half_angle,
        )
        for finger, pad in checks.entry.pads.items()
    )


def _cups(checks: _Checks) -> tuple[Pad, ...]:
    if checks.entry.pads:
        checks.fail("pads", "is not for a hand of kind suction_cup: leave it out, or change kind")
    if not checks.entry.cups:
        checks.fail("cups", "is missing: it must name the suction cup")
    return tuple(
        Pad(
            finger=name,
            link=checks.link(f"cups.{name}.link", cup.link),
            center_L=np.array(cup.center),
            radius=0.0,
            axis_L=_unit(cup.axis),
            half_angle=cup.tilt,
            cup=Cup(cup.radius, cup.travel, cup.tilt, cup.vacuum),
        )
        for name, cup in checks.entry.cups.items()
    )


def _families(checks: _Checks) -> tuple[GraspFamily, ...]:
    entry = checks.entry
    if entry.kind == "suction_cup":
        if entry.families not in (None, ["suction"]):
            checks.fail("families", "must be [suction] of a hand of kind suction_cup")
        return ("suction",)
    if entry.families is None:
        table = ("table",) if entry.kind == "multi_finger" else ()
        return ("pinch", "rim", *table, *(("flat_faces",) if entry.low_objects else ()))
    if "pinch" not in entry.families:
        checks.fail("families", "must contain pinch, of which all others are kinds")
    if "flat_faces" in entry.families and entry.low_objects is None:
        checks.fail("families", "contains flat_faces, whose file low_objects must name")
    return tuple(dict.fromkeys(entry.families))


def _probe_postures(checks: _Checks) -> dict[str, ProbePosture]:
    postures = {}
    for finger, probe in checks.entry.probe_postures.items():
        key = f"probe_postures.{finger}"
        if finger not in {**checks.entry.pads, **checks.entry.cups}:
            checks.fail(key, "names a finger that has no pad")
        postures[finger] = ProbePosture(
            finger=finger,
            joint_positions=checks.posture(f"{key}.positions", probe.positions),
            direction_H=_unit(probe.direction),
            link=checks.link(f"{key}.tip.link", probe.tip.link),
            center_L=np.array(probe.tip.center),
            radius=probe.tip.radius,
        )
    return postures


def _unit(vector: Sequence[float]) -> FloatArray:
    return unit(np.array(vector, np.float64))


def _pose(entry: Any) -> FloatArray:
    return rpy_pose(entry.translation, entry.rpy)


def _arm_fields(checks: _Checks, numbers: Sequence[JointNumbers]) -> dict[str, Any]:
    entry = checks.entry
    checks.joints("the movable joints from the base to the flange, which are")
    followers = [joint.name for joint in checks.model.joints if joint.follows]
    if followers:
        checks.fail("urdf", f"must have joints of their own only; {followers[0]} mimics another")
    checks.model = model = _with_position_limits(checks)
    X_LF = (
        flange_frame(model, entry.flange) if entry.flange_pose is None else _pose(entry.flange_pose)
    )
    speeds = _limits(checks, "velocity", numbers, by_joint_kind(model, **_SPEED))
    exclusions = find_arm_exclusions(model) | checks.exclusions()
    effort = model.effort_limits
    return {
        **fields_of(model),
        "name": entry.name,
        "path": checks.file.description,
        "flange": entry.flange,
        "X_LF": X_LF,
        "home": (
            checks.posture("home", entry.home)
            if entry.home is not None
            else find_home(model, ArmKinematics(model.joints, entry.flange, X_LF), exclusions)
        ),
        "velocity_limits": speeds,
        "acceleration_limits": _limits(checks, "acceleration", numbers, speeds / _RISE),
        "rotor_inertias": np.array([n.reflected_inertia for n in numbers]),
        "damping": np.array([n.damping or 0.0 for n in numbers]),
        "stiffness": (
            checks.per_joint("stiffness", entry.stiffness)
            if entry.stiffness is not None
            else _STIFFNESS * effort / effort.max()
        ),
        "speed_fraction": entry.speed_fraction,
        "self_collision_exclusions": exclusions,
    }


def _limits(
    checks: _Checks, kind: str, numbers: Sequence[JointNumbers], otherwise: FloatArray
) -> FloatArray:
    """Return the YAML's velocity or acceleration limits, else the file's, else the given."""
    given: Mapping[str, float] = getattr(checks.entry, f"{kind}_limits")
    checks.known_joints(f"{kind}_limits", given)
    limits = [getattr(joint, kind) for joint in numbers]
    limits = [o if limit is None else limit for limit, o in zip(limits, otherwise, strict=True)]
    names = checks.model.joint_names
    return np.array([given.get(name, limit) for name, limit in zip(names, limits, strict=True)])


def _with_position_limits(checks: _Checks) -> RobotModel:
    given, model = checks.entry.position_limits, checks.model
    checks.known_joints("position_limits", given)
    limits = np.column_stack([model.lower, model.upper])
    for name, (low, high) in given.items():
        if not low < high:
            checks.fail(f"position_limits.{name}", f"must be [lower, upper]; it is {[low, high]}")
        limits[model.joint_names.index(name)] = low, high
    return replace(model, lower=limits[:, 0].copy(), upper=limits[:, 1].copy())


def _cut_at_flange(robot: yourdfpy.Robot, entry: ArmEntry) -> None:
    """Leave out what is beyond the flange, and what moves beside the chain to it: grippers, wheels.

    Raises `InvalidArmError` if the description has no such flange, or it is not on the base link.
    """
    links = [link.name for link in robot.links]
    for key, link in (("flange", entry.flange), ("base_link", entry.base_link)):
        if link is not None and link not in links:
            raise InvalidArmError(
                f"{key} must be a link of the description, which are {', '.join(links)}; it is"
                f" '{link}'",
                key=key,
            )
    parents = {joint.child: joint.parent for joint in robot.joints}
    chain = [entry.flange]
    while chain[-1] in parents and chain[-1] != entry.base_link and len(chain) <= len(links):
        chain.append(parents[chain[-1]])
    if entry.base_link is not None and chain[-1] != entry.base_link:
        raise InvalidArmError(
            f"flange must be on the chain of links from base_link '{entry.base_link}'; it is"
            f" '{entry.flange}'",
            key="flange",
        )
    moving = {
        joint.child
        for joint in robot.joints
        if joint.type != "fixed" and joint.name not in entry.locked_joints
    }
    branches = {
        joint.child: links_below(robot, joint.child)
        for joint in robot.joints
        if joint.parent in chain and joint.child not in chain
    }
    dropped = {
        link
        for first, branch in branches.items()
        if parents[first] == entry.flange or branch & moving
        for link in branch
    }
    robot.links = [link for link in robot.links if link.name not in dropped]
    robot.joints = [joint for joint in robot.joints if joint.child not in dropped]
