"""Grasp files (grasps.json): every grasp of a search at full precision, with frames and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.io.schemas import Count, FileRecord, Number, Pose, Vector, read_json
from lis_grasp.records import fields_of

_FRAMES = {
    "O": "object frame: the frame of the contacts and the surface; gravity is -z",
    "H": "palm frame of the hand, as its YAML defines it",
    "X_OH": "pose of H in O, row-major 4x4",
}
_UNITS = {"length": "m", "angle": "rad", "force": "N"}
_CONTACT = ("finger", "point", "normal", "force")


class _Contact(FileRecord):
    finger: str
    point: Vector
    normal: Vector
    force: Vector


class _Grasp(FileRecord):
    hand: str
    X_OH: Pose
    joint_names: list[str]
    joint_positions: list[Number]
    pregrasp_positions: list[Number]
    approach_O: Vector
    contacts: list[_Contact]
    quality: dict[str, Number]
    accepted: str
    family: str = "pinch"  # the only one in 1.4


class _Search(FileRecord):
    grasps: list[_Grasp]
    rejections: dict[str, Count]
    candidates: Count
    hit_bodies: dict[str, Count] = Field(default_factory=dict)


def write_grasp_file(search: Mapping[str, Any], path: Path, *, header: str = "") -> None:
    """Write the fields of a `GraspSearch`; for arguments and errors see `GraspSearch.save`."""
    content = {
        "format": "lis_grasp grasps 1",
        "header": header,
        "frames": _FRAMES,
        "units": _UNITS,
        "candidates": search["candidates"],
        "rejections": dict(sorted(search["rejections"].items())),
        **({"hit_bodies": dict(search["hit_bodies"])} if search["hit_bodies"] else {}),
        "grasps": [_to_plain(fields_of(grasp)) for grasp in search["grasps"]],
    }
    write_json(path, content)


def read_grasp_file(path: Path, grasp: Callable[..., Any]) -> dict[str, Any]:
    """Return the fields of a `GraspSearch` in a file; `grasp` makes each grasp from its fields.

    For errors see `GraspSearch.load`.
    """
    content = read_json(_Search, path, "grasps", "name a grasps.json of `lis-grasp grasp`")
    try:
        grasps = tuple(grasp(**_fields(entry)) for entry in content.grasps)
    except InvalidOptionError as error:
        raise InvalidFileError(
            f"{path} has no valid grasps: {error}", path=path, field=error.option
        ) from None
    counts = {name: getattr(content, name) for name in ("rejections", "candidates", "hit_bodies")}
    return {"grasps": grasps, **counts}


def _to_plain(grasp: Mapping[str, Any]) -> dict[str, Any]:
    plain = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in grasp.items()}
    rows = zip(*(plain[f"contact_{name}s"] for name in _CONTACT), strict=True)
    plain["quality"] = dict(grasp["quality"])
    plain["contacts"] = [dict(zip(_CONTACT, row, strict=True)) for row in rows]
    return {name: plain[name] for name in _Grasp.model_fields}


def _fields(entry: _Grasp) -> dict[str, Any]:
    columns = {name: [getattr(contact, name) for contact in entry.contacts] for name in _CONTACT}
    return {
        **{name: getattr(entry, name) for name in _Grasp.model_fields if name != "contacts"},
        "joint_names": tuple(entry.joint_names),
        "contact_fingers": tuple(columns["finger"]),
        "contact_points": np.reshape(columns["point"], (-1, 3)),
        "contact_normals": np.reshape(columns["normal"], (-1, 3)),
        "contact_forces": np.reshape(columns["force"], (-1, 3)),
    }
