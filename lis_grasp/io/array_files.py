"""Arrays of .npz files: reading within limits, with one error for everything that is damaged."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.file_limits import MEBIBYTE

_MOST_BYTES = 256 * MEBIBYTE
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_arrays(path: Path, names: Sequence[str]) -> list[npt.NDArray[Any]]:
    """Return the arrays of these names in an .npz file, without pickled objects.

    Raises
    ------
    InvalidFileError
        If the file is missing or damaged, lacks a name, or unpacks to more than 256 MiB.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = [archive.getinfo(f"{name}.npy") for name in names]
            if sum(member.file_size for member in members) > _MOST_BYTES:
                raise InvalidFileError(
                    f"{path} must unpack to at most {_MOST_BYTES // MEBIBYTE} MiB; it is larger",
                    path=path,
                )
            for member in members:
                with archive.open(member) as packed:
                    _require_announced_size(packed, member.file_size)
            return [np.load(archive.open(member), allow_pickle=False) for member in members]
    except InvalidFileError:
        raise
    except FileNotFoundError:
        raise InvalidFileError(f"cannot read {path}: no such file", path=path) from None
    except KeyError as error:
        raise InvalidFileError(f"{path} lacks an array: {error.args[0]}", path=path) from None
    # Damaged archives raise errors of zipfile, zlib, tokenize, struct and a dozen other types.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        message = f"{path} is not a valid .npz file: {reason}"
        raise InvalidFileError(message, path=path) from None


def _require_announced_size(packed: IO[bytes], size: int) -> None:
    """Raise ValueError for an array that announces more than its file of `size` bytes has."""
    version = np.lib.format.read_magic(packed)
    if version not in _HEADERS:
        raise ValueError(f"an array has the unknown format {version}")
    shape, _, dtype = _HEADERS[version](packed)
    if dtype.hasobject or math.prod(shape) * max(dtype.itemsize, 1) > size:
        raise ValueError("an array announces more than it has")
