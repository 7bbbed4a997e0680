"""CSV tables with a header row: columns of numbers by name."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.limits import ReadError, reading
from lis_grasp.typing import FloatArray

_LINE_END = re.compile("\r\n|\r|\n")
_COMMENT = re.compile(r"\s*(#|//)")
SECONDS: Mapping[str, float] = MappingProxyType({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9})
"""Units of time that names of columns state, in seconds."""

ANGLES: Mapping[str, float] = MappingProxyType({"rad": 1.0, "deg": math.pi / 180.0})
"""Units of angles that names of columns state, in radians."""

NEWTONS: Mapping[str, float] = MappingProxyType(
    {"n": 1.0, "mn": 1e-3, "kn": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605}
)
"""Units of force that names of columns state, in small letters, in newtons."""

# x [mm], x (mm), time_ns
_UNIT = re.compile(r"(.+?)(?:\s*[\[(]\s*([a-z]+)\s*[\])]|_(m|mm|cm|inch|s|ms|us|ns|n|rad|deg))")
_DATE = re.compile(r"\d[-./]\d\d[-./]\d|\d:\d\d")
DECIMAL_COMMA = re.compile(r"[-+]?[\d.]*,\d+(e[-+]?\d+)?", re.IGNORECASE)
"""A number with a decimal comma."""


def without_unit(name: str) -> tuple[str, str]:
    """Return a column's name in lower case, and the unit that it states: x and mm of "x [mm]"."""
    text = name.strip(" \t\"'#/").lower()
    found = _UNIT.fullmatch(text)
    return (found[1], found[2] or found[3]) if found else (text, "")


def factor_of(path: Path, title: str, unit: str, units: Mapping[str, float]) -> float:
    """Return a column's unit in SI units, 1 if it states none.

    Raises `InvalidFileError` if it is none of `units`.
    """
    if unit and unit not in units:
        raise InvalidFileError(
            f"the unit of the column {title} of {path} must be one of {', '.join(units)}; it is"
            f" {unit}: convert the column",
            path=path,
        )
    return units.get(unit, 1.0)


def column_numbers(path: Path, rows: Sequence[Sequence[str]], column: int, name: str) -> FloatArray:
    """Return a column of a table as numbers, NaN where it is blank."""
    return np.array([cell_number(path, row[column], n + 1, name) for n, row in enumerate(rows)])


def numeric_column(rows: Sequence[Sequence[str]], column: int) -> FloatArray | None:
    """Return a column of a table as numbers, NaN where it is blank; None if it has other texts."""
    try:
        return np.array([float(row[column] or "nan") for row in rows])
    except ValueError:
        return None


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the column names, in lower case, and the rows of cells, one cell for each name.

    Cells are separated by commas, semicolons, tabs or blanks. The header may be a comment, as
    NumPy's ``savetxt`` writes it.
    """
    with reading(path, "CSV"):
        comments, lines = uncommented(text_of(path))
        if not lines:
            raise ReadError(
                "it is empty", "write a header row of column names, and rows of numbers"
            )
        first = _cells(lines[:1], lines[0])[0]
        if all(map(_is_number, first)) and comments:
            head = _COMMENT.sub("", comments[-1], count=1).strip()
            lines = [head, *lines] if len(_cells([head], head)[0]) == len(first) else lines
        header = _cells(lines[:1], lines[0])[0]
        rows = _cells(lines[1:], lines[0])
    if all(map(_is_number, header)):
        raise InvalidFileError(
            f"{path} must begin with a row that names its columns, such as x,y,z; it"
            f" begins with numbers: {lines[0][:60]}",
            path=path,
        )
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            decimal = len(row) == 2 * len(header) and "," in lines[number]
            words = re.split(r"[;\s]+", lines[number].strip())
            decimal |= len(words) == len(header) and any(map(DECIMAL_COMMA.fullmatch, words))
            raise InvalidFileError(
                f"{path}: row {number} has {len(row)} cells, its header has {len(header)}:"
                f" {'write a decimal point, not a comma' if decimal else 'give every row as many'}",
                path=path,
            )
    return [name.strip().lower() for name in header], [[cell.strip() for cell in r] for r in rows]


def text_of(path: Path, *, ascii_only: bool = False) -> str:
    """Return the text of a file; `InvalidFileError` if it is not UTF-8, but for comments.

    With `ascii_only` other characters, which are not used, may have any encoding.
    """
    content = path.read_bytes()
    text = content.decode("utf-8-sig", "replace")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        kind = "UTF-16 text"
    elif "\0" in text:
        kind = "binary"
    elif not ascii_only and "\ufffd" in "".join(uncommented(text)[1]):
        kind = "not UTF-8 text"
    else:
        return text
    raise InvalidFileError(f"{path} must be UTF-8 text; it is {kind}: save it as UTF-8", path=path)


def uncommented(text: str) -> tuple[list[str], list[str]]:
    """Return the comments before the first other line, and the lines that are no comments."""
    # Do not use splitlines: it also ends lines at characters that a finger's name may have.
    lines = [line for line in _LINE_END.split(text) if line.strip()]
    are_comments = [bool(_COMMENT.match(line)) for line in lines]
    first = are_comments.index(False) if False in are_comments else len(lines)
    kept = [line for line, comment in zip(lines, are_comments, strict=True) if not comment]
    return lines[:first], kept


def cell_number(path: Path, cell: str, row: int, name: str) -> float:
    """Return the number in a cell of a column, NaN if it is blank; rows count from 1."""
    try:
        return float(cell or "nan")
    except ValueError:
        message = f"{path}: row {row} has '{cell}' for {name}, where a number is needed"
        if DECIMAL_COMMA.fullmatch(cell):
            message += " (this is a decimal comma): write numbers with a decimal point"
        elif _DATE.search(cell):
            message += " (this is a date or a time of day): write seconds"
        raise InvalidFileError(message, path=path) from None


def _cells(lines: list[str], header: str) -> list[list[str]]:
    """Return the cells of lines, separated as in the header or else in the first line."""
    if not lines:
        return []
    marks = [m for m in (",", ";", "\t") if m in header and m in lines[0]]
    marks += [m for m in (";", "\t", ",") if m in lines[0]]
    if not marks:
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=marks[0], skipinitialspace=True))


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().replace(",", ".", 1))
    except ValueError:
        return False
    return True
