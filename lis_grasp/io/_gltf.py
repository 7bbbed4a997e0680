"""glTF files: their limits, extensions and triangles, checked before trimesh reads them."""

from __future__ import annotations

import json
import os
import re
import struct
from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.limits import MEBIBYTE, MOST_ELEMENTS, ReadError, reason_of, require_file_size

_MOST_TEXT = 128 * MEBIBYTE  # of a glTF's JSON
_MOST_BUFFER = 512 * MEBIBYTE  # of a glTF's buffer
_HARMLESS = re.compile("materials|texture|lights|xmp|variants")  # extensions beside the shape
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of primitives
_GLB = struct.Struct("<4sIII4s")  # magic, version, length, length of the first chunk, its type


def require_readable_gltf(path: Path) -> int:
    """Refuse a glTF that takes much memory or needs what is not read; return its triangles.

    These are the triangles that its scene announces.

    Raises `InvalidFileError` if its accessors, or the meshes of its nodes together, have more than
    `MOST_ELEMENTS`, a node is inside of itself, a buffer is no file of at most 512 MiB, or it
    requires an extension that is not read, and `ValueError` if the file has no header.
    """
    try:
        header = _gltf_header(path)
        version = str(header["asset"]["version"])
        if not version.startswith("2."):
            raise ReadError(f"it is of version {version}, and 2.0 is read", "export it as glTF 2.0")
        counts = [accessor["count"] for accessor in header.get("accessors", [])]
        permitted = all(type(count) is int and 0 <= count <= MOST_ELEMENTS for count in counts)
        if not permitted or max(sum(counts), _gltf_elements(header, counts)) > MOST_ELEMENTS:
            raise InvalidFileError(
                f"{path} must announce at most {MOST_ELEMENTS} vectors and indices; it announces"
                " more, or no number: export it with fewer triangles",
                path=path,
            )
        required = [n for n in header.get("extensionsRequired", []) if not _HARMLESS.search(n)]
        required += (
            ["sparse accessors"] if any("sparse" in a for a in header.get("accessors", [])) else []
        )
        if required:
            raise InvalidFileError(
                f"{path} needs {', '.join(required)}, which are not read: export it without"
                " compression",
                path=path,
            )
        triangles = _gltf_triangles(header, counts)
        uris = {b.get("uri", "data:"): b["byteLength"] for b in header.get("buffers", [])}
        files = {path.parent / unquote(u): n for u, n in uris.items() if not u.startswith("data:")}
    except CycleError:
        raise InvalidFileError(f"{path} has a node inside of itself", path=path) from None
    except (AttributeError, LookupError, TypeError):
        raise InvalidFileError(
            f"{path} must follow glTF 2.0; it does not: export it again", path=path
        ) from None
    for file, announced in files.items():
        if not os.path.isfile(file):
            raise InvalidFileError(f"{path} needs the file {file}, which is missing", path=path)
        require_file_size(file, _MOST_BUFFER)
        if (size := file.stat().st_size) < announced:
            raise ReadError(f"{file} must have {announced} bytes, and has {size}")
    return triangles


def _gltf_header(path: Path) -> Any:
    with path.open("rb") as file:
        if path.suffix.lower() == ".gltf":
            require_file_size(path, _MOST_TEXT)
            return _json(file.read())
        start = file.read(_GLB.size)
        magic, _, size, length, kind = _GLB.unpack(start.ljust(_GLB.size, b"\0"))
        if magic != b"glTF" or kind != b"JSON":
            raise ReadError("it has no header of GLB 2")
        if size > path.stat().st_size:
            raise ReadError(f"it announces {size} bytes, and has {path.stat().st_size}")
        return _json(file.read(min(length, _MOST_TEXT)))


def _json(text: bytes) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ReadError(reason_of(error, "JSON")) from None


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
    sizes = _sizes_below(header, meshes, node=1)
    scenes = [number for scene in header.get("scenes", []) for number in scene.get("nodes", [])]
    nodes = header.get("nodes", [])
    roots = set(range(len(nodes))).difference(*(node.get("children", []) for node in nodes))
    return sum(meshes) + max(sum(sizes[n] for n in scenes), sum(sizes[n] for n in roots))


def _gltf_triangles(header: Mapping[str, Any], counts: Sequence[int]) -> int:
    """Return the number of triangles in the scene that is shown, strips and fans too."""
    meshes = [0] * len(header.get("meshes", []))
    for number, mesh in enumerate(header.get("meshes", [])):
        for primitive in mesh["primitives"]:
            size = counts[primitive.get("indices", primitive["attributes"].get("POSITION"))]
            mode = primitive.get("mode", _TRIANGLES)
            if mode == _FAN:
                raise ReadError(
                    "it has triangle fans, which are not read", "export plain triangles"
                )
            strip = max(size - 2, 0) if mode == _STRIP else 0
            meshes[number] += size // 3 if mode == _TRIANGLES else strip
    if not header.get("scenes"):
        raise ReadError("it has no scene")
    sizes = _sizes_below(header, meshes)
    return sum(sizes[n] for n in header["scenes"][header.get("scene", 0)].get("nodes", []))


def _sizes_below(header: Mapping[str, Any], meshes: Sequence[int], node: int = 0) -> dict[int, int]:
    """Return the size of each node with all nodes below, given those of meshes and of a node."""
    nodes, sizes = header.get("nodes", []), dict[int, int]()
    children = {number: each.get("children", []) for number, each in enumerate(nodes)}
    for number in TopologicalSorter(children).static_order():  # children first
        own = nodes[number].get("mesh")
        below = sum(sizes[child] for child in children[number])
        sizes[number] = node + below + (0 if own is None else meshes[own])
    return sizes
