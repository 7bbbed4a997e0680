"""Provenance: version, task and seed as one JSON line in a file's header."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.version import __version__

HEADER_BYTES = 65_536
"""Bytes within which the header of a PLY, or of a file of results, ends."""

_MARK = "lis_grasp "
_DIGEST_LENGTH = 16
# The package, and its root, which names nearly all modules but imports none before they are used.
_PACKAGE = Path(__file__).resolve().parent.parent
_ROOT = _PACKAGE / "__init__.py"
_IMPORT = re.compile(r"^\s*from (lis_grasp[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def describe(**facts: Any) -> str:
    """Return `facts` and the package's version as the header line of an output file.

    Give it only facts that are equal in equal runs (no times, no paths), so that equal runs write
    equal bytes.
    """
    return _MARK + json.dumps({"version": __version__, **facts}, sort_keys=True)


@lru_cache
def source_digest(module: str, skipped: tuple[str, ...] = ()) -> str:
    """Return a hash of the source of a module and of all that it imports from this package.

    It distinguishes two states of one version. `skipped` modules and folders are left out where
    modules in the folder of `module` import them.
    """
    digest = hashlib.sha256()
    for name, path in sorted(_imported(module, skipped).items()):
        digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:_DIGEST_LENGTH]


def _imported(module: str, skipped: tuple[str, ...]) -> dict[str, Path]:
    """Return the files of a module and of all that it imports, by their module names."""
    home = module.rpartition(".")[0]
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _module_file(name)
        if name in files or path is None:
            continue
        files[name] = path
        for imported in _imports_of(path):
            of_home = name.rpartition(".")[0] == home
            if not (of_home and any(f"{imported}.".startswith(f"{s}.") for s in skipped)):
                waiting.append(imported)
    return files


def _imports_of(path: Path) -> Iterator[str]:
    """Yield what a file imports from this package: modules, and names that may be modules."""
    for match in _IMPORT.finditer(path.read_text(encoding="utf-8")):
        module, names = match.group(1), re.findall(r"\w+", match.group(2))
        yield module
        yield from (f"{module}.{name}" for name in names)


def _module_file(name: str) -> Path | None:
    """Return the file of a module of this package; None if there is none of that name."""
    path = _PACKAGE.joinpath(*name.split(".")[1:])
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in files if file != _ROOT and file.is_file()), None)


def digest_of(path: Path) -> str:
    """Return a hash of a file's content; `InvalidFileError` if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:_DIGEST_LENGTH]
    except OSError as error:
        raise InvalidFileError.unreadable(path, error) from None


def parse(header: str) -> dict[str, Any]:
    """Return the facts in a header that `describe` wrote; empty for other headers."""
    for line in header.splitlines():
        if line.startswith(_MARK):
            try:
                facts = json.loads(line[len(_MARK) :])
            except (ValueError, RecursionError):
                return {}
            return facts if isinstance(facts, dict) else {}
    return {}


def read(path: Path, *, usual: str = "contacts.ply") -> dict[str, Any]:
    """Return the facts in the header of a .ply or .json output file; empty without a header.

    `usual` is the name of such a file in a folder of results, for the message if `path` is one.

    Raises `InvalidFileError` if the file cannot be read.
    """
    if os.path.isdir(path):
        inside = path / usual
        advice = f"name {inside}" if os.path.isfile(inside) else "name a file in it"
        raise InvalidFileError(f"{path} must be a file; it is a folder: {advice}", path=path)
    try:
        with path.open("rb") as file:
            if path.suffix.lower() == ".json":
                content = json.loads(file.read().decode("utf-8"))
                return parse(str(content.get("header", ""))) if isinstance(content, dict) else {}
            head = file.read(HEADER_BYTES)
    except OSError as error:
        raise InvalidFileError.unreadable(path, error) from None
    except (ValueError, RecursionError):
        return {}
    comments = (
        line.removeprefix(b"comment ").decode("utf-8", errors="replace")
        for line in re.split(rb"^end_header", head, maxsplit=1, flags=re.MULTILINE)[0].splitlines()
        if line.startswith(b"comment ")
    )
    return parse("\n".join(comments))


def merge(inherited: Mapping[str, Any], **facts: Any) -> str:
    """Return the header line of a file made from another one: the inherited facts and new ones."""
    return describe(**{k: v for k, v in inherited.items() if k != "version"} | facts)
