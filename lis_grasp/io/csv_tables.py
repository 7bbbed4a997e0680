"""CSV tables with a header row: columns of numbers by name."""

from __future__ import annotations

import csv
import re
from collections.abc import Container
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.limits import reading
from lis_grasp.typing import FloatArray

_LINE_END = re.compile("\r\n|\r|\n")


def read_csv_columns(path: Path, wanted: Container[str] | None = None) -> dict[str, FloatArray]:
    """Return the wanted columns (None: all) of a CSV table by name, in lower case: numbers.

    Raises
    ------
    InvalidFileError
        If the file is missing, empty, no CSV, or a cell is no number.
    """
    names, rows = read_table(path)
    return {
        name: np.array(
            [cell_number(path, row[i].strip(), n + 1, name) for n, row in enumerate(rows)]
        )
        for i, name in enumerate(names)
        if wanted is None or name in wanted
    }


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the column names and the rows of cells, one cell for each name."""
    with reading(path, "CSV"):
        text = path.read_bytes().decode("utf-8-sig")
        # Not splitlines, which also ends lines at characters that a finger's name may have.
        rows_of_text = _LINE_END.split(text)
        lines = [line for line in rows_of_text if line.strip() and not line.startswith("#")]
        if not lines:
            raise ValueError("it is empty; a header row of column names is needed")
        delimiter = ";" if ";" in lines[0] and "," not in lines[0] else ","
        header, *rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            message = f"{path}: row {number} has {len(row)} cells, its header has {len(header)}"
            raise InvalidFileError(message, path=path)
    return [name.strip().lower() for name in header], rows


def cell_number(path: Path, cell: str, row: int, name: str) -> float:
    """Return the number in a cell of a column, or refuse it; rows count from 1."""
    try:
        return float(cell)
    except ValueError:
        message = f"{path}: row {row} has '{cell}' for {name}, where a number is needed"
        raise InvalidFileError(message, path=path) from None
