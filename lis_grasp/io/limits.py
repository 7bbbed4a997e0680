"""Limits of files, checked before their content takes memory, and one error for damaged ones."""

from __future__ import annotations

import re
import stat
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import yaml

from lis_grasp.exceptions import InvalidFileError, shown
from lis_grasp.io.provenance import HEADER_BYTES

MEBIBYTE = 2**20
"""Bytes."""

MOST_UNPACKED = 256 * MEBIBYTE
"""Largest size of a text, and of an unpacked archive."""

MOST_BYTES = 512 * MEBIBYTE
"""Largest size of a mesh file and of a PLY."""

MOST_NODES = 50_000
"""Most values and keys of a YAML file; those of an alias count at each use."""

MOST_CHARACTERS = 10_000
"""Largest length of a value in YAML: PyYAML's time to read 1:59:59:... grows with its square."""

_REASONS: Mapping[type[Exception], str] = {
    UnicodeDecodeError: "it is not UTF-8 text",
    RecursionError: "its values are nested too deeply",
    zipfile.BadZipFile: "it is no ZIP archive, or cut off",
}
_QUOTED = 60  # most letters of a line in a message
_PLY_ELEMENT = re.compile(rb"^element[ \t]+(\S+)[ \t]+(\d{1,18})", re.MULTILINE)


def require_file_size(path: Path, most: int) -> None:
    """Raise `InvalidFileError` for a device, or a file of more than `most` bytes.

    Raises OSError if the file is missing.
    """
    facts = path.stat()
    size = facts.st_size
    if not stat.S_ISREG(facts.st_mode):
        raise InvalidFileError(f"{path} must be a file; it is a folder or a device", path=path)
    if size > most:
        raise InvalidFileError(
            f"{path} must have at most {most // MEBIBYTE} MiB; it has {size / MEBIBYTE:.0f} MiB:"
            " write fewer points, triangles or rows",
            path=path,
        )


class ReadError(ValueError):
    """Why a file cannot be read, in words for its user, and the cure, if there is one."""

    def __init__(self, reason: str, cure: str = "") -> None:
        super().__init__(reason)
        self.cure = cure


def reason_of(error: Exception, kind: str) -> str:
    """Return why a reader failed in words for its user: never in a library's own."""
    if isinstance(error, ReadError):
        return str(error)
    if type(error) in _REASONS:
        return _REASONS[type(error)]
    mark = getattr(error, "problem_mark", None)  # YAML has it; JSON has lineno
    line = getattr(error, "lineno", None) if mark is None else mark.line + 1
    if isinstance(error, ElementTree.ParseError):
        line = error.position[0]
    if line:
        lines = (getattr(mark, "buffer", None) or "").rstrip("\0").splitlines()[line - 1 : line]
        quoted = f", {lines[0].strip()[:_QUOTED]!r}," if lines and lines[0].strip() else ""
        if isinstance(error, yaml.constructor.ConstructorError):
            return f"line {line}{quoted} has a key or a tag that is not read"
        return f"line {line}{quoted} is no {kind}, or it is cut off there"
    if found := re.search(r"to float: b?'(.*)'|base 10: '(.*)'", str(error)):
        return f"it has {shown(found[1] or found[2])} where a number is needed"
    if str(error).startswith("Object arrays"):
        return "an array has Python objects, which are not read"
    if isinstance(error, KeyError) and str(error.args[0]).isidentifier():
        return f"it lacks {error.args[0]}"
    return f"it is damaged, or no {kind}"


@contextmanager
def reading(
    path: Path, kind: str, *, most: int = MOST_UNPACKED, advice: str = "write it again"
) -> Iterator[None]:
    """Refuse a file of more than `most` bytes, or whose reader raises an error in this context.

    `kind` names the format and `advice` ends the message. Readers of damaged files raise errors of
    a dozen types; each becomes an `InvalidFileError`.
    """
    try:
        require_file_size(path, most)
        yield
    except InvalidFileError:
        raise
    except OSError as error:
        raise InvalidFileError.unreadable(Path(error.filename or path), error) from None
    except Exception as error:  # noqa: BLE001
        reason, cure = reason_of(error, kind), getattr(error, "cure", "") or advice
        raise InvalidFileError.of(path, f"cannot be read as {kind} ({reason}): {cure}") from None


def announced_rows(path: Path) -> dict[str, int]:
    """Return the numbers of rows that a PLY file announces, by element.

    Raises ValueError if it announces more rows than it has bytes.
    """
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES).partition(b"end_header")[0]
    if not head.startswith(b"ply"):
        raise ReadError("it does not begin with ply")
    rows = {name.decode("ascii", "replace"): int(n) for name, n in _PLY_ELEMENT.findall(head)}
    if sum(rows.values()) > path.stat().st_size:
        raise ReadError(f"it announces {sum(rows.values())} rows, more than it has bytes")
    return rows


def require_small(size: int) -> None:
    """Raise ValueError for content of more than 256 MiB when it is unpacked."""
    if size > MOST_UNPACKED:
        raise ReadError(f"it unpacks to more than {MOST_UNPACKED // MEBIBYTE} MiB")


def read_arrays(path: Path, names: Sequence[str] = ()) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an .npz file by name, all or only some, without pickled objects.

    Raises `InvalidFileError` if the file is missing or damaged, lacks a name, or unpacks to more
    than 256 MiB.
    """
    # An archive keeps its file open while a member is open: close the file here in any case.
    with reading(path, "NPZ"), path.open("rb") as file, zipfile.ZipFile(file) as archive:
        present = [n.removesuffix(".npy") for n in archive.namelist() if n.endswith(".npy")]
        if missing := [name for name in names if name not in present]:
            raise InvalidFileError(
                f"{path} must have the arrays {', '.join(names)}; it lacks {', '.join(missing)} and"
                f" has {', '.join(map(shown, present[:8])) or 'none'}",
                path=path,
            )
        members = {name: archive.getinfo(f"{name}.npy") for name in names or present}
        require_small(sum(member.file_size for member in members.values()))
        return {n: np.load(archive.open(m), allow_pickle=False) for n, m in members.items()}


class _LimitedLoader(yaml.SafeLoader):
    """Loader of plain values that ends early in a file of too many or too long ones."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._composed = 0  # nodes until now, those of aliases at each use
        self._sizes: dict[yaml.Node, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        """Return the next node; see `yaml.composer.Composer`."""
        is_alias, before = self.check_event(yaml.AliasEvent), self._composed
        node: yaml.Node = super().compose_node(parent, index)
        if is_alias and node not in self._sizes:
            raise ReadError("an alias is inside of its own anchor")
        self._composed += self._sizes[node] if is_alias else 1
        if self._composed > MOST_NODES:
            raise ReadError(f"it has more than {MOST_NODES} values, those of aliases included")
        if isinstance(node, yaml.ScalarNode) and len(node.value) > MOST_CHARACTERS:
            raise ReadError(f"a value has more than {MOST_CHARACTERS} characters")
        if isinstance(node, yaml.MappingNode):
            _require_unique_keys(node)
        self._sizes.setdefault(node, self._composed - before)
        return node


def parse_yaml(text: str) -> Any:
    """Return the plain values of a YAML text.

    Raises ValueError or another built-in error, or one of PyYAML, if the text is not YAML, repeats
    a key, has an alias inside of itself, or more than `MOST_NODES` values or, in one of them,
    `MOST_CHARACTERS`.
    """
    loader = _LimitedLoader(text)
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()


def _require_unique_keys(node: yaml.MappingNode) -> None:
    keys = Counter((key.tag, key.value) for key, _ in node.value if key.tag.endswith(":str"))
    for (_, key), count in keys.items():
        if count > 1:
            raise ReadError(f"the key {shown(key)} occurs {count} times in one mapping")
