"""Surface files: PLY with uncertainty, for MeshLab, Blender, CloudCompare and trimesh.

As written: binary, little endian. Element ``vertex`` has x y z in metres (double, so every number
is restored exactly), uncertainty (double, metres) where known and a colour that shows it, from teal
(low) to yellow (high). Element ``face`` has triangles. Equal meshes make equal bytes. As read: any
precision and order of properties, text or binary. The intermediate estimates of an exploration are
in the folder growth/ of its results, named after their numbers of contacts: ``growth/13.ply``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from plyfile import PlyElement

from lis_grasp.exceptions import InvalidFileError, InvalidMeshError
from lis_grasp.io import provenance
from lis_grasp.io._ply import ply_bytes, ply_element, polygons_of, read_ply
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.contact_files import POINT_FORMATS
from lis_grasp.typing import ByteArray, FloatArray, IntArray

_LOW, _HIGH = np.array([38.0, 130.0, 142.0]), np.array([253.0, 231.0, 37.0])

# Quantile of the uncertainty at which the colour scale ends.
_SHOWN = 0.8


def save_surface(mesh: trimesh.Trimesh, path: Path | str, *, header: str = "") -> None:
    """Write a surface to a .ply file.

    Parameters
    ----------
    mesh
        In O [m]; its `vertex_attributes["uncertainty"]`, shape (V,) [m], is written if present.
    path
        Ends in .ply.
    header
        Lines on the origin of the surface; they become comments of the file.

    Raises
    ------
    InvalidFileError
        If the path has another ending or cannot be written to.
    InvalidMeshError
        If the mesh has no triangles, a vertex is not finite, or the uncertainty is not one number
        a vertex.
    """
    path = Path(path)
    _require_ply(path)
    elements = [ply_element("vertex", _vertex_columns(mesh))]
    elements.append(ply_element("face", {"vertex_indices": np.asarray(mesh.faces, dtype="<i4")}))
    write_bytes(path, ply_bytes(elements, header, text=False))


def load_surface(path: Path | str) -> trimesh.Trimesh:
    """Read a surface from a .ply file by `save_surface` or another program.

    Returns
    -------
    trimesh.Trimesh
        In O [m], vertices and triangles in the file's order, nothing merged. Has
        `vertex_attributes["uncertainty"]` if the file does; `metadata["header"]` is its comments.

    Raises `InvalidFileError` if the file is missing, damaged, of another format, or not a triangle
    mesh.
    """
    path = Path(path)
    _require_ply(path)
    data = read_ply(path)
    elements = {element.name: element for element in data.elements}
    vertices = _columns(path, elements.get("vertex"), ("x", "y", "z"))
    faces = _triangles(path, polygons_of(data), len(vertices))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.metadata["header"] = "\n".join(data.comments)
    if "uncertainty" in elements["vertex"].data.dtype.names:
        column = _columns(path, elements["vertex"], ("uncertainty",), finite=False)
        if (column < 0.0).any():
            raise InvalidFileError(f"{path}: uncertainty must not be negative; some is", path=path)
        mesh.vertex_attributes["uncertainty"] = column[:, 0]
    return mesh


def no_faces_error(path: Path) -> InvalidFileError:
    """Return the error of a file without faces where a mesh is needed."""
    advice = (
        "export it as triangles or, if it is a scan, its points as .ply for `lis-grasp estimate`"
    )
    if path.suffix.lower() in POINT_FORMATS:
        advice = f"if it has points, `lis-grasp estimate {path}` makes a surface from them"
    return InvalidFileError(f"{path} has no faces, and a mesh is needed: {advice}", path=path)


def save_growth(results: Path, contacts: int, mesh: trimesh.Trimesh, header: str) -> None:
    """Write the estimate from the first `contacts` contacts, in O [m]."""
    save_surface(mesh, results / "growth" / f"{contacts}.ply", header=header)


def load_growth(results: Path, facts: Mapping[str, Any]) -> list[tuple[int, trimesh.Trimesh]]:
    """Return the intermediate estimates of a surface, each with its number of contacts, in order.

    `facts` are the provenance of the surface: estimates by another exploration or estimator are
    left out. Raises `InvalidFileError` if a file is damaged.
    """
    growth = []
    for contacts, path in sorted(_growth_files(results).items()):
        made = provenance.read(path)
        # Explorations always carve free space; the version may change between two stages.
        kept = made.keys() - {"version", "free_space"}
        if kept and all(facts.get(name) == made[name] for name in kept):
            growth.append((contacts, load_surface(path)))
    return growth


def growth_folder(results: Path) -> Path | None:
    """Return the folder of intermediate estimates; None if this package wrote no file in it."""
    own = any(map(provenance.read, _growth_files(results).values()))
    return results / "growth" if own else None


def _growth_files(results: Path) -> dict[int, Path]:
    paths = (results / "growth").glob("*.ply")
    return {int(path.stem): path for path in paths if path.stem.isdecimal()}


def _require_ply(path: Path) -> None:
    if path.suffix.lower() != ".ply":
        raise InvalidFileError(f"surface files end in .ply; {path} does not", path=path)


def _vertex_columns(mesh: trimesh.Trimesh) -> dict[str, npt.NDArray[Any]]:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if not len(mesh.faces) or not np.isfinite(vertices).all():
        raise InvalidMeshError(
            f"a surface to save needs triangles and finite vertices; this one has {len(mesh.faces)}"
            f" triangles and {np.count_nonzero(~np.isfinite(vertices).all(axis=1))} such vertices"
        )
    columns: dict[str, npt.NDArray[Any]] = dict(zip("xyz", vertices.T, strict=True))
    uncertainty = mesh.vertex_attributes.get("uncertainty")
    if uncertainty is not None:
        uncertainty = np.asarray(uncertainty, dtype=np.float64)
        if uncertainty.shape != (len(vertices),):
            raise InvalidMeshError(
                f"uncertainty must be one number for each of {len(vertices)} vertices; it has shape"
                f" {uncertainty.shape}"
            )
        columns["uncertainty"] = uncertainty
        columns |= dict(zip(("red", "green", "blue"), _colours(uncertainty).T, strict=True))
    return columns


def _colours(uncertainty: FloatArray) -> ByteArray:
    """Return a colour for each uncertainty, shape (V, 3)."""
    finite = uncertainty[np.isfinite(uncertainty)]
    end = float(np.quantile(finite, _SHOWN)) if len(finite) else 0.0
    scaled = np.where(uncertainty <= end, np.clip(uncertainty, 0.0, end) / (end or 1.0), 1.0)
    return np.rint(_LOW + scaled[:, None] * (_HIGH - _LOW)).astype(np.uint8)


def _columns(
    path: Path, element: PlyElement | None, names: tuple[str, ...], *, finite: bool = True
) -> FloatArray:
    if element is None or any(name not in element.data.dtype.names for name in names):
        raise InvalidFileError(f"{path} has no {' '.join(names)} for its vertices", path=path)
    try:
        columns = np.stack([element.data[n].astype(np.float64) for n in names], axis=1)
    except (TypeError, ValueError):
        raise InvalidFileError(f"{path}: {' '.join(names)} must be numbers", path=path) from None
    if np.isnan(columns).any() or (finite and not np.isfinite(columns).all()):
        raise InvalidFileError(f"{path}: {' '.join(names)} must be finite; some are not", path=path)
    return columns


def _triangles(path: Path, polygons: npt.NDArray[Any], vertices: int) -> IntArray:
    if not len(polygons):
        raise no_faces_error(path)
    if polygons.dtype == object:  # lengths may differ
        if any(len(row) != 3 for row in polygons):
            raise InvalidFileError.of(path, "must have triangles only; some face has another count")
        polygons = np.array(polygons.tolist())
    faces = polygons.astype(np.int64).reshape(-1, 3)
    if faces.min() < 0 or faces.max() >= vertices:
        raise InvalidFileError(
            f"{path}: a face has a vertex index outside of 0 to {vertices - 1}", path=path
        )
    return faces
