"""Grasp records: palm pose, joints, contacts and qualities; reading and writing of grasps.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.records import read_only, reduce_record
from lis_grasp.typing import FloatArray

_FRAMES = {
    "O": "object frame: the frame of the contacts and the surface; gravity is -z",
    "H": "palm frame of the hand, as its YAML defines it",
    "X_OH": "pose of H in O, row-major 4x4",
}
_UNITS = {"length": "m", "angle": "rad", "force": "N"}
_CONTACT = ("finger", "point", "normal", "force")


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """A hand at an object, its fingers in contact.

    Parameters
    ----------
    hand
        Name of the hand.
    X_OH
        Shape (4, 4): pose of the palm frame H in the object frame O.
    joint_names, joint_positions, pregrasp_positions
        J names; positions (J,) [rad or m] in contact, and opened with the palm at the same pose.
    approach_O
        Shape (3,), unit, in O: direction of the hand's motion to X_OH.
    contact_points, contact_normals
        Shape (C, 3): in O [m], and unit, outward of the object.
    contact_fingers
        C names: which finger makes each contact.
    contact_forces
        Shape (C, 3) [N]: planned squeeze on the object, in O.
    quality
        Values by name; ``"epsilon"`` is always there.
    accepted
        Why it was accepted, in words.

    Raises
    ------
    InvalidOptionError
        If shapes disagree or a number is not finite.
    """

    hand: str
    X_OH: FloatArray
    joint_names: tuple[str, ...]
    joint_positions: FloatArray
    pregrasp_positions: FloatArray
    approach_O: FloatArray
    contact_points: FloatArray
    contact_normals: FloatArray
    contact_fingers: tuple[str, ...]
    contact_forces: FloatArray
    quality: Mapping[str, float]
    accepted: str

    def __post_init__(self) -> None:
        joints, contacts = len(self.joint_names), len(self.contact_fingers)
        for name, shape in (
            ("X_OH", (4, 4)),
            ("joint_positions", (joints,)),
            ("pregrasp_positions", (joints,)),
            ("approach_O", (3,)),
            ("contact_points", (contacts, 3)),
            ("contact_normals", (contacts, 3)),
            ("contact_forces", (contacts, 3)),
        ):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidOptionError(
                    f"a grasp's {name} must be finite numbers of shape {shape};"
                    f" its shape is {array.shape}",
                    option=name,
                )
            object.__setattr__(self, name, read_only(array))
        for name in ("joint_names", "contact_fingers"):
            if not all(isinstance(item, str) for item in getattr(self, name)):
                raise InvalidOptionError(f"a grasp's {name} must be texts", option=name)
            object.__setattr__(self, name, tuple(getattr(self, name)))
        values = {str(name): float(value) for name, value in self.quality.items()}
        if "epsilon" not in values or not all(map(math.isfinite, values.values())):
            raise InvalidOptionError(
                f"a grasp's quality must be finite numbers, one named 'epsilon'; it is {values}",
                option="quality",
            )
        object.__setattr__(self, "quality", MappingProxyType(values))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)


@dataclass(frozen=True, slots=True, eq=False)
class GraspSearch:
    """The result of a search for grasps, which may have found none.

    Parameters
    ----------
    grasps
        Accepted grasps, the best first.
    rejections
        Number of rejected candidates by reason; `ForceClosureSampler.sample` names the reasons.
    candidates
        Number of all candidates.
    """

    grasps: tuple[Grasp, ...]
    rejections: Mapping[str, int] = field(default_factory=dict)
    candidates: int = 0


def save_grasps(path: Path | str, search: GraspSearch, *, header: str = "") -> None:
    """Write a search as JSON: frames, units, every grasp at full precision, the best first."""
    content = {
        "format": "lis_grasp grasps 1",
        "header": header,
        "frames": _FRAMES,
        "units": _UNITS,
        "candidates": search.candidates,
        "rejections": dict(sorted(search.rejections.items())),
        "grasps": [_to_plain(grasp) for grasp in search.grasps],
    }
    write_json(Path(path), content)


def load_grasps(path: Path | str) -> GraspSearch:
    """Read a file of `save_grasps`.

    Raises
    ------
    InvalidFileError
        If the file is missing, is no JSON, or lacks a field.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return GraspSearch(
            grasps=tuple(_from_plain(entry) for entry in content["grasps"]),
            rejections={str(k): int(v) for k, v in content["rejections"].items()},
            candidates=int(content["candidates"]),
        )
    except OSError as error:
        reason = f"cannot read {path}: {error.strerror}"
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = f"{path} is no JSON of grasps: {error}"
    except KeyError as error:
        reason = f"{path} lacks {error}; write it with `lis-grasp grasp`"
    except (TypeError, ValueError, OverflowError, AttributeError, InvalidOptionError) as error:
        reason = f"{path} holds no valid grasps: {error}"
    raise InvalidFileError(reason, path=path)


def _to_plain(grasp: Grasp) -> dict[str, Any]:
    return {
        "hand": grasp.hand,
        "X_OH": grasp.X_OH.tolist(),
        "joint_names": list(grasp.joint_names),
        "joint_positions": grasp.joint_positions.tolist(),
        "pregrasp_positions": grasp.pregrasp_positions.tolist(),
        "approach_O": grasp.approach_O.tolist(),
        "contacts": [
            dict(zip(_CONTACT, (finger, *(array.tolist() for array in arrays)), strict=True))
            for finger, *arrays in zip(
                grasp.contact_fingers,
                grasp.contact_points,
                grasp.contact_normals,
                grasp.contact_forces,
                strict=True,
            )
        ],
        "quality": dict(grasp.quality),
        "accepted": grasp.accepted,
    }


def _from_plain(entry: Mapping[str, Any]) -> Grasp:
    columns = [[contact[name] for contact in entry["contacts"]] for name in _CONTACT]
    fingers, points, normals, forces = columns
    same = ("X_OH", "joint_positions", "pregrasp_positions", "approach_O", "quality")
    return Grasp(
        hand=str(entry["hand"]),
        joint_names=tuple(entry["joint_names"]),
        contact_points=np.reshape(points, (-1, 3)),
        contact_normals=np.reshape(normals, (-1, 3)),
        contact_fingers=tuple(fingers),
        contact_forces=np.reshape(forces, (-1, 3)),
        accepted=str(entry["accepted"]),
        **{name: entry[name] for name in same},
    )
