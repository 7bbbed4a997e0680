"""PLY files: reading, writing, and one error for everything that plyfile refuses."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import plyfile
from plyfile import PlyData, PlyElement

from lis_grasp.io.limits import MOST_BYTES, ReadError, announced_rows, reading

# Lists are read at once if all have this length; else row by row, which is slow.
_TRIANGLES = {"face": {"vertex_indices": 3, "vertex_index": 3}}
_TEXT, _COUNT = b"ply\nformat ascii", re.compile(rb"^(element .*) (\d+)$", re.MULTILINE)


def read_ply(path: Path) -> PlyData:
    """Read a PLY file, text or binary.

    Raises `InvalidFileError` if the file is missing, damaged or no PLY, has more than 512 MiB, or
    announces more rows than it has bytes.
    """
    with reading(path, "PLY", most=MOST_BYTES):
        announced_rows(path)
        with suppress(plyfile.PlyParseError, ValueError, OverflowError, Warning):
            return _read_columns(path)
        with suppress(plyfile.PlyParseError, ValueError, OverflowError):
            return PlyData.read(str(path), known_list_len=_TRIANGLES)
        try:
            return PlyData.read(str(path), mmap=False)
        except plyfile.PlyElementParseError as error:
            name = error.element.name
            where = "" if error.row is None else f"row {error.row + 1} of "
            raise ReadError(
                f"{where}its {error.element.count} rows of {name} is not as its header says, or the"
                " file ends there"
            ) from None
        except plyfile.PlyHeaderParseError as error:
            raise ReadError(f"line {error.line} of its header is no PLY") from None


def polygons_of(data: PlyData) -> npt.NDArray[Any]:
    """Return the vertex numbers of faces (F, K), by either name that programs give them.

    If their numbers of corners differ, they are objects (F,).
    """
    faces = next((e.data for e in data.elements if e.name == "face" and len(e.data)), None)
    names = [] if faces is None else [n for n in _TRIANGLES["face"] if n in faces.dtype.names]
    return np.empty((0, 3), np.int64) if faces is None or not names else faces[names[0]]


def _read_columns(path: Path) -> PlyData:
    """Read a text without lists at once; raise ValueError or a warning for every other file."""
    with path.open("rb") as file:
        if file.read(len(_TEXT)) != _TEXT:
            raise ValueError
        head, end, body = file.read().partition(b"\nend_header\n")
    data = PlyData.read(io.BytesIO(_COUNT.sub(rb"\1 0", _TEXT + head) + end))
    lines = io.StringIO(body.decode("ascii"), newline=None)
    for element, (_, digits) in zip(data.elements, _COUNT.findall(head), strict=True):
        count = int(digits)
        dtype = np.dtype(element.dtype())
        rows = [line for line in islice(lines, count) if line.strip()]
        if dtype.hasobject or len(rows) < count:
            raise ValueError
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            element.data = np.loadtxt(rows, dtype, comments=None, ndmin=1)
    return data


def ply_element(name: str, columns: Mapping[str, npt.NDArray[Any]]) -> PlyElement:
    """Return an element with a property for each column; columns have equal lengths."""
    count = len(next(iter(columns.values())))
    rows = np.empty(count, dtype=[(key, c.dtype.str, c.shape[1:]) for key, c in columns.items()])
    for key, column in columns.items():
        rows[key] = column
    return PlyElement.describe(rows, name)


def ply_bytes(elements: Sequence[PlyElement], header: str, *, text: bool) -> bytes:
    """Return the bytes of a PLY file, text or little endian; header lines become comments."""
    lines = [line.rstrip() for line in header.splitlines() if line.strip()]
    comments = [line.encode("ascii", "backslashreplace").decode() for line in lines]
    data = PlyData(elements, text=text, byte_order="=" if text else "<", comments=comments)
    # plyfile writes row by row; here all lists of a column have one length, and text has no lists.
    written = map(_as_text if text else _packed, elements)
    return data.header.encode("ascii") + b"\n" + b"".join(written)


def _as_text(element: PlyElement) -> bytes:
    """Return the rows of an element without lists as text, the numbers to 18 digits."""
    file = io.BytesIO()
    np.savetxt(file, element.data, "%.18g")
    return file.getvalue()


def _packed(element: PlyElement) -> bytes:
    """Return the rows of an element as little endian bytes, each list after its length."""
    fields: list[tuple[Any, ...]] = []
    for name in element.data.dtype.names:
        column = element.data.dtype[name]
        if column.shape:
            fields.append((f"length of {name}", "u1"))
        fields.append((name, column.base.newbyteorder("<"), column.shape))
    rows = np.empty(len(element.data), dtype=fields)
    for name, _, shape in (field for field in fields if len(field) == 3):
        rows[name] = element.data[name]
        if shape:
            rows[f"length of {name}"] = shape[0]
    return rows.tobytes()
