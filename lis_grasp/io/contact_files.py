"""Contact files: PLY, an oriented point cloud for any point-cloud program, and CSV; points.

PLY as written: ASCII. Element ``vertex`` has x y z nx ny nz and, where known, force, time,
position_noise, normal_noise (NaN for a contact whose noise is unknown) and finger (an index into
the names in a ``fingers`` comment). Element ``free_point`` has x y z and the radius that is free
round it. CSV as written: a header row ``x,y,z,nx,ny,nz``, then force, time, position_noise,
normal_noise (empty where unknown) and finger where known, and ``kind`` (contact or free) and
``radius`` if there are free points. Both formats restore every number exactly, and equal contacts
make equal bytes. As read: any order and precision of properties, text or binary; other properties
are noted. Other programs' names are known, too (`_point_columns`). Points without normals may have
the direction of approach, ax ay az, instead. PCD, NPY, NPZ, OFF and texts of numbers are read too.
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

from lis_grasp.exceptions import InvalidFileError, shown
from lis_grasp.io._mesh_text import off_rows
from lis_grasp.io._ply import ply_bytes, ply_element, read_ply
from lis_grasp.io._point_columns import (
    NOISE,
    NORMAL,
    POINT,
    contact_fields,
    known_columns,
    stated_unit,
    table,
)
from lis_grasp.io._point_readers import columns_of, positional, read_npy, read_npz, read_rows
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.content_kinds import named_by_content
from lis_grasp.io.csv_tables import cell_number, read_table, text_of, uncommented
from lis_grasp.io.limits import reading
from lis_grasp.io.pcd_files import read_pcd
from lis_grasp.io.units import require_resolved
from lis_grasp.typing import FloatArray

_FINGERS = "fingers "
_TEXTS = (".xyz", ".xyzn", ".pts", ".txt")  # numbers without names
_MESHES = (".obj", ".stl", ".gltf", ".glb", ".3mf", ".dae")  # not points
_SCANS = (".las", ".laz", ".e57")
POINT_FORMATS = (".ply", ".csv", ".pcd", ".npy", ".npz", ".off", *_TEXTS)
"""Endings of the files of points that can be read."""

_LINE_END = re.compile(r"[\r\n]")


def read_contact_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` in a file of points; for errors see `Contacts.load`."""
    fields = read_point_file(path)
    del fields["approach"]
    if fields["normals"] is None:
        raise InvalidFileError.of(
            path,
            f"lacks {', '.join(NORMAL)}; a contact needs an outward normal: load the file with"
            " surfaces.load_contacts, which estimates them",
        )
    return fields


def read_point_file(path: Path) -> dict[str, Any]:
    """Return the fields of `Contacts` in a file that may lack normals, and `approach`.

    `normals` and `approach`, the direction of motion at contact, are of shape (N, 3), or None where
    the file lacks them. `units` is the unit that names of columns state, or None. Omissions are
    noted.

    Raises `InvalidFileError` if the file is missing, of another format, damaged, or lacks points.
    """
    with named_by_content(path):
        fields = _read_fields(path)
    require_resolved(path, fields["points"])
    return fields


def point_fields(name: Path, array: npt.NDArray[Any]) -> dict[str, Any]:
    """Return the fields of an array in memory as `read_point_file` does; errors use its `name`."""
    fields = _of_columns(name, columns_of(name, array))
    require_resolved(name, fields["points"])
    return fields


def _read_fields(path: Path) -> dict[str, Any]:
    match path.suffix.lower():
        case ".ply":
            return _load_ply(path)
        case ".csv":
            return _load_csv(path)
        case ending if ending not in POINT_FORMATS:
            advice = "write points as columns x,y,z of a .csv"
            if ending in _MESHES:
                advice += f"; if it is a mesh, `lis-grasp grasp {path}` plans on it"
            elif ending in _SCANS:
                advice = "save it as .ply by CloudCompare"
            elif (beside := path.with_name("contacts.ply")).is_file():
                advice = f"name {beside}"
            raise InvalidFileError(
                f"files of points end in one of {', '.join(POINT_FORMATS)}; {path} does not:"
                f" {advice}",
                path=path,
            )
        case ending if ending in _TEXTS and _has_names(path):
            return _load_csv(path)
        case ending:
            with reading(path, f"{ending[1:].upper()}", advice="write columns x,y,z as .csv"):
                fields = _of_columns(path, _READERS.get(ending, read_rows)(path))
                if not len(fields["points"]):
                    raise InvalidFileError(f"{path} has no points", path=path)
                return fields


def write_contact_file(contacts: Mapping[str, Any], path: Path, *, header: str = "") -> None:
    """Write the fields of `Contacts`; for arguments and errors see `Contacts.save`."""
    ending = path.suffix.lower()
    if ending not in (".ply", ".csv"):
        raise InvalidFileError(f"contact files end in .ply or .csv; {path} does not", path=path)
    write_bytes(path, _to_ply(contacts, header) if ending == ".ply" else _to_csv(contacts))


def contact_columns(contacts: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a file of contacts by name, without fingers and free points."""
    columns = dict(zip(POINT, contacts["points"].T, strict=True))
    columns |= dict(zip(NORMAL, contacts["normals"].T, strict=True))
    columns |= {} if contacts["forces"] is None else {"force": contacts["forces"]}
    columns |= {} if contacts["times"] is None else {"time": contacts["times"]}
    return columns | {name: contacts[name] for name in NOISE if contacts[name] is not None}


def _to_ply(contacts: Mapping[str, Any], header: str) -> bytes:
    columns = contact_columns(contacts)
    if contacts["fingers"]:
        names = sorted(set(contacts["fingers"]))
        columns["finger"] = np.array([names.index(f) for f in contacts["fingers"]], dtype=np.int32)
        header += "\n" + _FINGERS + json.dumps(names)
    elements = [ply_element("vertex", columns)]
    if len(contacts["free_points"]):
        free = dict(zip(POINT, contacts["free_points"].T, strict=True))
        elements.append(ply_element("free_point", free | {"radius": contacts["free_radii"]}))
    return ply_bytes(elements, header, text=True)


def _load_ply(path: Path) -> dict[str, Any]:
    data = read_ply(path)
    elements = {element.name: element.data for element in data.elements}
    if "vertex" not in elements:
        raise InvalidFileError(f"{path} has no element 'vertex', so no points", path=path)
    _require_no_faces(path, len(elements.get("face", ())))
    free = _numbers(path, _by_name(elements["free_point"]))[0] if "free_point" in elements else {}
    return {
        **_of_columns(path, _by_name(elements["vertex"]), data.comments),
        "free_points": table(path, free, POINT) if free else np.empty((0, 3)),
        "free_radii": free.get("radius", np.empty(0)),
    }


def _by_name(rows: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    return {name: rows[name] for name in rows.dtype.names or ()}


def _numbers(
    path: Path, columns: Mapping[str, npt.NDArray[Any]]
) -> tuple[dict[str, FloatArray], str | None]:
    """Return the known columns as numbers, and the unit that their names state."""
    known = known_columns(path, columns)
    lists = [name for name, column in known.items() if columns[column.name].dtype == object]
    if lists:
        raise InvalidFileError.of(path, f"has lists where {', '.join(lists)} must be numbers")
    numbers = {n: c.factor * columns[c.name].astype(np.float64) for n, c in known.items()}
    lengths = {len(column) for column in numbers.values()}
    if len(lengths) > 1:
        raise InvalidFileError.of(
            path, f"has columns of {' and '.join(map(str, sorted(lengths)))} rows"
        )
    return numbers, stated_unit(path, known)


def _of_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], comments: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the fields that columns mean by their names in a file."""
    numbers, unit = _numbers(path, columns)
    index = numbers.pop("finger", None)
    fingers = () if index is None else _finger_names(path, comments, index)
    return contact_fields(path, numbers, fingers) | {"units": unit}


def _has_names(path: Path) -> bool:
    """Return whether a text begins with a row or a comment that names all of its columns."""
    with reading(path, "text"):
        comments, lines = uncommented(text_of(path, ascii_only=True))
    heads = [
        re.split(r"[\s,;]+", head.strip("#/ \t").lower()) for head in (*lines[:1], *comments[-1:])
    ]
    width = len(heads[0]) if heads else 0
    return any(set("xyz") <= set(head) and len(head) == width for head in heads)


def _vertices_of_off(path: Path) -> dict[str, npt.NDArray[Any]]:
    vertices, faces = off_rows(path)
    _require_no_faces(path, len(faces))
    return positional(path, vertices)


def _require_no_faces(path: Path, faces: int) -> None:
    if faces:
        raise InvalidFileError.of(
            path,
            f"is a surface of {faces} faces: `lis-grasp grasp {path}` plans on it; contacts are"
            " points alone",
        )


_READERS = {".pcd": read_pcd, ".npy": read_npy, ".npz": read_npz, ".off": _vertices_of_off}


def _finger_names(path: Path, comments: Sequence[str], index: FloatArray) -> tuple[str, ...]:
    """Return each contact's finger by name, or by number if the file has no names."""
    whole = index.astype(np.int64)
    if np.any(whole != index):
        raise InvalidFileError.of(path, "must have whole numbers as 'finger'; some are not")
    listed = [c[len(_FINGERS) :] for c in comments if c.startswith(_FINGERS)]
    if not listed:
        return tuple(str(i) for i in whole)
    try:
        names = [str(name) for name in json.loads(listed[-1])]
    except (ValueError, TypeError, RecursionError):
        raise InvalidFileError.of(path, "must have a JSON list of names as 'fingers'") from None
    if len(whole) and not (whole.min() >= 0 and whole.max() < len(names)):
        raise InvalidFileError.of(
            path, f"has a finger {whole.max()}, but names {len(names)} fingers"
        )
    return tuple(names[i] for i in whole)


def _to_csv(contacts: Mapping[str, Any]) -> bytes:
    for name in contacts["fingers"]:
        if name != name.strip() or _LINE_END.search(name):
            raise InvalidFileError(
                "names of fingers in a CSV must be one line without spaces around it; one is"
                f" {shown(name)}: write a .ply"
            )
    columns = {name: column.tolist() for name, column in contact_columns(contacts).items()}
    for name in set(NOISE) & set(columns):
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
        place = dict(zip(POINT, point, strict=True))
        writer.writerow(place | {"kind": "free", "radius": radius})
    return text.getvalue().encode("utf-8")


def _load_csv(path: Path) -> dict[str, Any]:
    names, rows = read_table(path)
    known = known_columns(path, names)
    cells = {name: [row[names.index(c.name)] for row in rows] for name, c in known.items()}
    kinds = cells.get("kind", ["contact"] * len(rows))
    for count, kind in enumerate(kinds, start=1):
        if kind not in ("contact", "free"):
            raise InvalidFileError.of(
                path, f"has the kind '{kind}' in row {count}, not contact or free"
            )

    def numbers(kind: str, but: Sequence[str]) -> dict[str, FloatArray]:
        wanted = [row for row, own in enumerate(kinds) if own == kind]
        return {
            name: known[name].factor
            * np.array([cell_number(path, column[row], row + 1, name) for row in wanted])
            for name, column in cells.items()
            if name not in ("kind", "finger", *but)
        }

    fingers = [
        f for f, kind in zip(cells.get("finger", ()), kinds, strict=False) if kind == "contact"
    ]
    free = numbers("free", (*NORMAL, "ax", "ay", "az", "force", "time", *NOISE))
    return {
        **contact_fields(path, numbers("contact", ("radius",) if "kind" in cells else ()), fingers),
        "free_points": table(path, free, POINT),
        "free_radii": free.get("radius", np.empty(0)),
        "units": stated_unit(path, known),
    }
