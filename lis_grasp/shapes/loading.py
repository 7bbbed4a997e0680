"""Loading of objects: mesh files, scaled to metres and repaired, and built-in shapes by name."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidMeshError,
    InvalidOptionError,
    nearest_of,
)
from lis_grasp.io.contact_files import POINT_FORMATS
from lis_grasp.io.mesh_files import read_mesh
from lis_grasp.io.surface_files import no_faces_error
from lis_grasp.io.units import LARGEST, SMALLEST, UNITS
from lis_grasp.shapes._repair import repair_mesh
from lis_grasp.shapes.builtin import BUILDERS, NAMES, build
from lis_grasp.shapes.shape import Shape, sharp_edges
from lis_grasp.typing import FloatArray, IntArray

FORMATS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off")
"""Endings of the mesh files that can be read."""

# Largest extents of objects that hands hold [m]: units that give one of these are proposed first.
_HANDY = (0.02, 0.5)
_FARTHEST_OBSTACLE = 50.0  # from the origin [m]: a room; in millimetres it is beyond
# Coordinates beyond this, in whatever unit, are damage.
_FARTHEST = 1e12


def find(name_or_path: str | Path, size: float | None = None, units: str = "m") -> Shape:
    """Return a built-in shape by name, or else the object in a mesh file.

    Parameters
    ----------
    name_or_path
        One of `NAMES`, or the path of a mesh file; write ``./box`` for a file called box.
    size
        Largest extent of a built-in shape [m]; None for a graspable one.
    units
        Length unit of a mesh file, a key of `UNITS`.

    Raises
    ------
    InvalidOptionError
        If there is neither such a shape nor such a file, the size or the units are not permitted,
        or a size is given for a mesh file (it has its own).
    InvalidFileError, InvalidMeshError
        If the mesh file cannot be used, see `load`.
    """
    if str(name_or_path) in BUILDERS:
        return build(str(name_or_path), size)
    path = Path(name_or_path)
    if not os.path.exists(path) and path.suffix.lower() not in FORMATS:
        raise InvalidOptionError(
            f"'{name_or_path}' is neither a built-in shape ({', '.join(NAMES)}) nor a mesh"
            f" file{nearest_of(name_or_path, NAMES)}",
            option="object",
            value=str(name_or_path),
        )
    if size is not None:
        raise InvalidOptionError(
            f"size is for built-in shapes; the file {path} has its own: give its `units` instead",
            option="size",
            value=size,
        )
    if path.suffix.lower() not in FORMATS and not path.is_file():
        raise InvalidFileError(
            f"{path} is a folder; a mesh file is needed ({', '.join(FORMATS)})", path=path
        )
    return load(path, units)


def load(path: str | Path, units: str = "m") -> Shape:
    """Return the object in a mesh file, closed and outward whatever state the file is in.

    The frame O is the file's own, scaled to metres and neither shifted nor turned: the object
    rests on its lowest z there. Several parts are one object. Repairs are listed in
    `Shape.repairs`.

    Parameters
    ----------
    path
        An OBJ, STL, PLY, glTF, GLB or OFF file with triangles or polygons.
    units
        Length unit of the file, a key of `UNITS`.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, unreadable or without faces.
    InvalidMeshError
        If its size fits no object of a hand (mistaken units, mostly), or it encloses no volume.
    InvalidOptionError
        If there is no such unit.
    """
    path = Path(path)
    if units not in UNITS:
        raise InvalidOptionError.not_one_of("units", units, UNITS)
    if str(path) in BUILDERS and not path.exists():
        raise InvalidFileError(
            f"there is no file {path}; of the built-in shape, write shapes.find('{path}')",
            path=path,
        )
    vertices, faces = _read(path)
    corners = vertices[faces.ravel()]
    if not np.all(np.abs(corners) < _FARTHEST):
        raise InvalidMeshError(
            f"{path} has vertices that are no finite numbers, or far beyond any object:"
            " export it again"
        )
    extent = float(np.ptp(corners, axis=0).max())
    if not SMALLEST <= extent * UNITS[units] <= LARGEST:
        raise InvalidMeshError(_mistaken_units(path, extent, units))
    try:
        mesh, repairs = repair_mesh(vertices * UNITS[units], faces)
    except InvalidMeshError as error:
        raise InvalidMeshError(f"{path} {error}") from None
    return Shape(path.stem, mesh, sharp_edges(mesh), repairs)


def load_obstacles(path: str | Path) -> trimesh.Trimesh:
    """Return the mesh of a file [m] as it is: it may be open, and of several parts.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, unreadable or without faces.
    InvalidMeshError
        If it is too large for metres, or has vertices that are no finite numbers.
    """
    vertices, faces = _read(Path(path))
    mesh = trimesh.Trimesh(vertices, faces)  # equal vertices are merged
    extent = float(np.abs(vertices[faces.ravel()]).max())
    if not extent <= _FARTHEST_OBSTACLE:
        raise InvalidMeshError(
            f"obstacles must be in metres, within {_FARTHEST_OBSTACLE:g} m of the origin; {path}"
            f" reaches {extent:.3g}: scale its vertices, by 0.001 if they are in millimetres"
        )
    return mesh


def _read(path: Path) -> tuple[FloatArray, IntArray]:
    """Return the triangles of a file as vertices (V, 3) in its units and faces (F, 3)."""
    if path.suffix.lower() in set(POINT_FORMATS) - set(FORMATS):
        raise no_faces_error(path)
    mesh = read_mesh(path, FORMATS)
    vertices = np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    faces = np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    if not len(faces):
        raise no_faces_error(path)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InvalidFileError(
            f"{path} has faces that name vertices it lacks: export it again", path=path
        )
    return vertices, faces


def _mistaken_units(path: Path, extent: float, units: str) -> str:
    sizes = {name: extent * metres for name, metres in UNITS.items()}
    for low, high in (_HANDY, (SMALLEST, LARGEST)):
        fitting = [
            f"{name} (then {size:.3g} m)" for name, size in sizes.items() if low <= size <= high
        ]
        if fitting:
            break
    advice = f"`units` {' or '.join(fitting)} would fit" if fitting else "no unit would fit"
    return (
        f"{path} is {extent * UNITS[units]:.3g} m large when read in {units}, an object must be"
        f" {SMALLEST} to {LARGEST} m: {advice}"
    )
