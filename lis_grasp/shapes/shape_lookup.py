"""Look-up of an object by a built-in name or a mesh file."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.shapes.builtin import BUILDERS, NAMES, build
from lis_grasp.shapes.mesh_loading import FORMATS, load
from lis_grasp.shapes.shape import Shape


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
        close = difflib.get_close_matches(str(name_or_path), NAMES, n=1)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        raise InvalidOptionError(
            f"'{name_or_path}' is neither a built-in shape ({', '.join(NAMES)}) nor a mesh"
            f" file{hint}",
            option="object",
            value=str(name_or_path),
        )
    if size is not None:
        raise InvalidOptionError(
            f"size is for built-in shapes; the file {path} has its own: give its --units instead",
            option="size",
            value=size,
        )
    if path.suffix.lower() not in FORMATS and not path.is_file():
        raise InvalidFileError(
            f"{path} is a folder; a mesh file is needed ({', '.join(FORMATS)})", path=path
        )
    return load(path, units)
