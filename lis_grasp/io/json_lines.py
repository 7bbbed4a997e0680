"""Files that only ever grow: a header, then one JSON object a line, on the disk line by line."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError

Row = dict[str, Any]


def read_lines(path: Path) -> tuple[Row, list[Row]]:
    """Return a file's header and its rows; both empty where there is no file yet.

    A last line that an interruption has torn does not count; `append_lines` removes it.

    Raises
    ------
    InvalidFileError
        If the file cannot be read, or is no such file.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return {}, []
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidFileError(f"cannot read {path}: {error}") from None
    try:
        rows = [json.loads(line) for line in lines if line.endswith("\n")]
    except (ValueError, RecursionError) as error:
        raise InvalidFileError(f"{path} must hold one JSON object a line: {error}") from None
    if not all(isinstance(row, dict) for row in rows):
        raise InvalidFileError(f"{path} must hold one JSON object a line; it holds something else")
    return (rows[0], rows[1:]) if rows else ({}, [])


def append_lines(path: Path, header: Row, rows: Sequence[Row]) -> None:
    """Add rows at the end, after the header in a file that is new; on the disk when this returns.

    Raises
    ------
    InvalidFileError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            file.seek(0)
            end = file.read().rfind(b"\n") + 1
            file.truncate(end)  # drops a torn line
            lines = [*([] if end else [header]), *rows]
            file.write(b"".join(json.dumps(x, allow_nan=False).encode() + b"\n" for x in lines))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise InvalidFileError(f"cannot write {path}: {error.strerror}") from None
