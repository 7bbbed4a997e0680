"""Resolution of the file paths and package:// URIs in a hand's files."""

from __future__ import annotations

import glob
import os
import sys
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError, shown

_LISTS = ("LIS_GRASP_MODELS", "ROS_PACKAGE_PATH")
_DEPTH = 4  # folders above a file in which the root of its package may be
_BELOW = 3  # folders below a listed one in which a package may be


def resolve_uri(uri: str | None, folder: Path, named_in: str) -> Path:
    """Return the file that a path or URI in another file means; None if it names none there.

    A plain path is relative to `folder`. ``package://NAME/...`` is searched in a folder NAME above
    it, in `folder` itself, and in the folders of `package_folders`. Raises `InvalidFileError`,
    which says where the file was searched.
    """
    if not uri:
        raise InvalidFileError(f"{named_in}: each mesh must name its file; one does not")
    scheme, separator, rest = uri.partition("://")
    here = folder.resolve()
    if not separator:
        candidates = [folder / uri]
    elif scheme == "file":
        candidates = [Path(rest)]
    elif scheme == "package":
        package, _, inside = rest.partition("/")
        if ".." in Path(inside).parts:
            raise InvalidFileError(f"{named_in}: {uri} must not lead out of its package")
        above = [parent / inside for parent in (here, *here.parents) if parent.name == package]
        listed = [root / inside for root in package_folders(package)]
        # Where a package's folder was renamed, its files are still at the same place in it.
        renamed = [parent / inside for parent in (here, *here.parents)[:_DEPTH]]
        # Some files name a folder beside them as if it were a package.
        renamed += [parent / package / inside for parent in (here, *here.parents)[:_DEPTH]]
        candidates = [*above, folder / inside, *listed, *renamed[1:]]
    else:
        raise InvalidFileError(f"{named_in}: files are named by path or package:// URI, not {uri}")
    for candidate in candidates:
        try:
            if candidate.is_file():
                return candidate
        except (OSError, ValueError) as error:  # no name that a file can have
            raise InvalidFileError(f"{named_in}: {shown(uri)} is no file: {error}") from None
    if scheme == "package" and not (
        above or any(root.is_dir() for root in package_folders(package))
    ):
        raise InvalidFileError(
            f"{named_in}: {shown(uri)} was not found, since no folder '{package}' is above"
            f" {here} or in a listed one: list the folder that holds '{package}' in"
            f" {' or '.join(_LISTS)}"
        )
    if not separator:
        raise InvalidFileError(f"{named_in}: {shown(str(candidates[0]))} was not found")
    tried = ", ".join(str(candidate) for candidate in candidates)
    raise InvalidFileError(
        f"{named_in}: {uri} was not found; tried {tried}: folders that hold packages are listed in"
        f" {' or '.join(_LISTS)}"
    )


def resolve_model(uri: str, file: Path, model_from: str | None) -> Path:
    """Return the description that a YAML `file` names as its ``urdf``.

    Raises `InvalidFileError`, which begins with the file's name; where the model is missing it says
    how to get it, if the file does (`model_from`).
    """
    try:
        return resolve_uri(uri, file.parent, "urdf")
    except InvalidFileError as error:
        message = f"{file.name}: {error}"
        if model_from:
            message = f"{file.name} needs {uri}, which is not there: {model_from}"
        raise InvalidFileError(message) from None


def package_folders(package: str) -> list[Path]:
    """Return the folders in which a package of models may be.

    They are, in this order: folders in or of ``LIS_GRASP_MODELS`` and ``ROS_PACKAGE_PATH``,
    lists of folders as in ``PATH``, at most three folders deep, since a repository may hold several
    packages; the shares of ROS 2 workspaces (``AMENT_PREFIX_PATH``); an
    installed Python package of that name, or the data of one in ``share/NAME``; and the models that
    Drake downloaded.
    """
    roots = [Path(root) for name in _LISTS for root in _listed(name)]
    folders = [root / package for root in roots]
    folders += [root for root in roots if root.name == package]
    below = ["*/" * depth + glob.escape(package) for depth in range(1, _BELOW)]
    folders += sorted(found for root in roots for at in below for found in root.glob(at))
    folders += [Path(root) / "share" / package for root in _listed("AMENT_PREFIX_PATH")]
    places = [Path(place) for place in sys.path if place]
    folders += [place / package for place in places]
    shares = [place / "cmeel.prefix" / "share" for place in places]
    folders += [share / package for share in (*shares, Path(sys.prefix) / "share")]
    if package == "drake_models":
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        manifests = sorted((cache / "drake" / "package_map").glob("**/package.xml"))
        folders += [m.parent for m in manifests if "<name>drake_models<" in m.read_text("utf-8")]
    present = (folder for folder in folders if folder.is_dir())
    return list(dict.fromkeys(present)) or folders[: len(roots)]


def _listed(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
