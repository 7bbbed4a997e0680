"""Reading of the YAML files of hands and arms, and of the URDF or SDF that they name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
import yourdfpy

from lis_grasp.exceptions import InvalidArmError, InvalidFileError, InvalidHandError
from lis_grasp.geometry import unit
from lis_grasp.io.schemas import parse_entry
from lis_grasp.io.yaml_files import find_yaml_file, read_yaml
from lis_grasp.records import fields_of, read_only
from lis_grasp.robots._build_model import build_model, read_description
from lis_grasp.robots._description import (
    DescriptionEdits,
    JointNumbers,
    links_below,
    parse_description,
    read_joint_numbers,
)
from lis_grasp.robots.arm_defaults import find_arm_exclusions, find_home, flange_frame
from lis_grasp.robots.model_uri import resolve_model
from lis_grasp.robots.pose_ik import ArmKinematics
from lis_grasp.robots.robot_model import Pad, ProbePosture, RobotModel, by_joint_kind, rpy_pose
from lis_grasp.robots.schema import ArmEntry, HandEntry
from lis_grasp.robots.shipped_models import HAND_NAMES, READY_HANDS, arm_path, hand_path
from lis_grasp.typing import FloatArray

# A posture may be this far outside the limits [rad or m]: numbers are written with few digits.
_LIMIT_TOLERANCE = 1e-4

# Where a file gives no limits: a slow arm's speed [rad/s, m/s], reached in this time [s].
_SPEED: Mapping[str, float] = {"revolute": 1.0, "prismatic": 0.25}
_RISE = 0.2
# Stiffness of the joint with the largest effort [N m/rad]; the others' are as their efforts.
_STIFFNESS = 4000.0


def read_hand_file(path_or_name: str | Path) -> dict[str, Any]:
    """Return the fields of a `Hand`; arguments and errors as of `Hand.load`."""
    entry, description, edits, file = _read(path_or_name)
    try:
        model = read_description(description, edits)
    except InvalidFileError as error:
        raise InvalidHandError(f"{file}: {error}", file=file, key="urdf") from None
    return _Assembly(entry, model, file).fields()


def description_of(path_or_name: str | Path) -> tuple[Path, DescriptionEdits]:
    """Return the URDF or SDF of a hand, and what its YAML changes of it; errors as `Hand.load`."""
    _, description, edits, _ = _read(path_or_name)
    return description, edits


def _read(path_or_name: str | Path) -> tuple[HandEntry, Path, DescriptionEdits, str]:
    """Return the YAML's content, its description's path and edits, and the file's name."""
    path = _find(path_or_name)
    try:
        document = read_yaml(path)
    except InvalidFileError as error:
        raise InvalidHandError(f"the hand file {error}", file=path.name) from None
    entry = parse_entry(HandEntry, document, path.name, InvalidHandError)
    try:
        description = resolve_model(entry.urdf, path, entry.model_from)
    except InvalidFileError as error:
        raise InvalidHandError(str(error), file=path.name, key="urdf") from None
    edits = DescriptionEdits.of(entry)
    return entry, description, edits, path.name


def _find(path_or_name: str | Path) -> Path:
    name = str(path_or_name)
    if name in READY_HANDS:
        return hand_path(name)
    advice = f"`lis-grasp hand new {name}` writes the YAML that describes it"
    path = find_yaml_file(
        name, "hand", example=HAND_NAMES[0], advice=advice, error=InvalidHandError
    )
    return path or hand_path(name)


class _Assembly:
    """Combines the YAML file with the links and joints of its URDF, and checks one by the other."""

    def __init__(self, entry: HandEntry, model: RobotModel, file: str) -> None:
        self._entry, self._model, self._file = entry, model, file

    def fields(self) -> dict[str, Any]:
        entry, model, palm = self._entry, self._model, self._entry.palm_frame
        mount = entry.mount
        if tuple(entry.joints) != model.joint_names:
            self._fail(
                "joints",
                "must name the URDF's movable joints in the URDF's order, which is"
                f" {', '.join(model.joint_names)}; it is {', '.join(entry.joints)}",
            )
        if not model.link_geometries:
            self._fail("urdf", "must give links collision bodies; it gives none")
        return {
            **fields_of(model),
            "name": entry.name,
            "kind": entry.kind,
            "pads": self._pads(),
            "X_LH": read_only(rpy_pose(palm.translation, palm.rpy)),
            "approach_H": _unit(entry.approach),
            "pregrasps": MappingProxyType(
                {name: self._posture(f"pregrasps.{name}", q) for name, q in entry.pregrasps.items()}
            ),
            "probe_postures": self._probe_postures(),
            "self_collision_exclusions": self._exclusions(),
            "max_contact_force": entry.max_contact_force,
            "X_FB": None if mount is None else read_only(rpy_pose(mount.translation, mount.rpy)),
        }

    def _pads(self) -> tuple[Pad, ...]:
        return tuple(
            Pad(
                finger=finger,
                link=self._link(f"pads.{finger}.link", pad.link),
                center_L=read_only(np.array(pad.center)),
                radius=pad.radius,
                axis_L=_unit(pad.axis),
                half_angle=pad.half_angle,
            )
            for finger, pad in self._entry.pads.items()
        )

    def _probe_postures(self) -> MappingProxyType[str, ProbePosture]:
        postures = {}
        for finger, probe in self._entry.probe_postures.items():
            key = f"probe_postures.{finger}"
            if finger not in self._entry.pads:
                self._fail(key, "names a finger that has no pad")
            postures[finger] = ProbePosture(
                finger=finger,
                joint_positions=self._posture(f"{key}.positions", probe.positions),
                direction_H=_unit(probe.direction),
                link=self._link(f"{key}.tip.link", probe.tip.link),
                center_L=read_only(np.array(probe.tip.center)),
                radius=probe.tip.radius,
            )
        return MappingProxyType(postures)

    def _exclusions(self) -> frozenset[tuple[str, str]]:
        pairs = [(joint.parent, joint.child) for joint in self._model.joints]
        for i, pair in enumerate(self._entry.self_collision_exclusions):
            first, second = (self._link(f"self_collision_exclusions[{i}]", link) for link in pair)
            pairs.append((first, second))
        return frozenset((min(pair), max(pair)) for pair in pairs)

    def _posture(self, key: str, values: Sequence[float]) -> FloatArray:
        model, positions = self._model, np.array(values)
        if len(positions) != len(model.joint_names):
            self._fail(
                key, f"must be a list of {len(model.joint_names)} numbers; it has {len(positions)}"
            )
        low, high = model.lower - _LIMIT_TOLERANCE, model.upper + _LIMIT_TOLERANCE
        outside = np.flatnonzero((positions < low) | (positions > high))
        if outside.size:
            j = int(outside[0])
            self._fail(
                key,
                f"must be within the joint limits; {model.joint_names[j]} is {positions[j]},"
                f" outside [{model.lower[j]}, {model.upper[j]}]",
            )
        return read_only(np.clip(positions, model.lower, model.upper))

    def _link(self, key: str, name: str) -> str:
        if name not in self._model.links:
            self._fail(key, f"must be a link of the URDF; it has no link '{name}'")
        return name

    def _fail(self, key: str, reason: str) -> NoReturn:
        raise InvalidHandError(f"{self._file}: {key} {reason}", file=self._file, key=key)


def _unit(vector: Sequence[float]) -> FloatArray:
    array = np.array(vector, np.float64)
    return read_only(unit(array))


def read_arm_file(path_or_name: str | Path) -> dict[str, Any]:
    """Return the fields of an `Arm`; arguments and errors as of `Arm.load`."""
    path = arm_path(path_or_name)
    entry = _read_yaml(path)
    try:
        description = resolve_model(entry.urdf, path, entry.model_from)
    except InvalidFileError as error:
        raise InvalidArmError(str(error), file=path.name, key="urdf") from None
    try:
        robot = parse_description(description)
        _cut_at_flange(robot, entry)
        edits = DescriptionEdits.of(entry)
        model = build_model(robot, description, edits)
        numbers = read_joint_numbers(description)
    except InvalidArmError as error:
        raise InvalidArmError(f"{path.name}: {error}", file=path.name, key=error.key) from None
    except (InvalidHandError, InvalidFileError) as error:
        raise InvalidArmError(f"{path.name}: {error}", file=path.name, key="urdf") from None
    return _ArmAssembly(entry, model, numbers, path.name, description).fields()


def _read_yaml(path: Path) -> ArmEntry:
    try:
        document = read_yaml(path)
    except InvalidFileError as error:
        raise InvalidArmError(f"the arm file {error}", file=path.name) from None
    return parse_entry(ArmEntry, document, path.name, InvalidArmError)


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
    by_child = {joint.child: joint for joint in robot.joints}
    chain = [entry.flange]
    while chain[-1] in by_child and chain[-1] != entry.base_link and len(chain) <= len(links):
        chain.append(by_child[chain[-1]].parent)
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
    dropped: set[str] = set()
    for joint in robot.joints:
        if joint.parent not in chain or joint.child in chain:
            continue
        branch = links_below(robot, joint.child)
        if joint.parent == entry.flange or branch & moving:
            dropped |= branch
    robot.links = [link for link in robot.links if link.name not in dropped]
    robot.joints = [joint for joint in robot.joints if joint.child not in dropped]


class _ArmAssembly:
    """Combines the YAML file with the links and joints of its URDF, and checks one by the other."""

    def __init__(
        self,
        entry: ArmEntry,
        model: RobotModel,
        numbers: Mapping[str, JointNumbers],
        file: str,
        description: Path,
    ) -> None:
        self._entry, self._model, self._file = entry, model, file
        self._numbers = [numbers[name] for name in model.joint_names]
        self._path = description

    def fields(self) -> dict[str, Any]:
        entry, model = self._entry, self._model
        names = model.joint_names
        if entry.joints is not None and tuple(entry.joints) != names:
            self._fail(
                "joints",
                "must name the movable joints from the base to the flange, which are"
                f" {', '.join(names)}; it is {', '.join(entry.joints)}",
            )
        followers = [joint.name for joint in model.joints if joint.follows]
        if followers:
            self._fail("urdf", f"must have joints of their own only; {followers[0]} mimics another")
        if not model.link_geometries:
            self._fail("urdf", "must give links collision bodies; it gives none")
        lower, upper = self._position_limits()
        model = RobotModel(**(fields_of(model) | {"lower": lower, "upper": upper}))
        given = entry.flange_pose
        X_LF = read_only(
            flange_frame(model, entry.flange)
            if given is None
            else rpy_pose(given.translation, given.rpy)
        )
        speeds = self._limits("velocity", by_joint_kind(model, **_SPEED))
        effort = model.effort_limits
        exclusions = find_arm_exclusions(model) | self._exclusions()
        kinematics = ArmKinematics(model.joints, entry.flange, X_LF)
        return {
            **fields_of(model),
            "name": entry.name,
            "path": self._path,
            "flange": entry.flange,
            "X_LF": X_LF,
            "home": self._home(kinematics, model, exclusions),
            "velocity_limits": read_only(speeds),
            "acceleration_limits": read_only(self._limits("acceleration", speeds / _RISE)),
            "rotor_inertias": read_only(np.array([n.reflected_inertia for n in self._numbers])),
            "damping": read_only(np.array([n.damping or 0.0 for n in self._numbers])),
            "stiffness": self._stiffness(effort),
            "speed_fraction": entry.speed_fraction,
            "self_collision_exclusions": exclusions,
        }

    def _limits(self, kind: str, otherwise: FloatArray) -> FloatArray:
        """Return the YAML's velocity or acceleration limits, else the file's, else the given."""
        given = getattr(self._entry, f"{kind}_limits")
        self._check_names(f"{kind}_limits", given)
        limits = [getattr(numbers, kind) for numbers in self._numbers]
        limits = [o if own is None else own for own, o in zip(limits, otherwise, strict=True)]
        return np.array(
            [given.get(n, own) for n, own in zip(self._model.joint_names, limits, strict=True)]
        )

    def _position_limits(self) -> tuple[FloatArray, FloatArray]:
        given, model = self._entry.position_limits, self._model
        self._check_names("position_limits", given)
        limits = np.column_stack([model.lower, model.upper])
        for name, (low, high) in given.items():
            if not low < high:
                self._fail(
                    f"position_limits.{name}", f"must be [lower, upper]; it is {[low, high]}"
                )
            limits[model.joint_names.index(name)] = low, high
        lower, upper = (read_only(column.copy()) for column in limits.T)
        return lower, upper

    def _check_names(self, key: str, given: Mapping[str, Any]) -> None:
        for name in given:
            if name not in self._model.joint_names:
                self._fail(
                    f"{key}.{name}",
                    f"must be one of the arm's joints, {', '.join(self._model.joint_names)}",
                )

    def _home(
        self,
        kinematics: ArmKinematics,
        model: RobotModel,
        exclusions: frozenset[tuple[str, str]],
    ) -> FloatArray:
        if self._entry.home is None:
            return read_only(find_home(model, kinematics, exclusions))
        home = self._per_joint("home", self._entry.home)
        outside = np.flatnonzero((home < model.lower - 1e-4) | (home > model.upper + 1e-4))
        if outside.size:
            j = int(outside[0])
            self._fail(
                "home",
                f"must be within the joint limits; {model.joint_names[j]} is {home[j]}, outside"
                f" [{model.lower[j]:g}, {model.upper[j]:g}]",
            )
        return read_only(np.clip(home, model.lower, model.upper))

    def _stiffness(self, effort: FloatArray) -> FloatArray:
        if self._entry.stiffness is None:
            return read_only(_STIFFNESS * effort / effort.max())
        return read_only(self._per_joint("stiffness", self._entry.stiffness))

    def _per_joint(self, key: str, values: Sequence[float]) -> FloatArray:
        count = len(self._model.joint_names)
        if len(values) != count:
            self._fail(key, f"must be a list of {count} numbers; it has {len(values)}")
        return np.array(values)

    def _exclusions(self) -> frozenset[tuple[str, str]]:
        pairs = self._entry.self_collision_exclusions
        for i, pair in enumerate(pairs):
            for link in pair:
                if link not in self._model.links:
                    self._fail(
                        f"self_collision_exclusions[{i}]",
                        f"must be links of the arm; it has no link '{link}'",
                    )
        return frozenset((min(pair), max(pair)) for pair in pairs)

    def _fail(self, key: str, reason: str) -> NoReturn:
        raise InvalidArmError(f"{self._file}: {key} {reason}", file=self._file, key=key)
