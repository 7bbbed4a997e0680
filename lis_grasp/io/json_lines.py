"""JSON Lines files that only grow: a header, then one JSON object a line."""

from __future__ import annotations

import json
import mmap
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from lis_grasp.io.atomic_writing import cannot_write
from lis_grasp.io.limits import MEBIBYTE, ReadError, reading

Row = dict[str, Any]

_MOST_BYTES = 1024 * MEBIBYTE

MADE_AGAIN = "remove that line, or the file, and what it had is made again"
"""Advice for a damaged file whose rows a program can make again."""


def read_lines(path: Path, *, advice: str = "restore it from a copy") -> tuple[Row, list[Row]]:
    """Return a file's header and its rows; both empty if there is no file yet.

    `advice` ends the message for a damaged file, which may be a real robot's. A last line without a
    line end, left by an interruption, is ignored; `append_lines` removes it.
    Raises `InvalidFileError` if the file cannot be read, or a line is not a JSON object.
    """
    if not os.path.exists(path):
        return {}, []
    with reading(path, "one JSON object a line", most=_MOST_BYTES, advice=advice):
        lines = enumerate(path.read_text(encoding="utf-8").splitlines(keepends=True), start=1)
        rows = [_object(line, number) for number, line in lines if line.endswith("\n")]
    return (rows[0], rows[1:]) if rows else ({}, [])


def _object(line: str, number: int) -> Row:
    with suppress(ValueError, RecursionError):
        if isinstance(row := json.loads(line), dict):
            return row
    raise ReadError(f"line {number} is none")


def append_lines(path: Path, header: Row, rows: Sequence[Row]) -> None:
    """Append rows, after the header in a new file, and wait until they are on the disk.

    Raises `InvalidFileError` if the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            end = _end_of_last_line(file)
            file.truncate(end)  # removes an incomplete line
            lines = [*([] if end else [header]), *rows]
            file.write(b"".join(json.dumps(x, allow_nan=False).encode() + b"\n" for x in lines))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise cannot_write(path, error) from None


def _end_of_last_line(file: BinaryIO) -> int:
    """Return the offset after the last line end; 0 if there is none."""
    if not file.seek(0, os.SEEK_END):
        return 0  # an empty file cannot be mapped
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.rfind(b"\n") + 1
