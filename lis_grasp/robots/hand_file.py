"""Reading of a hand's YAML file and of the URDF or SDF that it names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidHandError
from lis_grasp.geometry import unit
from lis_grasp.io.schemas import parse_entry
from lis_grasp.io.yaml_files import find_yaml_file, read_yaml
from lis_grasp.records import fields_of, read_only
from lis_grasp.robots.description_edits import DescriptionEdits
from lis_grasp.robots.hand_parts import Pad, ProbePosture
from lis_grasp.robots.hand_plugins import hand_path
from lis_grasp.robots.hand_schema import HandEntry
from lis_grasp.robots.link_tree import HandModel, rpy_pose
from lis_grasp.robots.model_uri import resolve_model
from lis_grasp.robots.robot_description import read_description
from lis_grasp.robots.shipped_models import HAND_NAMES, READY_HANDS
from lis_grasp.typing import FloatArray

# A posture may be this far outside the limits [rad or m]: numbers are written with few digits.
_LIMIT_TOLERANCE = 1e-4


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

    def __init__(self, entry: HandEntry, model: HandModel, file: str) -> None:
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
