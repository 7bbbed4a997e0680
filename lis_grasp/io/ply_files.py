"""PLY files as they come: what plyfile reads, and one error for what it does not."""

from __future__ import annotations

from pathlib import Path

from plyfile import PlyData, PlyParseError

from lis_grasp.exceptions import InvalidFileError


def read_ply(path: Path) -> PlyData:
    """Read a PLY file, text or binary.

    Raises
    ------
    InvalidFileError
        If it is missing, no PLY, cut off, or promises more than there is.
    """
    try:
        return PlyData.read(str(path), mmap=False)
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}") from None
    except (PlyParseError, ValueError, OverflowError, EOFError, MemoryError) as error:
        raise InvalidFileError(f"{path} cannot be read as PLY ({error}): write it again") from None
