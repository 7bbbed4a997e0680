"""Speed, acceleration, damping and rotor inertia of joints, read from a URDF or SDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lis_grasp.robots.hand_urdf import parse_xml

_DRAKE = "{http://drake.mit.edu}"
# Numbers from here on mean "no limit".
_UNLIMITED = 1e6


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


def read_joint_numbers(path: Path) -> Mapping[str, JointNumbers]:
    """Return what a URDF or SDF says of each joint, by its name; an unusable number is None.

    Raises `InvalidFileError` if the file is not XML.
    """
    root = parse_xml(path)
    read = _of_sdf if path.suffix == ".sdf" else _of_urdf
    found: defaultdict[str, dict[str, float | None]] = defaultdict(dict)
    read(root, found)
    return defaultdict(JointNumbers, {name: JointNumbers(**n) for name, n in found.items()})


def _of_urdf(root: ET.Element, found: Mapping[str, dict[str, float | None]]) -> None:
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        if (limit := joint.find("limit")) is not None:
            found[name]["velocity"] = _limit(limit.get("velocity"))
            found[name]["acceleration"] = _limit(limit.get(f"{_DRAKE}acceleration"))
        if (dynamics := joint.find("dynamics")) is not None:
            found[name]["damping"] = _number(dynamics.get("damping"), at_least=0.0)
    for transmission in root.findall("transmission"):
        driven = transmission.find("joint")
        name = "" if driven is None else driven.get("name", "")
        for key in ("rotor_inertia", "gear_ratio"):
            if (value := transmission.find(f"actuator/{_DRAKE}{key}")) is not None:
                found[name][key] = _number(value.get("value"), at_least=0.0)


def _of_sdf(root: ET.Element, found: Mapping[str, dict[str, float | None]]) -> None:
    places: dict[str, tuple[str, Callable[[str | None], float | None]]] = {
        "velocity": ("axis/limit/velocity", _limit),
        "acceleration": (f"axis/limit/{_DRAKE}acceleration", _limit),
        "damping": ("axis/dynamics/damping", lambda text: _number(text, at_least=0.0)),
        "rotor_inertia": (f"{_DRAKE}rotor_inertia", lambda text: _number(text, at_least=0.0)),
        "gear_ratio": (f"{_DRAKE}gear_ratio", lambda text: _number(text, at_least=0.0)),
    }
    for joint in root.iter("joint"):
        name = joint.get("name", "")
        for key, (place, parse) in places.items():
            found[name][key] = parse(joint.findtext(place))


def _limit(text: str | None) -> float | None:
    """Return a limit above 0; None where there is none."""
    limit = _number(text, at_least=0.0)
    return limit if limit is not None and 0.0 < limit < _UNLIMITED else None


def _number(text: str | None, *, at_least: float) -> float | None:
    try:
        number = float("nan" if text is None else text)
    except ValueError:
        return None
    return number if np.isfinite(number) and number >= at_least else None
