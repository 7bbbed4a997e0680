"""Resolution of the file paths and package:// URIs in a hand's files."""

from __future__ import annotations

import os
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError, shown


def resolve_uri(uri: str, folder: Path, named_in: str) -> Path:
    """Return the file that a path or URI in another file means.

    A plain path is relative to `folder`. ``package://NAME/...`` is searched in a folder NAME above
    it, in `folder` itself, and in ``ROS_PACKAGE_PATH``: in its folders NAME, and in folders NAME
    inside its folders. Raises `InvalidFileError`, which says where the file was searched.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        candidates = [folder / uri]
    elif scheme == "file":
        candidates = [Path(rest)]
    elif scheme == "package":
        package, _, inside = rest.partition("/")
        if ".." in Path(inside).parts:
            raise InvalidFileError(f"{named_in}: {uri} must not lead out of its package")
        here = folder.resolve()
        above = [parent / inside for parent in (here, *here.parents) if parent.name == package]
        roots = [Path(r) for r in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if r]
        listed = [root / package / inside for root in roots]
        listed += [root / inside for root in roots if root.name == package]
        candidates = [*above, folder / inside, *listed]
    else:
        raise InvalidFileError(f"{named_in}: files are named by path or package:// URI, not {uri}")
    for candidate in candidates:
        try:
            if candidate.is_file():
                return candidate
        except (OSError, ValueError) as error:  # no name that a file can have
            raise InvalidFileError(f"{named_in}: {shown(uri)} is no file: {error}") from None
    tried = ", ".join(str(candidate) for candidate in candidates)
    raise InvalidFileError(
        f"{named_in}: {uri} was not found; tried {tried}: a package's folder may be listed in"
        " ROS_PACKAGE_PATH"
    )
