"""Resolution of the file paths and package:// URIs in a hand's files."""

from __future__ import annotations

import glob
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

from lis_grasp.exceptions import InvalidFileError, listed

LISTS = ("LIS_GRASP_MODELS", "ROS_PACKAGE_PATH")
"""Environment variables that list folders with packages of models."""

_DEPTH = 4  # folders above a file in which the root of its package may be
_BELOW = 3  # folders below a listed one in which a package may be
# xacro's $(find NAME) is the folder of a package, and SDF's models are found like packages.
_PACKAGE = re.compile(
    r"((package|model)://(?P<name>[^/]+)|\$\(find\s+(?P<found>[^)]+?)\s*\))/*(?P<inside>.*)",
    re.DOTALL,
)


def resolve_uri(uri: str | None, folder: Path, named_in: str) -> Path:
    """Return the file that a path or URI in another file means.

    A plain path, or one after ``file:``, is relative to `folder`. ``package://NAME/...``,
    ``model://NAME/...`` and ``$(find NAME)/...`` are searched in a folder NAME above it, in
    `folder` itself, in the folders of `package_folders`, and in NAME below the folders above. A
    name with ``%20`` or backslashes is also tried as the name that they stand for. Raises
    `InvalidFileError`, which says where the file was searched, or what is there instead.
    """
    if not uri:
        raise InvalidFileError(f"{named_in}: each mesh must name its file; one does not")
    spellings = dict.fromkeys((uri, unquote(uri), unquote(uri).replace("\\", "/")))
    try:
        candidates = [path for text in spellings for path in _candidates(text, folder, named_in)]
        for candidate in candidates:
            if candidate.is_file():
                return candidate
        raise InvalidFileError(f"{named_in}: {_not_found(uri, candidates, folder)}")
    except (OSError, ValueError) as error:  # no name that a file can have
        reason = getattr(error, "strerror", None) or error
        raise InvalidFileError(f"{named_in}: there is no file, since {reason}: {uri}") from None


def _candidates(uri: str, folder: Path, named_in: str) -> list[Path]:
    """Return the places of a file in the order of the search."""
    package = _PACKAGE.match(uri)
    if package is None:
        scheme, separator, rest = uri.partition("://")
        if separator and scheme != "file":
            raise InvalidFileError(
                f"{named_in}: files are named by path, package:// or model:// URI, not {uri}"
            )
        return [folder / (rest if separator else uri.removeprefix("file:"))]
    name, inside = package["found"] or package["name"], package["inside"]
    if ".." in Path(inside).parts:
        raise InvalidFileError(f"{named_in}: {uri} must not lead out of its package")
    here = folder.resolve()
    above = [here, *here.parents]
    near, below = above[:_DEPTH], f"*/{glob.escape(name)}"
    return [
        *(parent / inside for parent in above if parent.name == name),
        folder / inside,
        *(root / inside for root in package_folders(name)),
        # Where a package's folder was renamed, its files are still at the same place in it.
        *(parent / inside for parent in near[1:]),
        # Some files name a folder beside them, or in one beside them, as if it were a package.
        *(parent / name / inside for parent in near),
        *(root / inside for parent in near for root in sorted(parent.glob(below))),
    ]


def _not_found(uri: str, candidates: Sequence[Path], folder: Path) -> str:
    candidates = [Path(os.path.abspath(candidate)) for candidate in candidates]
    for candidate in candidates:
        if candidate.is_dir():
            return f"{candidate} is a folder, and a file is needed"
        other = _in_other_case(candidate)
        if other is not None:
            return f"{uri} was not found, but there is {other}: capitals and small letters matter"
    package = _PACKAGE.match(uri)
    if package is None:
        return f"{candidates[0]} was not found: copy it there, or correct the path {uri}"
    name = package["found"] or package["name"]
    here = folder.resolve()
    roots = [p for p in (here, *here.parents) if p.name == name] + package_folders(name)
    if not any(root.is_dir() for root in roots):
        return (
            f"{uri} was not found, since no folder '{name}' is above {here} or in a listed one:"
            f" list the folder that holds '{name}' in {' or '.join(LISTS)}"
        )
    tried = listed([*dict.fromkeys(str(candidate) for candidate in candidates)])
    return (
        f"{uri} was not found; tried {tried}: folders that hold packages are listed in"
        f" {' or '.join(LISTS)}"
    )


def _in_other_case(path: Path) -> Path | None:
    """Return a file that is there and differs from a path in capital and small letters only."""
    found = Path(path.anchor)
    for part in path.parts[len(found.parts) :]:
        if not (found / part).exists():
            alike = [f for f in found.glob("*") if f.name.lower() == part.lower()]
            if not alike:
                return None
            part = min(alike).name
        found /= part
    return found if found.is_file() else None


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
    roots = [Path(root) for name in LISTS for root in _listed(name)]
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
        # Not Path.home(), which raises where the user has no home folder.
        cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
        manifests = sorted((cache / "drake" / "package_map").glob("**/package.xml"))
        folders += [m.parent for m in manifests if "<name>drake_models<" in m.read_text("utf-8")]
    present = (folder for folder in folders if folder.is_dir())
    return list(dict.fromkeys(present)) or folders[: len(roots)]


def _listed(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
