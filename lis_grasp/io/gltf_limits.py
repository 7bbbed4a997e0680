"""Limits of glTF files, whose headers announce how much memory their content takes."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.file_limits import MEBIBYTE, require_file_size

MOST_ELEMENTS = 20_000_000
"""Vectors and indices of a glTF's accessors, and of its meshes wherever a node uses them."""

_MOST_BYTES = 512 * MEBIBYTE  # of a buffer
_MOST_TEXT = 128 * MEBIBYTE  # of JSON
_GLB = struct.Struct("<4sIII4s")  # magic, version, length, length of the first chunk, its type


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
    header = _header(path)
    if not isinstance(header, dict):
        raise InvalidFileError(f"{path} must have a JSON object as its header", path=path)
    try:
        counts = [accessor["count"] for accessor in header.get("accessors", [])]
        if not all(type(count) is int and 0 <= count <= MOST_ELEMENTS for count in counts):
            raise _too_large(path)
        if sum(counts) > MOST_ELEMENTS or _elements(header, counts, path) > MOST_ELEMENTS:
            raise _too_large(path)
        uris = [buffer.get("uri", "data:") for buffer in header.get("buffers", [])]
        files = [path.parent / unquote(uri) for uri in uris if not uri.startswith("data:")]
    except (AttributeError, LookupError, TypeError):
        raise InvalidFileError(f"{path} must follow glTF 2.0; it does not", path=path) from None
    for file in files:
        if not os.path.isfile(file):
            raise InvalidFileError(f"{path} needs the file {file}, which is missing", path=path)
        require_file_size(file, _MOST_BYTES)


def _header(path: Path) -> Any:
    with path.open("rb") as file:
        if path.suffix.lower() == ".gltf":
            require_file_size(path, _MOST_TEXT)
            return json.load(file)
        magic, _, _, length, kind = _GLB.unpack(file.read(_GLB.size))
        if magic != b"glTF" or kind != b"JSON":
            raise ValueError("it has no header of GLB 2")
        return json.loads(file.read(min(length, _MOST_TEXT)))


def _elements(header: Mapping[str, Any], counts: Sequence[int], path: Path) -> int:
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
    sizes: dict[int, int] = {}  # with all nodes below
    waiting = [(number, False) for number in range(len(nodes))]
    around: set[int] = set()
    while waiting:
        number, children_done = waiting.pop()
        node, children = nodes[number], nodes[number].get("children", [])
        if children_done:
            own = meshes[node["mesh"]] if "mesh" in node else 0
            sizes[number] = 1 + own + sum(sizes[child] for child in children)
            around.remove(number)
        elif number in around:
            raise InvalidFileError(f"{path} has a node inside of itself", path=path)
        elif number not in sizes:
            around.add(number)
            waiting += [(number, True), *((child, False) for child in children)]
    shown = [number for scene in header.get("scenes", []) for number in scene.get("nodes", [])]
    roots = set(range(len(nodes))).difference(*(node.get("children", []) for node in nodes))
    return sum(meshes) + max(sum(sizes[n] for n in shown), sum(sizes[n] for n in roots))


def _too_large(path: Path) -> InvalidFileError:
    return InvalidFileError(
        f"{path} must announce at most {MOST_ELEMENTS} vectors and indices; it announces more, or"
        " no number: export it with fewer triangles",
        path=path,
    )
