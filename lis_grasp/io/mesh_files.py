"""Mesh files: triangles, and the units and upward axis that format or file states.

trimesh reads glTF, COLLADA, OBJ and PLY of triangles with their colours. Other faces are cut into
triangles here first, and the result is compared with what the file announces.
"""

from __future__ import annotations

import io
import json
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidFileError, LisGraspWarning
from lis_grasp.io._mesh_archives import plain_dae, read_3mf
from lis_grasp.io._mesh_text import as_triangles, plain_obj, read_off, read_ply_polygons, read_stl
from lis_grasp.io.content_kinds import named_by_content, require_kind
from lis_grasp.io.limits import (
    MOST_BYTES,
    MOST_UNPACKED,
    ReadError,
    announced_rows,
    reading,
    reason_of,
    require_file_size,
)
from lis_grasp.io.units import require_resolved
from lis_grasp.typing import FloatArray, IntArray

TO_Z_UP: Mapping[str, FloatArray] = MappingProxyType(
    {
        "z": np.eye(3),
        "y": np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
        "x": np.array([[0, -1.0, 0], [0, 0, -1.0], [1.0, 0, 0]]),
    }
)
"""Rotations that turn an upward axis to z, with the other axes in COLLADA's order."""

# Of glTF: extensions without shape, and the mode of primitives that are fans.
_HARMLESS = re.compile("materials|texture|lights|xmp|variants")
_FAN = 6
_STL_OR_3MF = "export it as STL or 3MF from"
_WAYS = {
    f"{_STL_OR_3MF} a CAD program such as FreeCAD": ".step .stp .iges .igs .brep .fcstd",
    f"{_STL_OR_3MF} Blender": ".usd .usda .usdc .usdz .fbx .blend .abc",
    f"{_STL_OR_3MF} MeshLab": ".wrl .vrml .x3d .3ds",
    f"{_STL_OR_3MF} the program that made it": ".sldprt .sldasm .ipt .prt .amf .skp",
    "unpack it": ".zip .gz .7z .rar .bz2 .xz .tar .zae",
}


@dataclass(frozen=True, slots=True, eq=False)
class MeshFile:
    """Everything in a mesh file as one mesh, in its own units and axes.

    Attributes
    ----------
    mesh
        The triangles.
    metres
        Length of the unit that the file or its format states [m]; None if it does not.
    up
        Axis that the file or its format states to point up, "x", "y" or "z"; None if it does not.
    left_out
        Content of the file beside the object, in words.
    """

    mesh: trimesh.Trimesh
    metres: float | None = None
    up: str | None = None
    left_out: tuple[str, ...] = ()


def read_mesh(
    path: Path, formats: Sequence[str], *, merge: bool = False, materials: bool = False
) -> MeshFile:
    """Return everything in a mesh file as one mesh, in its units and frame.

    Parameters
    ----------
    path
        The file.
    formats
        Permitted endings, such as ``.stl``.
    merge
        Whether equal vertices are merged.
    materials
        Whether colours and textures are read too, where the file has triangles only.

    Raises
    ------
    InvalidFileError
        If the file is missing, empty, of another format, larger than 512 MiB, or damaged, has less
        than it announces, or requires an extension that is not read.
    """
    ending = path.suffix.lower()
    if os.path.isdir(path):
        raise InvalidFileError.of(path, "must be a file; it is a folder: name a file in it")
    if ending not in formats:
        ways = (way for way, endings in _WAYS.items() if ending in endings.split())
        raise InvalidFileError(
            f"{path} must end in one of {', '.join(formats)}:"
            f" {next(ways, 'convert a mesh to one of these')}",
            path=path,
        )
    if not os.path.isfile(path):
        message = f"there is no file {path.name} in {path.absolute().parent}: check the path; if"
        raise InvalidFileError(f"{message} results record it, its option names another", path=path)
    kind, most = ending[1:].upper(), MOST_BYTES
    with named_by_content(path), reading(path, kind, most=most, advice="export it again"):
        if not path.stat().st_size:
            raise ReadError("it is empty")
        with warnings.catch_warnings():
            # Warnings about textures and colours do not matter here.
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LisGraspWarning)
            read = _read(path, ending, merge, materials)
        for array in (read.mesh.vertices, read.mesh.faces):
            if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
                raise ReadError("its rows are not of three numbers")
        require_resolved(path, np.asarray(read.mesh.vertices))
        if not len(read.mesh.faces):
            require_kind(path)
        return read


def _read(path: Path, ending: str, merge: bool, materials: bool) -> MeshFile:
    match ending:
        case ".stl":
            return MeshFile(_mesh(*read_stl(path), merge))
        case ".off":
            vertices, polygons = read_off(path)
            return MeshFile(_mesh(vertices, as_triangles(vertices, polygons), merge))
        case ".3mf":
            vertices, faces, metres, others = read_3mf(path)
            return MeshFile(_mesh(vertices, faces, merge), metres, "z", others)
        case ".ply":
            return MeshFile(_read_ply(path, merge, materials))
        case ".obj":
            content, announced = plain_obj(path.read_bytes())
            try:
                mesh = _load(path, content, merge, materials)
            except IndexError:
                raise ReadError("a face names a vertex, or a normal, that it lacks") from None
            if len(mesh.faces) != announced:
                raise ReadError(
                    f"it announces {announced} triangles; {len(mesh.faces)} could be read"
                )
            return MeshFile(mesh)
        case ".dae":
            content, unit, up = plain_dae(path.read_bytes())
            return MeshFile(_load(path, content, merge, materials), unit, up)
    _require_readable_gltf(path)
    return MeshFile(_load(path, path.read_bytes(), merge, materials), 1.0, "y")


def _require_readable_gltf(path: Path) -> None:
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
        raise ReadError(
            f"it needs {', '.join(needed)}, which are not read",
            "export plain triangles, without compression",
        )
    # trimesh fills an accessor without a view with as many zeros as it announces.
    if sum(each["count"] for each in accessors if "bufferView" not in each) > path.stat().st_size:
        raise ReadError("it announces more than it has")
    for uri in (buffer.get("uri", "data:") for buffer in header.get("buffers", [])):
        if not uri.startswith("data:"):
            require_file_size(path.parent / unquote(uri), MOST_UNPACKED)


def _read_ply(path: Path, merge: bool, materials: bool) -> trimesh.Trimesh:
    announced = announced_rows(path).get("face")
    with suppress(Exception):  # polygons of mixed sizes raise any error
        mesh = _load(path, path.read_bytes(), merge, materials)
        if len(mesh.faces) == announced:  # triangles only
            return mesh
    return _mesh(*read_ply_polygons(path), merge)


def _mesh(vertices: FloatArray, faces: IntArray, merge: bool) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.asarray(vertices), np.asarray(faces), process=merge, validate=False)


def _load(path: Path, content: bytes, merge: bool, materials: bool) -> trimesh.Trimesh:
    """Return the mesh that trimesh reads of the content of a file."""
    return trimesh.load_scene(
        io.BytesIO(content),
        file_type=path.suffix[1:].lower(),
        resolver=trimesh.resolvers.FilePathResolver(str(path)),
        process=merge,
        skip_materials=not materials,
    ).to_mesh()
