"""Estimated surfaces in files: PLY, which MeshLab, Blender, CloudCompare and trimesh open.

As written: binary, little endian; element ``vertex`` with x y z in metres (double, so that every
number comes back to the bit), uncertainty (double, metres) where known and a colour that shows it,
from teal (well supported by touches) to yellow; element ``face`` with triangles. Equal meshes make
equal bytes. As read: any precision and order of properties, text or binary.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from plyfile import PlyData, PlyElement

from lis_grasp.exceptions import InvalidFileError, InvalidMeshError
from lis_grasp.io.atomic_writing import write_bytes
from lis_grasp.io.ply_reading import read_ply
from lis_grasp.typing import FloatArray

_SUPPORTED, _UNSUPPORTED = np.array([38.0, 130.0, 142.0]), np.array([253.0, 231.0, 37.0])

# Colours end where all but this part of the vertices has been told apart.
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
        Lines that say what made the surface; they become comments of the file.

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
    content = _ply_bytes(mesh, header)
    write_bytes(path, content)


def load_surface(path: Path | str) -> trimesh.Trimesh:
    """Read a surface from a .ply file, as `save_surface` writes it or another program's.

    Returns
    -------
    trimesh.Trimesh
        In O [m], vertices and triangles in the file's order, nothing merged;
        `vertex_attributes["uncertainty"]` where the file has it, `metadata["header"]` the file's
        comments.

    Raises
    ------
    InvalidFileError
        If the file is missing, damaged, of another format, or not a triangle mesh.
    """
    path = Path(path)
    _require_ply(path)
    data = read_ply(path)
    elements = {element.name: element for element in data.elements}
    vertices = _columns(path, elements.get("vertex"), ("x", "y", "z"))
    faces = _triangles(path, elements.get("face"), len(vertices))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.metadata["header"] = "\n".join(data.comments)
    if "uncertainty" in elements["vertex"].data.dtype.names:
        column = _columns(path, elements["vertex"], ("uncertainty",), finite=False)
        if (column < 0.0).any():
            raise InvalidFileError(f"{path}: uncertainty must not be negative; some is")
        mesh.vertex_attributes["uncertainty"] = column[:, 0]
    return mesh


def _require_ply(path: Path) -> None:
    if path.suffix.lower() != ".ply":
        raise InvalidFileError(f"surfaces are kept in .ply files; {path} is not one")


def _ply_bytes(mesh: trimesh.Trimesh, header: str) -> bytes:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if not len(mesh.faces) or not np.isfinite(vertices).all():
        raise InvalidMeshError(
            f"a surface to save needs triangles and finite vertices; this one has {len(mesh.faces)}"
            f" triangles and {np.count_nonzero(~np.isfinite(vertices).all(axis=1))} such vertices"
        )
    fields: list[tuple[str, npt.NDArray]] = list(zip("xyz", vertices.T, strict=True))
    uncertainty = mesh.vertex_attributes.get("uncertainty")
    if uncertainty is not None:
        uncertainty = np.asarray(uncertainty, dtype=np.float64)
        if uncertainty.shape != (len(vertices),):
            raise InvalidMeshError(
                f"uncertainty must be one number for each of {len(vertices)} vertices; it has shape"
                f" {uncertainty.shape}"
            )
        fields.append(("uncertainty", uncertainty))
        fields += zip(("red", "green", "blue"), _colours(uncertainty).T, strict=True)
    rows = np.empty(len(vertices), dtype=[(name, column.dtype.str) for name, column in fields])
    for name, column in fields:
        rows[name] = column
    triangles = np.empty(len(mesh.faces), dtype=[("vertex_indices", "<i4", (3,))])
    triangles["vertex_indices"] = mesh.faces
    elements = [PlyElement.describe(rows, "vertex"), PlyElement.describe(triangles, "face")]
    lines = [line.rstrip() for line in header.splitlines() if line.strip()]
    comments = [line.encode("ascii", "backslashreplace").decode() for line in lines]
    file = io.BytesIO()
    PlyData(elements, byte_order="<", comments=comments).write(file)
    return file.getvalue()


def _colours(uncertainty: FloatArray) -> npt.NDArray[np.uint8]:
    """Return a colour for each uncertainty, shape (V, 3)."""
    known = uncertainty[np.isfinite(uncertainty)]
    end = float(np.quantile(known, _SHOWN)) if len(known) else 0.0
    part = np.where(uncertainty <= end, np.clip(uncertainty, 0.0, end) / (end or 1.0), 1.0)
    return np.rint(_SUPPORTED + part[:, None] * (_UNSUPPORTED - _SUPPORTED)).astype(np.uint8)


def _columns(
    path: Path, element: PlyElement | None, names: tuple[str, ...], *, finite: bool = True
) -> FloatArray:
    if element is None or any(name not in element.data.dtype.names for name in names):
        raise InvalidFileError(f"{path} has no {' '.join(names)} for its vertices")
    try:
        columns = np.stack([element.data[n].astype(np.float64) for n in names], axis=1)
    except (TypeError, ValueError):
        raise InvalidFileError(f"{path}: {' '.join(names)} must be numbers") from None
    if np.isnan(columns).any() or (finite and not np.isfinite(columns).all()):
        raise InvalidFileError(f"{path}: {' '.join(names)} must be finite; some are not")
    return columns


def _triangles(path: Path, element: PlyElement | None, vertices: int) -> npt.NDArray[np.int64]:
    rows = None if element is None or not len(element.data) else element.data
    names = ("vertex_indices", "vertex_index")
    name = next((n for n in names if rows is not None and n in rows.dtype.names), None)
    if rows is None or name is None:
        raise InvalidFileError(f"{path} has no faces: a surface is needed, not a point cloud")
    lists = rows[name]
    if any(len(row) != 3 for row in lists):
        raise InvalidFileError(f"{path} must have triangles only; some face has another count")
    faces = np.array(lists.tolist(), dtype=np.int64).reshape(-1, 3)
    if faces.min() < 0 or faces.max() >= vertices:
        raise InvalidFileError(f"{path}: a face names a vertex beyond the {vertices} there are")
    return faces
