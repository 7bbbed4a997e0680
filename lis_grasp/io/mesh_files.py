"""Mesh files: reading by trimesh within limits, with one error for everything that it refuses."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import trimesh

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.file_limits import MEBIBYTE, require_file_size
from lis_grasp.io.gltf_limits import require_small_gltf

_MOST_BYTES = 512 * MEBIBYTE
_LFS = b"version https://git-lfs.github.com/spec"
_LONGEST_DETAIL = 120


def read_mesh(
    path: Path, formats: Sequence[str], *, merge: bool = False, materials: bool = False
) -> trimesh.Trimesh:
    """Return everything in a mesh file as one mesh, in its units and frame.

    Parameters
    ----------
    path
        Of the file.
    formats
        Permitted endings, such as ``.stl``.
    merge
        Whether equal vertices are merged.
    materials
        Whether colours and textures are read too.

    Raises
    ------
    InvalidFileError
        If the file is missing, empty, of another format, larger than 512 MiB, or damaged, or a
        glTF announces more than `gltf_limits.MOST_ELEMENTS`.
    """
    ending = path.suffix.lower()
    if ending not in formats:
        raise InvalidFileError(
            f"{path} must end in one of {', '.join(formats)}; convert other formats, for example"
            " with MeshLab",
            path=path,
        )
    if not os.path.isfile(path):
        raise InvalidFileError(f"{path} is missing, or is no file: check the path", path=path)
    try:
        require_file_size(path, _MOST_BYTES)
        with path.open("rb") as content:
            start = content.read(len(_LFS))
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}", path=path) from None
    if not start:
        raise InvalidFileError(f"{path} is empty: export it again", path=path)
    if start == _LFS:
        raise InvalidFileError(
            f"{path} must be a mesh; it is the pointer of Git LFS to one: run `git lfs pull` in its"
            " repository",
            path=path,
        )
    try:
        if ending in (".gltf", ".glb"):
            require_small_gltf(path)
        with warnings.catch_warnings():
            # Warnings about textures and colours do not matter here.
            warnings.simplefilter("ignore")
            mesh = trimesh.load_scene(
                str(path), file_type=ending[1:], process=merge, skip_materials=not materials
            ).to_mesh()
        for array in (mesh.vertices, mesh.faces):
            if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
                raise ValueError("its rows are not of three numbers")
        return mesh
    except InvalidFileError:
        raise
    # On files of another format trimesh's readers raise errors of a dozen built-in types.
    except Exception as error:  # noqa: BLE001
        detail = "its content is damaged"
        if isinstance(error, ValueError | OSError | NotImplementedError):
            detail = " ".join(str(error).split())[:_LONGEST_DETAIL] or detail
        raise InvalidFileError(
            f"{path} cannot be read as {ending[1:].upper()} ({detail}): export it again",
            path=path,
        ) from None
