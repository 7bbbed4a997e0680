"""Files of points that may lack normals: contact files, .off and .xyz."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.contact_files import read_contact_fields
from lis_grasp.io.file_limits import MEBIBYTE, require_file_size
from lis_grasp.typing import FloatArray

_MOST_BYTES = 256 * MEBIBYTE
_POINTS_ONLY = (".off", ".xyz")
POINT_FORMATS = (".ply", ".csv", *_POINTS_ONLY)
"""Endings of the files of points that can be read."""


def read_point_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` in a file that may lack normals, and `approach`.

    `normals` and `approach`, the direction of motion at contact, are of shape (N, 3), or None where
    the file lacks them. .ply and .csv files are read as contact files; .off and .xyz files have
    points only.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, damaged, or lacks points.
    """
    ending = path.suffix.lower()
    if ending not in POINT_FORMATS:
        raise InvalidFileError(
            f"files of points end in one of {', '.join(POINT_FORMATS)}; {path} does not: convert"
            f" it, or plan on a mesh directly by `lis-grasp grasp {path}`",
            path=path,
        )
    if ending in _POINTS_ONLY:
        return {"points": _load_points(path), "normals": None, "approach": None}
    return read_contact_fields(path)


def no_faces_error(path: Path) -> InvalidFileError:
    """Return the error of a file without faces where a mesh is needed."""
    advice = "export it again"
    if path.suffix.lower() in POINT_FORMATS:
        advice = f"`lis-grasp estimate {path}` makes a surface from a file of points"
    return InvalidFileError(f"{path} has no faces, and a mesh is needed: {advice}", path=path)


def _load_points(path: Path) -> FloatArray:
    """Return the points of an .off or .xyz file, in the file's order."""
    try:
        require_file_size(path, _MOST_BYTES)
        found = _vertices_of_off(path) if path.suffix.lower() == ".off" else _rows_of_xyz(path)
    except InvalidFileError:
        raise
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except Exception as error:  # noqa: BLE001 - the readers raise anything on damaged files
        message = f"{path} cannot be read as points ({error}): write columns x,y,z as .csv"
        raise InvalidFileError(message, path=path) from None
    points = np.asarray(found, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InvalidFileError(f"{path} has no points", path=path)
    return points


def _vertices_of_off(path: Path) -> Any:
    with path.open("rb") as file:
        loaded = trimesh.load(file, file_type="off", process=False)
    return getattr(loaded, "vertices", None)


def _rows_of_xyz(path: Path) -> FloatArray:
    """Return the first three columns; others, such as colours, may hold anything."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        return np.empty((0, 3))
    return np.loadtxt(rows, usecols=(0, 1, 2), ndmin=2, delimiter="," if "," in rows[0] else None)
