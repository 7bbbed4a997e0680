"""Lock of a folder of results: one process at a time adds to its logs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from lis_grasp.exceptions import InvalidFileError

_NAME, _OTHER = ".lock", "name another by `folder`"


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder, which is made if it does not exist.

    The operating system releases the lock when the process ends, however it ends.

    Raises `InvalidFileError` if another process has the lock, or the folder cannot be written to.
    """
    lock = FileLock(folder / _NAME, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except OSError as error:
        message = f"cannot write to {folder}: {error.strerror}"
        if isinstance(error, Timeout):
            message = f"another process is writing to {folder}: wait until it ends, or {_OTHER}"
        if isinstance(error, FileExistsError):
            message = f"{folder} must be a folder of results; it is a file: {_OTHER}"
        raise InvalidFileError(message, path=folder) from None
    try:
        yield
    finally:
        lock.release()
