"""Contacts in files: PLY, an oriented point cloud that every point-cloud program opens, and CSV.

PLY, as written: ASCII; element ``vertex`` with x y z nx ny nz and, where known, force, time and
finger (an index into the names in a ``fingers`` comment); element ``free_point`` with x y z and
the radius that is free round it.
CSV, as written: a header row ``x,y,z,nx,ny,nz``, then force, time, finger where known, and
``kind`` (contact or free) and ``radius`` where there are free points. Both give every number back
to the bit and the same contacts as the same bytes. As read: any order and precision of properties,
text or binary; what is not named here is passed over.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from plyfile import PlyData, PlyElement

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.ply_reading import read_ply
from lis_grasp.typing import FloatArray

if TYPE_CHECKING:
    from lis_grasp.contacts import Contacts

_POINT = ("x", "y", "z")
_NORMAL = ("nx", "ny", "nz")
_FINGERS = "fingers "
# CloudCompare puts this before the names of properties that it does not know.
_PREFIXES = ("", "scalar_")


def read_contact_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` that a .ply or .csv file has, in metres, in frame O.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, damaged, or lacks points or normals.
    """
    _require_format(path)
    try:
        return _load_ply(path) if path.suffix.lower() == ".ply" else _load_csv(path)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}") from None


def write_contact_file(contacts: Contacts, path: Path, *, header: str = "") -> None:
    """Write contacts to a .ply or .csv file.

    Parameters
    ----------
    contacts
        What to write.
    path
        Ends in .ply or .csv, which chooses the format.
    header
        Lines that say what made the contacts: comments of a PLY; a CSV has no place for them.

    Raises
    ------
    InvalidFileError
        If the path has another ending or cannot be written to.
    """
    _require_format(path)
    is_ply = path.suffix.lower() == ".ply"
    content = _ply_bytes(contacts, header) if is_ply else _csv_bytes(contacts)
    write_bytes(path, content)


def _require_format(path: Path) -> None:
    if path.suffix.lower() not in (".ply", ".csv"):
        raise InvalidFileError(f"contacts are kept in .ply or .csv files; {path} is neither")


def _ply_bytes(contacts: Contacts, header: str) -> bytes:
    columns: dict[str, npt.NDArray[Any]] = dict(zip(_POINT, contacts.points.T, strict=True))
    columns |= dict(zip(_NORMAL, contacts.normals.T, strict=True))
    comments = [line.rstrip() for line in header.splitlines() if line.strip()]
    if contacts.forces is not None:
        columns["force"] = contacts.forces
    if contacts.times is not None:
        columns["time"] = contacts.times
    if contacts.fingers:
        names = sorted(set(contacts.fingers))
        columns["finger"] = np.array([names.index(f) for f in contacts.fingers], dtype=np.int32)
        comments.append(_FINGERS + json.dumps(names))
    elements = [_element("vertex", columns)]
    if len(contacts.free_points):
        free: dict[str, npt.NDArray[Any]] = dict(zip(_POINT, contacts.free_points.T, strict=True))
        elements.append(_element("free_point", free | {"radius": contacts.free_radii}))
    ascii_comments = [c.encode("ascii", "backslashreplace").decode() for c in comments]
    file = io.BytesIO()
    PlyData(elements, text=True, comments=ascii_comments).write(file)
    return file.getvalue()


def _element(name: str, columns: dict[str, npt.NDArray[Any]]) -> PlyElement:
    rows = np.empty(
        len(next(iter(columns.values()))), dtype=[(key, c.dtype.str) for key, c in columns.items()]
    )
    for key, column in columns.items():
        rows[key] = column
    return PlyElement.describe(rows, name)


def _load_ply(path: Path) -> dict[str, Any]:
    data = read_ply(path)
    elements = {element.name: element.data for element in data.elements}
    if "vertex" not in elements:
        raise InvalidFileError(f"{path} has no element 'vertex', so it holds no points")
    rows = elements["vertex"]
    points, normals = _ply_columns(path, rows, _POINT), _ply_columns(path, rows, _NORMAL)
    fingers: tuple[str, ...] = ()
    index = _optional(rows, "finger")
    if index is not None:
        fingers = _finger_names(path, data.comments, index)
    free = elements.get("free_point")
    radii = None if free is None else _optional(free, "radius")
    return {
        "points": points,
        "normals": normals,
        "forces": _optional(rows, "force"),
        "fingers": fingers,
        "times": _optional(rows, "time"),
        "free_points": np.empty((0, 3)) if free is None else _ply_columns(path, free, _POINT),
        "free_radii": radii if radii is not None else np.empty(0),
    }


def _ply_columns(path: Path, rows: npt.NDArray[Any], names: Sequence[str]) -> FloatArray:
    _require_columns(path, rows.dtype.names or (), names)
    columns = [rows[name] for name in names]
    if any(column.dtype == object for column in columns):
        raise InvalidFileError(f"{path} has lists where {', '.join(names)} must be numbers")
    return np.column_stack([column.astype(np.float64) for column in columns])


def _optional(rows: npt.NDArray[Any], name: str) -> FloatArray | None:
    for prefix in _PREFIXES:
        if prefix + name in (rows.dtype.names or ()) and rows[prefix + name].dtype != object:
            return np.asarray(rows[prefix + name], dtype=np.float64)
    return None


def _finger_names(path: Path, comments: list[str], index: FloatArray) -> tuple[str, ...]:
    """Return each contact's finger by name, or by number where the file has no names."""
    whole = index.astype(np.int64)
    if np.any(whole != index):
        raise InvalidFileError(f"{path} has a property 'finger' that is no whole number")
    listed = [c[len(_FINGERS) :] for c in comments if c.startswith(_FINGERS)]
    if not listed:
        return tuple(str(i) for i in whole)
    try:
        names = [str(name) for name in json.loads(listed[-1])]
    except (ValueError, TypeError, RecursionError):
        raise InvalidFileError(f"{path} has a comment 'fingers' that is no list of names") from None
    if len(whole) and not (whole.min() >= 0 and whole.max() < len(names)):
        raise InvalidFileError(f"{path} has a finger {whole.max()}, but names {len(names)} fingers")
    return tuple(names[i] for i in whole)


def _csv_bytes(contacts: Contacts) -> bytes:
    forces, times, fingers = contacts.forces, contacts.times, contacts.fingers
    names = [*_POINT, *_NORMAL]
    names += [n for n, v in (("force", forces), ("time", times)) if v is not None]
    names += ["finger"] if fingers else []
    names += ["kind", "radius"] if len(contacts.free_points) else []
    text = io.StringIO()
    writer = csv.DictWriter(text, names, restval="", lineterminator="\n")
    writer.writeheader()
    for i in range(len(contacts)):
        numbers = [*contacts.points[i].tolist(), *contacts.normals[i].tolist()]
        row: dict[str, Any] = dict(zip([*_POINT, *_NORMAL], numbers, strict=True))
        row |= {} if forces is None else {"force": float(forces[i])}
        row |= {} if times is None else {"time": float(times[i])}
        row |= {"finger": fingers[i]} if fingers else {}
        row |= {"kind": "contact"} if len(contacts.free_points) else {}
        writer.writerow(row)
    for point, radius in zip(contacts.free_points.tolist(), contacts.free_radii, strict=True):
        place = dict(zip(_POINT, point, strict=True))
        writer.writerow({**place, "kind": "free", "radius": float(radius)})
    return text.getvalue().encode("utf-8")


def _load_csv(path: Path) -> dict[str, Any]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidFileError(f"{path} is no UTF-8 text: save it as plain CSV") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise InvalidFileError(f"{path} is empty: a header row x,y,z,nx,ny,nz is needed")
    delimiter = ";" if ";" in lines[0] and "," not in lines[0] else ","
    try:
        table = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise InvalidFileError(f"{path} is no CSV ({error}): write it again") from None
    names = [name.strip().lower() for name in table[0]]
    _require_columns(path, names, [*_POINT, *_NORMAL])
    for number, row in enumerate(table[1:], start=1):
        if len(row) != len(names):
            raise InvalidFileError(
                f"{path}: row {number} has {len(row)} cells, its header has {len(names)}"
            )
    columns = {name: [row[i].strip() for row in table[1:]] for i, name in enumerate(names)}
    kinds = columns.get("kind", ["contact"] * (len(table) - 1))
    for number, kind in enumerate(kinds, start=1):
        if kind not in ("contact", "free"):
            raise InvalidFileError(f"{path}: row {number} is of kind '{kind}', not contact or free")
    touched = [i for i, kind in enumerate(kinds) if kind == "contact"]
    free = [i for i, kind in enumerate(kinds) if kind == "free"]

    def numbers(wanted: Sequence[str], rows: list[int]) -> FloatArray:
        cells = [[_number(path, columns[name][i], i + 1, name) for name in wanted] for i in rows]
        return np.array(cells, dtype=np.float64).reshape(len(rows), len(wanted))

    return {
        "points": numbers(_POINT, touched),
        "normals": numbers(_NORMAL, touched),
        "forces": numbers(["force"], touched)[:, 0] if "force" in columns else None,
        "fingers": tuple(columns["finger"][i] for i in touched) if "finger" in columns else (),
        "times": numbers(["time"], touched)[:, 0] if "time" in columns else None,
        "free_points": numbers(_POINT, free),
        "free_radii": numbers(["radius"], free)[:, 0] if "radius" in columns else np.empty(0),
    }


def _number(path: Path, cell: str, row: int, name: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise InvalidFileError(
            f"{path}: row {row} has '{cell}' for {name}, where a number is needed"
        ) from None


def _require_columns(path: Path, present: Sequence[str], wanted: Sequence[str]) -> None:
    missing = [name for name in wanted if name not in present]
    if missing:
        advice = (
            "; a contact needs the surface's outward normal: estimate normals first, for example"
            " with MeshLab"
            if set(missing) <= set(_NORMAL)
            else ""
        )
        raise InvalidFileError(f"{path} lacks {', '.join(missing)}{advice}")
