"""Loading of objects: mesh files, scaled to metres and repaired, and built-in shapes by name."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidMeshError, InvalidOptionError, nearest_of
from lis_grasp.io.contact_files import POINT_FORMATS
from lis_grasp.io.mesh_files import TO_Z_UP, MeshFile, read_mesh
from lis_grasp.io.surface_files import no_faces_error
from lis_grasp.io.units import UNITS, chosen_unit, require_object_size, unit_name
from lis_grasp.shapes._repair import repair_mesh
from lis_grasp.shapes.builtin import BUILDERS, NAMES, build
from lis_grasp.shapes.shape import Shape, sharp_edges
from lis_grasp.typing import FloatArray, IntArray

FORMATS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off", ".3mf", ".dae")
"""Endings of the mesh files that can be read."""

UP_AXES = ("z", "y")
"""Axes that may point up in a mesh file."""

FARTHEST_OBSTACLE = 50.0  # from the origin [m]: a room; in millimetres it is beyond
# Coordinates beyond this, in whatever unit, are damage.
_FARTHEST = 1e12


def find(
    name_or_path: str | Path,
    size: float | None = None,
    units: str | None = None,
    up: str | None = None,
) -> Shape:
    """Return a built-in shape by name, or else the object in a mesh file.

    Parameters
    ----------
    name_or_path
        One of `NAMES`, or the path of a mesh file; write ``./box`` for a file called box.
    size
        Largest extent of a built-in shape [m]; None for a graspable one.
    units, up
        Unit and axis of a mesh file, see `load`.

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
    return load(path, units, up)


def load(path: str | Path, units: str | None = None, up: str | None = None) -> Shape:
    """Return the object in a mesh file, closed and outward whatever state the file is in.

    The frame O is the file's own, scaled to metres, with z upwards. `Shape.repairs` lists the scale
    and turn that a file states, and repairs.

    Parameters
    ----------
    path
        An OBJ, STL, PLY, glTF, GLB, OFF, 3MF or COLLADA file with triangles or polygons.
    units
        Length unit of the file, a key of `UNITS`; None for what it states, or else metres.
    up
        Axis that points up in the file, "z" or "y"; None for what it states, or else z.

    Raises
    ------
    InvalidFileError
        If the file is missing, of another format, unreadable or without faces.
    InvalidMeshError
        If its size fits no object of a hand (mistaken units, mostly), or it encloses no volume.
    InvalidOptionError
        If there is no such unit or axis, or the file states others.
    """
    path = Path(path)
    if units is not None and units not in UNITS:
        raise InvalidOptionError.not_one_of("units", units, UNITS)
    if up is not None and up not in UP_AXES:
        raise InvalidOptionError.not_one_of("up", up, UP_AXES)
    if str(path) in BUILDERS and not path.exists():
        raise InvalidFileError(
            f"there is no file {path}; of the built-in shape, write shapes.find('{path}')",
            path=path,
        )
    read, vertices, faces, metres, changes = _read(path, units, up)
    corners = vertices[faces.ravel()]
    if not np.all(np.abs(corners) < _FARTHEST):
        raise InvalidMeshError(
            f"{path} has vertices that are no finite numbers, or far beyond any object:"
            " export it again"
        )
    extent = float(np.ptp(corners, axis=0).max())
    require_object_size(str(path), extent, metres, stated=read.metres is not None)
    try:
        mesh, repairs = repair_mesh(vertices * metres, faces)
    except InvalidMeshError as error:
        raise InvalidMeshError(f"{path} {error}") from None
    return Shape(path.stem, mesh, sharp_edges(mesh), (*changes, *repairs))


def load_obstacles(path: str | Path) -> trimesh.Trimesh:
    """Return the mesh of a file [m] as it is: it may be open, and of several parts.

    Units and axes that the file states are used, as `load` does; else it is in metres, z upwards.

    Raises `InvalidFileError` if the file is missing, of another format, unreadable or without
    faces, and `InvalidMeshError` if it is too large for metres, or has vertices that are no finite
    numbers.
    """
    _, vertices, faces, metres, _ = _read(Path(path), None, None)
    corners = vertices[faces.ravel()]
    extent = float(np.abs(corners).max()) * metres
    if not extent <= FARTHEST_OBSTACLE:
        raise InvalidMeshError(
            f"obstacles must be in metres, within {FARTHEST_OBSTACLE:g} m of the origin; {path}"
            f" reaches {extent:.3g}: scale its vertices, by 0.001 if they are in millimetres"
        )
    # Equal vertices are merged.
    return trimesh.Trimesh(metres * corners, np.arange(len(corners)).reshape(-1, 3))


def _read(
    path: Path, units: str | None, up: str | None
) -> tuple[MeshFile, FloatArray, IntArray, float, tuple[str, ...]]:
    """Return a file, its vertices with z up (V, 3), faces (F, 3), unit [m], and what it stated."""
    if path.suffix.lower() in set(POINT_FORMATS) - set(FORMATS):
        raise no_faces_error(path)
    read = read_mesh(path, FORMATS)
    faces = np.array(read.mesh.faces, dtype=np.int64).reshape(-1, 3)
    if not len(faces):
        raise no_faces_error(path)
    if faces.min() < 0 or faces.max() >= len(read.mesh.vertices):
        raise InvalidFileError(
            f"{path} has faces that name vertices it lacks: export it again", path=path
        )
    metres = chosen_unit(path, read.metres, units)
    if up is not None and read.up not in (None, up):
        message = f"up must be {read.up}, as {path} or its format states; it is {up}: leave it out"
        raise InvalidOptionError(message, option="up", value=up)
    axis = up or read.up or "z"
    with np.errstate(invalid="ignore"):  # vertices that are not finite are refused later
        vertices = np.array(read.mesh.vertices, dtype=np.float64) @ TO_Z_UP[axis].T
    changes = [f"scaled from {unit_name(metres)} to metres"] if read.metres and metres != 1 else []
    changes += [f"turned from {axis} up to z up"] if read.up and axis != "z" else []
    changes = [*read.left_out, *(f"{change}, as the file states" for change in changes)]
    return read, vertices, faces, metres, tuple(changes)
