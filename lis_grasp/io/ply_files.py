"""PLY files: reading, writing, and one error for everything that plyfile refuses."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from plyfile import PlyData, PlyElement, PlyParseError

from lis_grasp.exceptions import InvalidFileError


def read_ply(path: Path) -> PlyData:
    """Read a PLY file, text or binary; `InvalidFileError` if it is missing, damaged or no PLY."""
    try:
        return PlyData.read(str(path), mmap=False)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except (PlyParseError, ValueError, OverflowError, EOFError, MemoryError) as error:
        message = f"{path} cannot be read as PLY ({error}): write it again"
        raise InvalidFileError(message, path=path) from None


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
    file = io.BytesIO()
    PlyData(elements, text=text, byte_order="=" if text else "<", comments=comments).write(file)
    return file.getvalue()
