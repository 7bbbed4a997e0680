"""Read a hand from its YAML file and the URDF that it names, and say what is wrong with them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import numpy as np
import yaml

from lis_grasp.exceptions import InvalidFileError, InvalidHandError, shown
from lis_grasp.hands.hand_parts import HandKind, Joint, Pad, ProbePosture
from lis_grasp.hands.hand_sdf import read_sdf
from lis_grasp.hands.hand_urdf import read_urdf
from lis_grasp.hands.link_tree import HandModel, rpy_pose
from lis_grasp.hands.model_uri import resolve_uri
from lis_grasp.hands.shipped_models import HAND_NAMES, model_path
from lis_grasp.typing import FloatArray

# A posture may be this far outside the limits [rad or m]: numbers are written with few digits.
_LIMIT_TOLERANCE = 1e-4
# No length, angle or force of a hand is larger [m, rad, N].
_LARGEST = 1e6


def read_hand_file(path_or_name: str | Path) -> dict[str, Any]:
    """Return the fields of a `Hand`: of one of `HAND_NAMES`, or of the path of a YAML file.

    Raises
    ------
    InvalidHandError
        If there is no such hand, or its YAML or URDF is incomplete or contradicts itself.
    """
    path = _find(path_or_name)
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidHandError(f"the hand file {path} cannot be read: {error}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InvalidHandError(f"the hand file {path} is not valid YAML: {reason}") from None
    return _Reader(path.name).hand(document, path.parent)


def _find(path_or_name: str | Path) -> Path:
    if str(path_or_name) in HAND_NAMES:
        return model_path(f"hands/{path_or_name}/{path_or_name}.yaml")
    path = Path(path_or_name)
    if not os.path.isfile(path):
        raise InvalidHandError(
            f"a hand must be one of {', '.join(HAND_NAMES)}, or a hand's YAML file;"
            f" '{path_or_name}' is neither"
        )
    return path


class _Reader:
    """Checks every value as it is taken out of the YAML; messages name the file and the key."""

    def __init__(self, file: str) -> None:
        self._file = file

    def hand(self, document: Any, folder: Path) -> dict[str, Any]:
        keys = (
            "name kind urdf joints palm_frame approach max_contact_force pads pregrasps"
            " probe_postures self_collision_exclusions"
        )
        top = self._mapping("the file", document, keys)
        try:
            path = resolve_uri(self._text("urdf", top["urdf"]), folder, "urdf")
            model = read_sdf(path) if path.suffix == ".sdf" else read_urdf(path)
        except InvalidFileError as error:
            raise InvalidHandError(f"{self._file}: {error}") from None
        self._check_joints(top["joints"], model)
        if not model.link_geometries:
            self._fail(f"{path.name} must give links collision bodies; it gives none")
        palm = self._mapping("palm_frame", top["palm_frame"], "translation rpy")
        pads = self._pads(top["pads"], model)
        return {
            "name": self._text("name", top["name"]),
            "kind": self._kind(top["kind"]),
            "joint_names": model.joint_names,
            "lower": model.lower,
            "upper": model.upper,
            "effort_limits": model.effort_limits,
            "links": model.links,
            "joints": model.joints,
            "inertials": model.inertials,
            "link_geometries": model.link_geometries,
            "pads": pads,
            "X_LH": _read_only(
                rpy_pose(
                    self._numbers("palm_frame.translation", palm["translation"], 3),
                    self._numbers("palm_frame.rpy", palm["rpy"], 3),
                )
            ),
            "approach_H": self._direction("approach", top["approach"]),
            "pregrasps": self._pregrasps(top["pregrasps"], model),
            "probe_postures": self._probe_postures(top["probe_postures"], model, pads),
            "self_collision_exclusions": self._exclusions(top["self_collision_exclusions"], model),
            "max_contact_force": self._positive("max_contact_force", top["max_contact_force"]),
        }

    def _kind(self, value: Any) -> HandKind:
        kinds: tuple[HandKind, ...] = get_args(HandKind)
        for kind in kinds:
            if value == kind:
                return kind
        return self._fail(f"kind must be one of {', '.join(kinds)}; it is {shown(value)}")

    def _check_joints(self, value: Any, model: HandModel) -> None:
        names = [self._text("joints", name) for name in self._sequence("joints", value)]
        if tuple(names) != model.joint_names:
            self._fail(
                "joints must name the URDF's movable joints in the URDF's order, which is"
                f" {', '.join(model.joint_names)}; it is {', '.join(names)}"
            )

    def _pads(self, value: Any, model: HandModel) -> tuple[Pad, ...]:
        pads = []
        for finger, entry in self._named("pads", value).items():
            key = f"pads.{finger}"
            pad = self._mapping(key, entry, "link center radius axis half_angle")
            radius = self._number(f"{key}.radius", pad["radius"])
            if radius < 0.0:
                self._fail(f"{key}.radius must be at least 0 m (0: a flat pad); it is {radius}")
            half_angle = self._positive(f"{key}.half_angle", pad["half_angle"])
            if half_angle > np.pi:
                self._fail(f"{key}.half_angle must be at most pi rad; it is {half_angle}")
            pads.append(
                Pad(
                    finger=finger,
                    link=self._link(f"{key}.link", pad["link"], model),
                    center_L=self._numbers(f"{key}.center", pad["center"], 3),
                    radius=radius,
                    axis_L=self._direction(f"{key}.axis", pad["axis"]),
                    half_angle=half_angle,
                )
            )
        if len(pads) < 2:
            self._fail(f"pads must name at least two fingers; it names {len(pads)}")
        return tuple(pads)

    def _pregrasps(self, value: Any, model: HandModel) -> Mapping[str, FloatArray]:
        return MappingProxyType(
            {
                name: self._posture(f"pregrasps.{name}", positions, model)
                for name, positions in self._named("pregrasps", value).items()
            }
        )

    def _probe_postures(
        self, value: Any, model: HandModel, pads: tuple[Pad, ...]
    ) -> Mapping[str, ProbePosture]:
        postures = {}
        for finger, entry in self._named("probe_postures", value).items():
            key = f"probe_postures.{finger}"
            if finger not in {pad.finger for pad in pads}:
                self._fail(f"{key} names a finger that has no pad")
            posture = self._mapping(key, entry, "positions direction tip")
            tip = self._mapping(f"{key}.tip", posture["tip"], "link center radius")
            postures[finger] = ProbePosture(
                finger=finger,
                joint_positions=self._posture(f"{key}.positions", posture["positions"], model),
                direction_H=self._direction(f"{key}.direction", posture["direction"]),
                link=self._link(f"{key}.tip.link", tip["link"], model),
                center_L=self._numbers(f"{key}.tip.center", tip["center"], 3),
                radius=self._positive(f"{key}.tip.radius", tip["radius"]),
            )
        return MappingProxyType(postures)

    def _exclusions(self, value: Any, model: HandModel) -> frozenset[tuple[str, str]]:
        pairs = [_pair(joint) for joint in model.joints]
        for i, entry in enumerate(self._sequence("self_collision_exclusions", value)):
            key = f"self_collision_exclusions[{i}]"
            pair = self._sequence(key, entry)
            if len(pair) != 2:
                self._fail(f"{key} must name two links; it names {len(pair)}")
            first, second = sorted(self._link(key, link, model) for link in pair)
            pairs.append((first, second))
        return frozenset(pairs)

    def _posture(self, key: str, value: Any, model: HandModel) -> FloatArray:
        positions = self._numbers(key, value, len(model.joint_names))
        low, high = model.lower - _LIMIT_TOLERANCE, model.upper + _LIMIT_TOLERANCE
        outside = np.flatnonzero((positions < low) | (positions > high))
        if outside.size:
            j = int(outside[0])
            self._fail(
                f"{key} must be within the joint limits; {model.joint_names[j]} is {positions[j]},"
                f" outside [{model.lower[j]}, {model.upper[j]}]"
            )
        return _read_only(np.clip(positions, model.lower, model.upper))

    def _link(self, key: str, value: Any, model: HandModel) -> str:
        name = self._text(key, value)
        if name not in model.links:
            self._fail(f"{key} must be a link of the URDF; it has no link '{name}'")
        return name

    def _mapping(self, key: str, value: Any, keys: str) -> Mapping[str, Any]:
        """Return a mapping that has exactly these keys."""
        wanted = keys.split()
        if not isinstance(value, dict):
            self._fail(f"{key} must be a mapping with the keys {', '.join(wanted)}")
        missing = [k for k in wanted if k not in value]
        if missing:
            self._fail(f"{key} lacks {', '.join(missing)}")
        unknown = [str(k) for k in value if k not in wanted]
        if unknown:
            self._fail(
                f"{key} has the unknown key {', '.join(unknown)}; it knows {', '.join(wanted)}"
            )
        return value

    def _named(self, key: str, value: Any) -> Mapping[str, Any]:
        """Return a mapping whose keys are names of the user's choice."""
        if not isinstance(value, dict) or not value:
            self._fail(f"{key} must be a mapping with at least one name")
        return {self._text(key, name): entry for name, entry in value.items()}

    def _sequence(self, key: str, value: Any) -> Sequence[Any]:
        if not isinstance(value, list):
            self._fail(f"{key} must be a list; it is {shown(value)}")
        return value

    def _text(self, key: str, value: Any) -> str:
        if not isinstance(value, str) or not value:
            self._fail(f"{key} must be a name; it is {shown(value)}")
        return value

    def _number(self, key: str, value: Any) -> float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not abs(value) <= _LARGEST:
            self._fail(f"{key} must be a finite number, within {_LARGEST:g}; it is {shown(value)}")
        return float(value)

    def _positive(self, key: str, value: Any) -> float:
        number = self._number(key, value)
        if number <= 0.0:
            self._fail(f"{key} must be above 0; it is {number}")
        return number

    def _numbers(self, key: str, value: Any, count: int) -> FloatArray:
        values = self._sequence(key, value)
        if len(values) != count:
            self._fail(f"{key} must be a list of {count} numbers; it has {len(values)}")
        numbers = [self._number(f"{key}[{i}]", entry) for i, entry in enumerate(values)]
        return _read_only(np.array(numbers))

    def _direction(self, key: str, value: Any) -> FloatArray:
        vector = self._numbers(key, value, 3)
        length = float(np.linalg.norm(vector))
        if length == 0.0:
            self._fail(f"{key} must not be zero; give the direction that it means")
        return _read_only(vector / length)

    def _fail(self, reason: str) -> Any:
        raise InvalidHandError(f"{self._file}: {reason}")


def _pair(joint: Joint) -> tuple[str, str]:
    first, second = sorted((joint.parent, joint.child))
    return first, second


def _read_only(array: FloatArray) -> FloatArray:
    array.flags.writeable = False
    return array
