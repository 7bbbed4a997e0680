"""JSON files: reading, with one error for everything that is not JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.file_limits import MEBIBYTE, require_file_size

_MOST_BYTES = 256 * MEBIBYTE


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    InvalidFileError
        If the file cannot be read, has more than 256 MiB, or is not JSON.
    """
    try:
        require_file_size(path, _MOST_BYTES)
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    except (ValueError, RecursionError) as error:
        reason = "it is not text" if isinstance(error, UnicodeDecodeError) else error
        message = f"{path} is not a JSON file: {reason}; name another file, or write it again"
        raise InvalidFileError(message, path=path) from None
