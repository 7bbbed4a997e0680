"""NumPy archives (.npz): reading, writing, and one error for everything that NumPy refuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.atomic_writing import whole_file


def read_arrays(path: Path, names: Sequence[str]) -> list[npt.NDArray[Any]]:
    """Read named arrays from an .npz file, without pickles.

    Raises
    ------
    InvalidFileError
        If the file is missing, damaged, or lacks one of the names.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            return [archive[name] for name in names]
    except FileNotFoundError:
        raise InvalidFileError(f"there is no file '{path}'", path=path) from None
    # Damaged archives raise errors of zipfile, zlib, tokenize, struct and a dozen built-in types.
    except Exception as error:  # noqa: BLE001
        message = f"'{path}' is not an .npz file with {', '.join(names)}: {error}"
        raise InvalidFileError(message, path=path) from None


def write_arrays(path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Write named arrays to a compressed .npz file, whole or not at all.

    Raises
    ------
    InvalidFileError
        If the file cannot be written.
    """
    with whole_file(path) as whole, whole.open("wb") as stream:
        # Into a stream: savez would add ".npz" to a path.
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
