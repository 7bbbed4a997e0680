"""Find the files that a hand's files name, by path or by package:// URI."""

from __future__ import annotations

import os
from pathlib import Path

from lis_grasp.exceptions import InvalidFileError, shown


def resolve_uri(uri: str, folder: Path, named_in: str) -> Path:
    """Find a file that another one names.

    A plain path counts from `folder`; ``package://NAME/...`` is looked for in a folder NAME above
    it, in `folder` itself, and in folders NAME beside those of ``ROS_PACKAGE_PATH`` (a copy of
    drake_models, for example).

    Raises
    ------
    InvalidFileError
        If there is no such file, and where it was looked for; or if the URI leads out of its
        package.
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
        above = [parent / inside for parent in _upwards(folder) if parent.name == package]
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
        f"{named_in}: {uri} was not found; looked at {tried}: a package's folder may be listed in"
        " ROS_PACKAGE_PATH"
    )


def _upwards(folder: Path) -> list[Path]:
    resolved = folder.resolve()
    return [resolved, *resolved.parents]
