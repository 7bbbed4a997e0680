"""Limits of files, checked before their content is read into memory."""

from __future__ import annotations

from pathlib import Path

from lis_grasp.exceptions import InvalidFileError

MEBIBYTE = 2**20


def require_file_size(path: Path, most: int) -> None:
    """Raise `InvalidFileError` for a file of more than `most` bytes; OSError if it is missing."""
    size = path.stat().st_size
    if size > most:
        raise InvalidFileError(
            f"{path} must have at most {most // MEBIBYTE} MiB; it has {size / MEBIBYTE:.0f} MiB:"
            " write fewer points, triangles or rows",
            path=path,
        )
