"""Contact files: PLY, an oriented point cloud for any point-cloud program, and CSV; points.

PLY as written: ASCII. Element ``vertex`` has x y z nx ny nz and, where known, force, time,
position_noise, normal_noise (NaN for a contact whose noise is unknown) and finger (an index into
the names in a ``fingers`` comment). Element ``free_point`` has x y z and the radius that is free
round it. CSV as written: a header row ``x,y,z,nx,ny,nz``, then force, time, position_noise,
normal_noise (empty where unknown) and finger where known, and ``kind`` (contact or free) and
``radius`` if there are free points. Both formats restore every number exactly, and equal contacts
make equal bytes. As read: any order and precision of properties, text or binary; other properties
are ignored. Points without normals may have the direction of approach, ax ay az, instead. .off and
.xyz files have points only.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.exceptions import InvalidFileError, shown
from lis_grasp.io._ply import ply_bytes, ply_element, read_ply
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.csv_tables import cell_number, read_table
from lis_grasp.io.limits import reading
from lis_grasp.typing import FloatArray

_POINT = ("x", "y", "z")
_NORMAL = ("nx", "ny", "nz")
_APPROACH = ("ax", "ay", "az")
_DIRECTIONS = {"normals": _NORMAL, "approach": _APPROACH}
_NOISE = ("position_noise", "normal_noise")
_FINGERS = "fingers "
_POINTS_ONLY = (".off", ".xyz")
POINT_FORMATS = (".ply", ".csv", *_POINTS_ONLY)
"""Endings of the files of points that can be read."""

_LINE_END = re.compile(r"[\r\n]")
# CloudCompare puts this before the names of properties that it does not know.
_PREFIXES = ("", "scalar_")


def read_contact_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` in a .ply or .csv file; errors as of `Contacts.load`."""
    fields = _read_fields(path)
    del fields["approach"]
    if fields["normals"] is None:
        message = (
            f"{path} lacks {', '.join(_NORMAL)}; a contact needs an outward normal: load the file"
            " with surfaces.load_contacts, which estimates them"
        )
        raise InvalidFileError(message, path=path)
    return fields


def read_point_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` in a file that may lack normals, and `approach`.

    `normals` and `approach`, the direction of motion at contact, are of shape (N, 3), or None where
    the file lacks them. .ply and .csv files are read as those of contacts; .off and .xyz files have
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
    return _read_fields(path)


def write_contact_file(contacts: Mapping[str, Any], path: Path, *, header: str = "") -> None:
    """Write the fields of `Contacts`; arguments and errors as of `Contacts.save`."""
    content = _to_ply(contacts, header) if _is_ply(path) else _to_csv(contacts)
    write_bytes(path, content)


def _read_fields(path: Path) -> dict[str, Any]:
    return _load_ply(path) if _is_ply(path) else _load_csv(path)


def _is_ply(path: Path) -> bool:
    ending = path.suffix.lower()
    if ending not in (".ply", ".csv"):
        raise InvalidFileError(f"contact files end in .ply or .csv; {path} does not", path=path)
    return ending == ".ply"


def _columns(contacts: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    columns = dict(zip(_POINT, contacts["points"].T, strict=True))
    columns |= dict(zip(_NORMAL, contacts["normals"].T, strict=True))
    columns |= {} if contacts["forces"] is None else {"force": contacts["forces"]}
    columns |= {} if contacts["times"] is None else {"time": contacts["times"]}
    return columns | {name: contacts[name] for name in _NOISE if contacts[name] is not None}


def _to_ply(contacts: Mapping[str, Any], header: str) -> bytes:
    columns = _columns(contacts)
    if contacts["fingers"]:
        names = sorted(set(contacts["fingers"]))
        columns["finger"] = np.array([names.index(f) for f in contacts["fingers"]], dtype=np.int32)
        header += "\n" + _FINGERS + json.dumps(names)
    elements = [ply_element("vertex", columns)]
    if len(contacts["free_points"]):
        free = dict(zip(_POINT, contacts["free_points"].T, strict=True))
        elements.append(ply_element("free_point", free | {"radius": contacts["free_radii"]}))
    return ply_bytes(elements, header, text=True)


def _load_ply(path: Path) -> dict[str, Any]:
    data = read_ply(path)
    elements = {element.name: element.data for element in data.elements}
    if "vertex" not in elements:
        raise InvalidFileError(f"{path} has no element 'vertex', so no points", path=path)
    rows, free = elements["vertex"], elements.get("free_point")
    index = _optional(rows, "finger")
    radii = None if free is None else _optional(free, "radius")
    return {
        "points": _table(path, rows, _POINT),
        **{
            field: _table(path, rows, names) if _present(path, rows.dtype.names, names) else None
            for field, names in _DIRECTIONS.items()
        },
        "forces": _optional(rows, "force"),
        "fingers": () if index is None else _finger_names(path, data.comments, index),
        "times": _optional(rows, "time"),
        "free_points": np.empty((0, 3)) if free is None else _table(path, free, _POINT),
        "free_radii": np.empty(0) if radii is None else radii,
        **{name: _optional(rows, name) for name in _NOISE},
    }


def _table(path: Path, rows: npt.NDArray[Any], names: Sequence[str]) -> FloatArray:
    _require_columns(path, rows.dtype.names or (), names)
    columns = [rows[name] for name in names]
    if any(column.dtype == object for column in columns):
        message = f"{path} has lists where {', '.join(names)} must be numbers"
        raise InvalidFileError(message, path=path)
    return np.column_stack([column.astype(np.float64) for column in columns])


def _optional(rows: npt.NDArray[Any], name: str) -> FloatArray | None:
    for prefix in _PREFIXES:
        if prefix + name in (rows.dtype.names or ()) and rows[prefix + name].dtype != object:
            return np.asarray(rows[prefix + name], dtype=np.float64)
    return None


def _finger_names(path: Path, comments: list[str], index: FloatArray) -> tuple[str, ...]:
    """Return each contact's finger by name, or by number if the file has no names."""
    whole = index.astype(np.int64)
    if np.any(whole != index):
        message = f"{path}: property 'finger' must be whole numbers; some are not"
        raise InvalidFileError(message, path=path)
    listed = [c[len(_FINGERS) :] for c in comments if c.startswith(_FINGERS)]
    if not listed:
        return tuple(str(i) for i in whole)
    try:
        names = [str(name) for name in json.loads(listed[-1])]
    except (ValueError, TypeError, RecursionError):
        message = f"{path}: the comment 'fingers' must be a JSON list of names; it is not"
        raise InvalidFileError(message, path=path) from None
    if len(whole) and not (whole.min() >= 0 and whole.max() < len(names)):
        message = f"{path} has a finger {whole.max()}, but names {len(names)} fingers"
        raise InvalidFileError(message, path=path)
    return tuple(names[i] for i in whole)


def _to_csv(contacts: Mapping[str, Any]) -> bytes:
    for name in contacts["fingers"]:
        if name != name.strip() or _LINE_END.search(name):
            raise InvalidFileError(
                "names of fingers in a CSV must be one line without spaces around it; one is"
                f" {shown(name)}: write a .ply"
            )
    columns = {name: column.tolist() for name, column in _columns(contacts).items()}
    for name in set(_NOISE) & set(columns):
        columns[name] = ["" if np.isnan(noise) else noise for noise in columns[name]]
    columns |= {"finger": list(contacts["fingers"])} if contacts["fingers"] else {}
    names = [*columns, *(("kind", "radius") if len(contacts["free_points"]) else ())]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in zip(*columns.values(), strict=True):
        writer.writerow(dict(zip(columns, row, strict=True)) | {"kind": "contact"})
    free = zip(contacts["free_points"].tolist(), contacts["free_radii"].tolist(), strict=True)
    for point, radius in free:
        place = dict(zip(_POINT, point, strict=True))
        writer.writerow(place | {"kind": "free", "radius": radius})
    return text.getvalue().encode("utf-8")


def _load_csv(path: Path) -> dict[str, Any]:
    names, rows = read_table(path)
    _require_columns(path, names, _POINT)
    columns = {name: [row[i].strip() for row in rows] for i, name in enumerate(names)}
    kinds = columns.get("kind", ["contact"] * len(rows))
    for count, kind in enumerate(kinds, start=1):
        if kind not in ("contact", "free"):
            message = f"{path}: row {count} is of kind '{kind}', not contact or free"
            raise InvalidFileError(message, path=path)
    touched = [i for i, kind in enumerate(kinds) if kind == "contact"]
    free = [i for i, kind in enumerate(kinds) if kind == "free"]

    def number(name: str, row: int) -> float:
        cell = columns[name][row]
        return np.nan if not cell and name in _NOISE else cell_number(path, cell, row + 1, name)

    def numbers(wanted: Sequence[str], rows: list[int]) -> FloatArray:
        cells = [[number(name, row) for name in wanted] for row in rows]
        return np.array(cells, dtype=np.float64).reshape(len(rows), len(wanted))

    return {
        "points": numbers(_POINT, touched),
        **{
            field: numbers(wanted, touched) if _present(path, names, wanted) else None
            for field, wanted in _DIRECTIONS.items()
        },
        "forces": numbers(["force"], touched)[:, 0] if "force" in columns else None,
        "fingers": tuple(columns["finger"][i] for i in touched) if "finger" in columns else (),
        "times": numbers(["time"], touched)[:, 0] if "time" in columns else None,
        "free_points": numbers(_POINT, free),
        "free_radii": numbers(["radius"], free)[:, 0] if "radius" in columns else np.empty(0),
        **{name: numbers([name], touched)[:, 0] for name in _NOISE if name in columns},
    }


def _present(path: Path, names: Sequence[str] | None, wanted: Sequence[str]) -> bool:
    """Return whether all wanted columns are there; refuse some of them without the others."""
    if set(wanted) & set(names or ()):
        _require_columns(path, names or (), wanted)
        return True
    return False


def _require_columns(path: Path, present: Sequence[str], wanted: Sequence[str]) -> None:
    missing = [name for name in wanted if name not in present]
    if missing:
        raise InvalidFileError(
            f"{path} lacks {', '.join(missing)}: it must name its columns, such as x,y,z,nx,ny,nz"
            " in the first row of a CSV file",
            path=path,
        )


def _load_points(path: Path) -> FloatArray:
    """Return the points of an .off or .xyz file, in the file's order."""
    with reading(path, "points", advice="write columns x,y,z as .csv"):
        rows = _vertices_of_off(path) if path.suffix.lower() == ".off" else _rows_of_xyz(path)
    points = np.asarray(rows, dtype=np.float64)
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
