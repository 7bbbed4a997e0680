"""Studies as YAML files, and where the files are that they name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.experiments.study.keys import HAND_SUFFIXES, located
from lis_grasp.shapes import FORMATS


def load_study(path: Path, meshes: Path | None = None) -> dict[str, Any]:
    """Read the facts of a study from a YAML file, for `Study.from_facts`.

    Parameters
    ----------
    path
        Of the file; files that it names are found from its folder.
    meshes
        Where mesh files are, if not there.

    Raises
    ------
    InvalidFileError
        If it cannot be read, or is no mapping.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidFileError(f"cannot read {path}: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InvalidFileError(f"{path} must be a YAML file; it is not: {reason}") from None
    if not isinstance(content, dict):
        raise InvalidFileError(
            f"{path} must hold keys and values, such as 'objects: [box, sphere]'; it holds"
            f" {type(content).__name__}"
        )
    return with_places(content, path.parent, meshes)


def with_places(facts: dict[str, Any], folder: Path, meshes: Path | None = None) -> dict[str, Any]:
    """Return the facts of a study in which files have absolute paths.

    Parameters
    ----------
    facts
        Of the study; what is no list of names stays, and is refused later.
    folder
        Where relative paths start.
    meshes
        Where those of meshes start; None for the same.
    """
    places = {"objects": (meshes or folder, FORMATS), "hands": (folder, HAND_SUFFIXES)}
    found = dict(facts)
    for name, (start, suffixes) in places.items():
        names = found.get(name)
        if isinstance(names, list) and all(isinstance(item, str) for item in names):
            found[name] = located(names, start, suffixes=suffixes)
    return found
