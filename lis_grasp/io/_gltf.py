"""glTF files, refused before trimesh would leave out parts of them or fill them with zeros."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from lis_grasp.io.limits import MOST_UNPACKED, ReadError, reason_of, require_file_size

_HARMLESS = re.compile("materials|texture|lights|xmp|variants")  # extensions without shape
_FAN = 6  # mode of primitives


def require_readable_gltf(path: Path) -> None:
    """Raise `ValueError` for a glTF that needs what trimesh does not read, or is no file.

    Raises `InvalidFileError` if a buffer is no file of at most 256 MiB, and OSError if it is
    missing.
    """
    text = path.read_bytes()
    if path.suffix.lower() == ".glb":
        if text[:4] != b"glTF":
            raise ReadError("it has no header of GLB 2")
        text = text[20 : 20 + int.from_bytes(text[12:16], "little")]  # the first chunk
    try:
        header: dict[str, list[Any]] = json.loads(text)
    except json.JSONDecodeError as error:
        raise ReadError(reason_of(error, "JSON")) from None
    accessors = header.get("accessors", [])
    primitives = [part for mesh in header.get("meshes", []) for part in mesh["primitives"]]
    needed = [n for n in header.get("extensionsRequired", []) if not _HARMLESS.search(n)]
    needed += ["sparse accessors"] if any("sparse" in each for each in accessors) else []
    needed += ["triangle fans"] if any(part.get("mode") == _FAN for part in primitives) else []
    if needed:
        message = f"it needs {', '.join(needed)}, which are not read"
        raise ReadError(message, "export plain triangles, without compression")
    # trimesh fills an accessor without a view with as many zeros as it announces.
    if sum(each["count"] for each in accessors if "bufferView" not in each) > path.stat().st_size:
        raise ReadError("it announces more than it has")
    for uri in (buffer.get("uri", "data:") for buffer in header.get("buffers", [])):
        if not uri.startswith("data:"):
            require_file_size(path.parent / unquote(uri), MOST_UNPACKED)
