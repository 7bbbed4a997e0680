"""Loading of objects from mesh files: read, scaled to metres, repaired."""

from __future__ import annotations

import os
import struct
import warnings
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidFileError, InvalidMeshError, InvalidOptionError
from lis_grasp.shapes.repair import repair_mesh
from lis_grasp.shapes.shape import LARGEST, SMALLEST, Shape
from lis_grasp.typing import FloatArray, IntArray

UNITS: Mapping[str, float] = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254})
"""Length units that a mesh file may be in, in metres."""

FORMATS = (".obj", ".stl", ".ply", ".gltf", ".glb", ".off")
"""Endings of the mesh files that can be read."""

# Coordinates beyond this, in whatever unit, are damage.
_FARTHEST = 1e12

# Errors of trimesh's readers on files of another format.
_READ_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    BufferError,
    EOFError,
    LookupError,
    MemoryError,
    NameError,
    NotImplementedError,
    OSError,
    TypeError,
    ValueError,
    struct.error,
)


def load(path: str | Path, units: str = "m") -> Shape:
    """Return the object in a mesh file, closed and outward whatever state the file is in.

    The frame O is the file's own, scaled to metres and neither shifted nor turned: the object
    stands on its lowest z there. Several parts are one object. Repairs are listed in
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
    return Shape.from_mesh(path.stem, mesh, repairs)


def _read(path: Path) -> tuple[FloatArray, IntArray]:
    """Return the triangles of a file as vertices (V, 3) in its units and faces (F, 3)."""
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise InvalidFileError(
            f"{path} must end in one of {', '.join(FORMATS)}; convert other formats, for example"
            " with MeshLab",
            path=path,
        )
    if not os.path.isfile(path):
        raise InvalidFileError(f"{path} is missing, or is no file: check the path", path=path)
    if path.stat().st_size == 0:
        raise InvalidFileError(f"{path} is empty: export it again", path=path)
    try:
        with warnings.catch_warnings():
            # Warnings about textures and colours do not matter here.
            warnings.simplefilter("ignore")
            mesh = trimesh.load_scene(
                str(path), file_type=ending[1:], process=False, skip_materials=True
            ).to_mesh()
            vertices = np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(mesh.faces, dtype=np.int64).reshape(-1, 3)
    except _READ_ERRORS as error:
        detail = " ".join(str(error).split())[:120] or type(error).__name__
        raise InvalidFileError(
            f"{path} cannot be read as {ending[1:].upper()} ({detail}): export it again",
            path=path,
        ) from None
    if not len(faces):
        raise InvalidFileError(
            f"{path} has no faces, so it holds no surface (a point cloud?): a mesh is needed",
            path=path,
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InvalidFileError(
            f"{path} has faces that name vertices it lacks: export it again", path=path
        )
    return vertices, faces


def _mistaken_units(path: Path, extent: float, units: str) -> str:
    fitting = [
        f"{name} (then {extent * metres:.3g} m)"
        for name, metres in UNITS.items()
        if SMALLEST <= extent * metres <= LARGEST
    ]
    advice = f"--units {' or --units '.join(fitting)} would fit" if fitting else "no unit would fit"
    return (
        f"{path} is {extent * UNITS[units]:.3g} m large when read in {units}, an object must be"
        f" {SMALLEST} to {LARGEST} m: {advice}"
    )
