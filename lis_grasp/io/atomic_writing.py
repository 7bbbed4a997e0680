"""Atomic writing of files, and the lock of a folder: one process at a time adds to its logs."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it replaces `path` after the block has succeeded.

    Raises `InvalidFileError` for a folder or a device, or if writing fails, as on a full disk.
    """
    temporary = path.with_name(f".partial-{secrets.token_hex(8)}{path.suffix}")
    try:
        if path.exists() and not path.is_file():
            raise FileExistsError("it is a folder or a device")
        path.parent.mkdir(parents=True, exist_ok=True)
        # Unlike tempfile's files, it has the mode that the user's umask gives to new files.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        message = f"cannot write {path}: {error.strerror or error}"
        if isinstance(error, FileExistsError | NotADirectoryError | PermissionError):
            message += ": name another file or folder"
        raise InvalidFileError(message, path=path) from None
    finally:
        with suppress(OSError):  # it does not exist
            temporary.unlink()


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
