"""Limits of files, checked before their content takes memory, and one error for damaged ones."""

from __future__ import annotations

import json
import math
import os
import re
import stat
import struct
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt
import yaml

from lis_grasp.exceptions import InvalidFileError, shown

MEBIBYTE = 2**20
"""Bytes."""

MOST_ELEMENTS = 20_000_000
"""Vectors and indices of a glTF's accessors, and of its meshes wherever a node uses them."""

MOST_NODES = 50_000
"""Values and keys of a YAML file, those of an alias counted wherever it is used."""

MOST_CHARACTERS = 10_000
"""Length of a value of a YAML file: PyYAML reads 1:59:59:... in the square of it."""

_MOST_BYTES = 512 * MEBIBYTE  # of a glTF's buffer
_MOST_TEXT = 128 * MEBIBYTE  # of a glTF's JSON
_MOST_UNPACKED = 256 * MEBIBYTE  # of the arrays of an .npz file
_GLB = struct.Struct("<4sIII4s")  # magic, version, length, length of the first chunk, its type
_PLY_HEADER = 65_536  # bytes
_PLY_ELEMENT = re.compile(rb"^element[ \t]+\S+[ \t]+(\d{1,18})", re.MULTILINE)
_ARRAY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


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


@contextmanager
def reading(
    path: Path, kind: str, *, most: int = _MOST_UNPACKED, advice: str = "write it again"
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
        message = f"cannot read {path}: {error.strerror or error}"
        raise InvalidFileError(message, path=path) from None
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, UnicodeDecodeError):
            reason = "it is not UTF-8 text"
        message = f"{path} cannot be read as {kind} ({reason}): {advice}"
        raise InvalidFileError(message, path=path) from None


def require_announced_rows(path: Path) -> None:
    """Raise ValueError for a PLY file that announces more rows than it has bytes."""
    with path.open("rb") as file:
        head = file.read(_PLY_HEADER).partition(b"end_header")[0]
    announced = sum(int(count) for count in _PLY_ELEMENT.findall(head))
    if announced > path.stat().st_size:
        raise ValueError(f"it announces {announced} rows, more than it has bytes")


def read_arrays(path: Path, names: Sequence[str]) -> list[npt.NDArray[Any]]:
    """Return the arrays of these names in an .npz file, without pickled objects.

    Raises
    ------
    InvalidFileError
        If the file is missing or damaged, lacks a name, or unpacks to more than 256 MiB.
    """
    # An archive leaves its file open while a member is: the file is closed here in any case.
    with reading(path, "NPZ"), path.open("rb") as file, zipfile.ZipFile(file) as archive:
        members = [archive.getinfo(f"{name}.npy") for name in names]
        if sum(member.file_size for member in members) > _MOST_UNPACKED:
            raise ValueError(f"it unpacks to more than {_MOST_UNPACKED // MEBIBYTE} MiB")
        for member in members:
            with archive.open(member) as packed:
                _require_announced_array(packed, member.file_size)
        return [np.load(archive.open(member), allow_pickle=False) for member in members]


def _require_announced_array(packed: IO[bytes], size: int) -> None:
    """Raise ValueError for an array that announces more than its file of `size` bytes has."""
    version = np.lib.format.read_magic(packed)
    if version not in _ARRAY_HEADERS:
        raise ValueError(f"an array has the unknown format {version}")
    shape, _, dtype = _ARRAY_HEADERS[version](packed)
    if dtype.hasobject or math.prod(shape) * max(dtype.itemsize, 1) > size:
        raise ValueError("an array announces more than it has")


def require_small_gltf(path: Path) -> None:
    """Refuse a .gltf or .glb file that would take much memory, before it is read.

    Raises
    ------
    InvalidFileError
        If its accessors, or the meshes of its nodes together, have more than `MOST_ELEMENTS`, a
        node is inside of itself, or a buffer is no file of at most 512 MiB.
    ValueError
        If the file has no header.
    """
    try:
        header = _gltf_header(path)
        counts = [accessor["count"] for accessor in header.get("accessors", [])]
        permitted = all(type(count) is int and 0 <= count <= MOST_ELEMENTS for count in counts)
        if not permitted or max(sum(counts), _gltf_elements(header, counts)) > MOST_ELEMENTS:
            raise InvalidFileError(
                f"{path} must announce at most {MOST_ELEMENTS} vectors and indices; it announces"
                " more, or no number: export it with fewer triangles",
                path=path,
            )
        uris = [buffer.get("uri", "data:") for buffer in header.get("buffers", [])]
        files = [path.parent / unquote(uri) for uri in uris if not uri.startswith("data:")]
    except CycleError:
        raise InvalidFileError(f"{path} has a node inside of itself", path=path) from None
    except (AttributeError, LookupError, TypeError):
        raise InvalidFileError(f"{path} must follow glTF 2.0; it does not", path=path) from None
    for file in files:
        if not os.path.isfile(file):
            raise InvalidFileError(f"{path} needs the file {file}, which is missing", path=path)
        require_file_size(file, _MOST_BYTES)


def _gltf_header(path: Path) -> Any:
    with path.open("rb") as file:
        if path.suffix.lower() == ".gltf":
            require_file_size(path, _MOST_TEXT)
            return json.load(file)
        magic, _, _, length, kind = _GLB.unpack(file.read(_GLB.size))
        if magic != b"glTF" or kind != b"JSON":
            raise ValueError("it has no header of GLB 2")
        return json.loads(file.read(min(length, _MOST_TEXT)))


def _gltf_elements(header: Mapping[str, Any], counts: Sequence[int]) -> int:
    """Return the number of elements of all meshes, counted at each node that uses them."""
    meshes = [
        sum(
            counts[number]
            for primitive in mesh["primitives"]
            for number in (*primitive["attributes"].values(), primitive.get("indices"))
            if number is not None
        )
        for mesh in header.get("meshes", [])
    ]
    nodes = header.get("nodes", [])
    children = {number: node.get("children", []) for number, node in enumerate(nodes)}
    sizes: dict[int, int] = {}  # with all nodes below
    for number in TopologicalSorter(children).static_order():  # children first
        node_mesh = nodes[number].get("mesh")
        size = 0 if node_mesh is None else meshes[node_mesh]
        sizes[number] = 1 + size + sum(sizes[child] for child in children[number])
    scenes = [number for scene in header.get("scenes", []) for number in scene.get("nodes", [])]
    roots = set(children).difference(*children.values())
    return sum(meshes) + max(sum(sizes[n] for n in scenes), sum(sizes[n] for n in roots))


class _LimitedLoader(yaml.SafeLoader):
    """Loader of plain values that ends early in a file of too many or too long ones."""

    composed = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; see `yaml.composer.Composer`."""
        self.composed += 1
        _require_few(self.composed)
        return super().compose_node(parent, index)

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        """Return the next scalar; see `yaml.composer.Composer`."""
        node: yaml.ScalarNode = super().compose_scalar_node(anchor)
        if len(node.value) > MOST_CHARACTERS:
            raise ValueError(f"a value has more than {MOST_CHARACTERS} characters")
        return node


def parse_yaml(text: str) -> Any:
    """Return the plain values of a YAML text.

    Raises ValueError or another built-in error, or one of PyYAML, if the text is not YAML, repeats
    a key, has an alias inside of itself, or more than `MOST_NODES` values or, in one of them,
    `MOST_CHARACTERS`.
    """
    loader = _LimitedLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _count_nodes(node, {}, set())
        # Only now: merged mappings are copied, wherever they are used.
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _count_nodes(node: yaml.Node, counts: dict[yaml.Node, int], around: set[yaml.Node]) -> int:
    """Return the number of nodes in a node, aliases expanded; ValueError beyond the limit."""
    if node in around:
        raise ValueError("an alias is inside of its own anchor")
    if node not in counts:
        around.add(node)
        parts = node.value if isinstance(node, yaml.CollectionNode) else []
        if isinstance(node, yaml.MappingNode):
            _require_unique_keys(node)
            parts = [part for pair in parts for part in pair]
        counts[node] = 1 + sum(_count_nodes(part, counts, around) for part in parts)
        around.remove(node)
        _require_few(counts[node])
    return counts[node]


def _require_few(count: int) -> None:
    if count > MOST_NODES:
        raise ValueError(f"it has more than {MOST_NODES} values, those of aliases included")


def _require_unique_keys(node: yaml.MappingNode) -> None:
    keys = Counter((key.tag, key.value) for key, _ in node.value if key.tag.endswith(":str"))
    for (_, key), count in keys.items():
        if count > 1:
            raise ValueError(f"the key {shown(key)} occurs {count} times in one mapping")
