"""Mesh files: reading by trimesh within limits, with one error for everything that it refuses."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import trimesh

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.limits import MEBIBYTE, reading, require_small_gltf

_MOST_BYTES = 512 * MEBIBYTE
_LFS = b"version https://git-lfs.github.com/spec"


def read_mesh(
    path: Path, formats: Sequence[str], *, merge: bool = False, materials: bool = False
) -> trimesh.Trimesh:
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
        Whether colours and textures are read too.

    Raises
    ------
    InvalidFileError
        If the file is missing, empty, of another format, larger than 512 MiB, or damaged, or a
        glTF announces more than `limits.MOST_ELEMENTS`.
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
    with reading(path, ending[1:].upper(), most=_MOST_BYTES, advice="export it again"):
        with path.open("rb") as content:
            start = content.read(len(_LFS))
        if not start:
            raise ValueError("it is empty")
        if start == _LFS:
            raise InvalidFileError(
                f"{path} must be a mesh; it is the pointer of Git LFS to one: run `git lfs pull` in"
                " its repository",
                path=path,
            )
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
