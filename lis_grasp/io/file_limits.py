"""Limits of files, checked before their content is read into memory."""

from __future__ import annotations

import stat
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError

MEBIBYTE = 2**20


def require_file_size(path: Path, most: int) -> None:
    """Raise `InvalidFileError` for a device, or a file of more than `most` bytes.

    Raises OSError if the file is missing.
    """
    facts = path.stat()
    size = facts.st_size
    if not stat.S_ISREG(facts.st_mode):
        raise InvalidFileError(f"{path} must be a file; it is a folder or a device", path=path)
    if size > most:
        raise InvalidFileError(
            f"{path} must have at most {most // MEBIBYTE} MiB; it has {size / MEBIBYTE:.0f} MiB:"
            " write fewer points, triangles or rows",
            path=path,
        )
