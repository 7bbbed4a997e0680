"""Points in NPY and NPZ files and in texts without a header, as columns by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, note
from lis_grasp.geometry import UNIT_TOLERANCE
from lis_grasp.io._point_columns import NORMAL, POINT
from lis_grasp.io.csv_tables import DECIMAL_COMMA, cell_number, text_of, uncommented
from lis_grasp.io.limits import read_arrays

Columns = dict[str, npt.NDArray[Any]]

_SIDES = {"points": POINT, "normals": NORMAL, "approach": ("ax", "ay", "az")}
# Synonyms among the names of an NPZ's arrays.
_NAMES = {
    **dict.fromkeys(("xyz", "point", "positions", "pcd", "pc", "point_cloud", "arr_0"), "points"),
    **dict.fromkeys(("normal", "n"), "normals"),
    "forces": "force",
    "times": "time",
}


def read_rows(path: Path) -> Columns:
    """Return the columns of a text of numbers: points, then perhaps normals, then anything.

    Cells are separated by blanks, commas or semicolons; a first row of one number counts the rows.
    """
    _, lines = uncommented(text_of(path, ascii_only=True))
    if lines and lines[0].strip().isdecimal():
        count = int(lines.pop(0))
        if count != len(lines):
            raise InvalidFileError.of(path, f"announces {count} points, and has {len(lines)} rows")
    first = lines[0] if lines else ""
    mark = next((mark for mark in ";," if mark in first), None)
    if mark == "," and all(map(DECIMAL_COMMA.fullmatch, first.split()[:3])):
        mark = None
    return positional(path, [line.split(mark) for line in lines])


def positional(path: Path, rows: Sequence[Sequence[str]]) -> Columns:
    """Return columns without names: a point, and a normal where all lengths are 1."""
    short = next((number for number, row in enumerate(rows) if len(row) < len(POINT)), None)
    if short is not None:
        raise InvalidFileError(
            f"{path}: row {short + 1} has {len(rows[short])} of the 3 numbers of a point: separate"
            " them by blanks, commas or semicolons",
            path=path,
        )
    points = np.array(
        [
            [cell_number(path, row[k].strip(), n + 1, name) for k, name in enumerate(POINT)]
            for n, row in enumerate(rows)
        ]
    ).reshape(-1, 3)
    columns = dict(zip(POINT, points.T, strict=True))
    if min(map(len, rows), default=0) <= len(POINT):
        return columns
    try:
        others = np.array([row[3:6] for row in rows], dtype=np.float64)
    except ValueError:
        others = np.empty((len(rows), 0))
    if others.shape[1] == len(NORMAL):
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(others, axis=1)
        known = lengths[np.isfinite(lengths) & (lengths > 0.0)]
        if len(known) and (np.abs(known - 1.0) < UNIT_TOLERANCE).all():
            note(f"{path}: columns 4 to 6 have length 1, and are read as normals")
            return columns | dict(zip(NORMAL, others.T, strict=True))
    note(f"{path}: columns from the fourth on are not used: they are no normals of length 1")
    return columns


def read_npy(path: Path) -> Columns:
    """Return the columns of an array of shape (..., 3), (..., 6) with normals, or with names."""
    return columns_of(path, np.load(path, allow_pickle=False))


def columns_of(path: Path, array: npt.NDArray[Any]) -> Columns:
    """Return the columns of an array of points, as `read_npy` does."""
    return _named(path, "points", array)


def read_npz(path: Path) -> Columns:
    """Return the columns of an archive of arrays: `points`, and perhaps `normals` and others."""
    arrays = read_arrays(path)
    columns: Columns = {}
    for name, array in arrays.items():
        columns |= _named(path, _NAMES.get(name.lower(), name.lower()), array)
    if "x" not in columns:
        raise InvalidFileError(
            f"{path} must have an array points of shape (N, 3); it has"
            f" {', '.join(arrays) or 'none'}",
            path=path,
        )
    return columns


def _named(path: Path, name: str, array: npt.NDArray[Any]) -> Columns:
    """Return an array as columns: by its names, by its meaning, or as one column."""
    if array.dtype.names:
        return {column: np.ravel(array[column]) for column in array.dtype.names}
    if name in _SIDES and array.dtype.kind not in "fiu":
        raise InvalidFileError(f"{path}: the array {name} must be of numbers", path=path)
    if name == "points" and array.ndim > 1 and array.shape[-1] == 6:
        return _named(path, "points", array[..., :3]) | _named(path, "normals", array[..., 3:])
    if name in _SIDES:
        if array.ndim < 2 or array.shape[-1] != 3:
            raise InvalidFileError(
                f"{path}: {name} must have shape (N, 3), or (N, 6) with normals; it is"
                f" {array.shape}",
                path=path,
            )
        return dict(zip(_SIDES[name], array.reshape(-1, 3).T, strict=True))
    return {name: np.ravel(array)}
