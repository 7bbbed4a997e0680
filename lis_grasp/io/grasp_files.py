"""Grasp files (grasps.json): every grasp of a search at full precision, with frames and units."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.atomic_writing import write_json
from lis_grasp.records import fields_of

_FRAMES = {
    "O": "object frame: the frame of the contacts and the surface; gravity is -z",
    "H": "palm frame of the hand, as its YAML defines it",
    "X_OH": "pose of H in O, row-major 4x4",
}
_UNITS = {"length": "m", "angle": "rad", "force": "N"}
_CONTACT = ("finger", "point", "normal", "force")


def write_grasp_file(search: Mapping[str, Any], path: Path, *, header: str = "") -> None:
    """Write the fields of a `GraspSearch`; arguments and errors as of `GraspSearch.save`."""
    content = {
        "format": "lis_grasp grasps 1",
        "header": header,
        "frames": _FRAMES,
        "units": _UNITS,
        "candidates": search["candidates"],
        "rejections": dict(sorted(search["rejections"].items())),
        "grasps": [_to_plain(fields_of(grasp)) for grasp in search["grasps"]],
    }
    write_json(path, content)


def read_grasp_file(path: Path, grasp: Callable[..., Any]) -> dict[str, Any]:
    """Return the fields of a `GraspSearch` in a file; `grasp` makes each grasp from its fields.

    Errors are as of `GraspSearch.load`.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {
            "grasps": tuple(grasp(**_fields(entry)) for entry in content["grasps"]),
            "rejections": {str(k): int(v) for k, v in content["rejections"].items()},
            "candidates": int(content["candidates"]),
        }
    except OSError as error:
        reason = f"cannot read {path}: {error.strerror}"
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = f"{path} is no JSON of grasps: {error}"
    except KeyError as error:
        reason = f"{path} lacks {error}; write it with `lis-grasp grasp`"
    except (TypeError, ValueError, OverflowError, AttributeError, InvalidOptionError) as error:
        reason = f"{path} has no valid grasps: {error}"
    raise InvalidFileError(reason, path=path)


def _to_plain(grasp: Mapping[str, Any]) -> dict[str, Any]:
    fingers, *arrays = (grasp[f"contact_{name}s"] for name in _CONTACT)
    rows = zip(fingers, *(array.tolist() for array in arrays), strict=True)
    return {
        "hand": grasp["hand"],
        "X_OH": grasp["X_OH"].tolist(),
        "joint_names": list(grasp["joint_names"]),
        "joint_positions": grasp["joint_positions"].tolist(),
        "pregrasp_positions": grasp["pregrasp_positions"].tolist(),
        "approach_O": grasp["approach_O"].tolist(),
        "contacts": [dict(zip(_CONTACT, row, strict=True)) for row in rows],
        "quality": dict(grasp["quality"]),
        "accepted": grasp["accepted"],
    }


def _fields(entry: Mapping[str, Any]) -> dict[str, Any]:
    columns = [[contact[name] for contact in entry["contacts"]] for name in _CONTACT]
    fingers, points, normals, forces = columns
    same = ("X_OH", "joint_positions", "pregrasp_positions", "approach_O", "quality")
    return dict(
        hand=str(entry["hand"]),
        joint_names=tuple(entry["joint_names"]),
        contact_points=np.reshape(points, (-1, 3)),
        contact_normals=np.reshape(normals, (-1, 3)),
        contact_fingers=tuple(fingers),
        contact_forces=np.reshape(forces, (-1, 3)),
        accepted=str(entry["accepted"]),
        **{name: entry[name] for name in same},
    )
