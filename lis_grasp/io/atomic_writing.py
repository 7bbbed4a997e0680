"""Atomic writing of files, and the lock of a folder: one process at a time adds to its logs."""

from __future__ import annotations

import errno
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError

_OTHER_PATH = "name another file or folder"
_ROOM = f"make room, or {_OTHER_PATH}"
_CURED = {errno.ENOSPC: _ROOM, errno.EDQUOT: _ROOM}
_CURED |= dict.fromkeys((errno.EEXIST, errno.ENOTDIR, errno.EACCES, errno.EROFS), _OTHER_PATH)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it replaces `path` after the block has succeeded.

    Raises `InvalidFileError` for a folder or a device, or if writing fails, as on a full disk.
    """
    temporary = path.with_name(f".partial-{secrets.token_hex(8)}{path.suffix}")
    try:
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "it is a folder or a device")
        path.parent.mkdir(parents=True, exist_ok=True)
        # Unlike tempfile's files, it has the mode that the user's umask gives to new files.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except InvalidFileError as error:  # of what wrote to the temporary path
        raise InvalidFileError(str(error).replace(str(temporary), str(path)), path=path) from None
    except OSError as error:
        raise cannot_write(path, error) from None
    finally:
        with suppress(OSError):  # it does not exist
            temporary.unlink()


def cannot_write(path: Path, error: OSError) -> InvalidFileError:
    """Return the error of a file that cannot be written: why, and what to do."""
    message = f"cannot write {path}: {error.strerror or error}"
    cure = _CURED.get(error.errno or 0)
    return InvalidFileError(message + (f": {cure}" if cure else ""), path=path)


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path`, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` as UTF-8, whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON, whole or not at all; ValueError on NaN and infinities."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


_NAME, _OTHER = ".lock", "name another by `folder`"


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder; make it if it does not exist.

    The operating system releases the lock when the process ends, however it ends. A block that adds
    no file, such as a refused command's, leaves neither the lock's file nor the folder.

    Raises `InvalidFileError` if another process has the lock, or the folder cannot be written to.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(folder / _NAME, timeout=0)
    try:
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        before = set(folder.iterdir())
        lock.acquire()
    except OSError as error:
        message = f"cannot write to {folder}: {error.strerror}: {_OTHER}"
        if isinstance(error, Timeout):
            message = f"another process is writing to {folder}: wait until it ends, or {_OTHER}"
        if isinstance(error, FileExistsError):
            message = f"{folder} must be a folder of results; it is a file: {_OTHER}"
        raise InvalidFileError(message, path=folder) from None
    try:
        yield
    finally:
        with suppress(OSError):  # others hold the file open, or write to the folder now
            if set(folder.iterdir()) - before == {folder / _NAME}:
                (folder / _NAME).unlink()  # before its release, while it is ours
                for path in made:
                    path.rmdir()
        lock.release()
