"""Facts in the headers of files: a task's options, the support, and poses."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

from pydantic import Field, create_model

from lis_grasp.geometry import require_pose
from lis_grasp.io import provenance
from lis_grasp.io.option import options_of
from lis_grasp.io.schemas import Count, FileRecord, Number, Pose, checked
from lis_grasp.task.task import PARTS, Task, option_items, option_kind, task_options
from lis_grasp.typing import FloatArray
from lis_grasp.world.files import file_of

# Type in a file for each type of a task's options.
_IN_FILES: dict[Any, Any] = {
    str: Annotated[str, Field(min_length=1)],
    float: Number,
    int: Count,
    bool: bool,
}


def _in_file(name: str, hint: Any) -> Any:
    """Return the type of an option in a file; null is permitted where None is."""
    kind: Any
    if option_kind(name) is tuple:
        kind, parts = list[_IN_FILES[option_items(name)]], task_options()[name].metavar  # type: ignore[misc]
        if isinstance(parts, tuple):  # a name for each number
            kind = Annotated[kind, Field(min_length=len(parts), max_length=len(parts))]
    else:
        kind = _IN_FILES[option_kind(name)]
    return kind | None if type(None) in get_args(hint) else kind


# Only types are checked, and each fact may be absent. Ranges are checked where a fact is used.
RecordedFacts = create_model(  # type: ignore[call-overload]
    "RecordedFacts",
    __base__=FileRecord,
    version=(str | None, None),
    support_height=(Number, None),
    warnings=(list[str] | None, None),
    **dict.fromkeys(("turned", "left_out"), (list[Count] | None, None)),
    doubt_log_odds=(list[Number] | None, None),
    seen=(Count | None, None),  # number of views beside the file that belong to its contacts
    **dict.fromkeys(("X_WO", "X_WE", "X_EO", "X_EA", "X_FB"), (Pose | None, None)),
    **{
        name: (_in_file(name, hint), None)
        for record in (*PARTS.values(), Task)
        for name, hint in get_type_hints(record).items()
        if name in options_of(record)
    },
)
"""Facts by name: a task's options, the support, and the poses of object and arm."""


def read_facts(path: Path, *, usual: str = "contacts.ply") -> dict[str, Any]:
    """Return the facts in the header of an output file (`provenance.read`), `located`.

    Raises `InvalidFileError` if the file cannot be read, or a fact is not of its type.
    """
    return checked_facts(provenance.read(path, usual=usual), path)


def checked_facts(facts: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return the facts of a file, located; `InvalidFileError` if one is not of its type."""
    checked(RecordedFacts, facts, path, "header")
    return located(facts, path.parent)


def located(facts: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return facts with paths that lead to the recorded files from the present folder.

    Recorded paths start at the folder in which the run began. That is taken to be the present one,
    or else the nearest one around the results that has such a file.
    """
    around = (folder.absolute(), *folder.absolute().parents)

    def found(name: Any) -> Any:
        path = Path(str(name or ""))  # in a report, it may be of any type
        if not path.suffix or os.path.exists(file_of(path)):
            return name
        places = (str(outer / path) for outer in around if os.path.isfile(outer / file_of(path)))
        return next(places, name)

    for name in ("object", "cloud", "hand", "arm", "world"):
        if name in facts:
            facts = facts | {name: found(facts[name])}
    views = facts.get("views")
    return facts | {"views": [found(view) for view in views]} if isinstance(views, list) else facts


def recorded_base(options: Mapping[str, Any], recorded: Mapping[str, Any]) -> FloatArray | None:
    """Return the recorded pose of the arm's base (4, 4), unless another arm or base is given."""
    if options.get("arm") is not None or options.get("base") is not None:
        return None
    return None if "X_EA" not in recorded else require_pose("X_EA", recorded["X_EA"])
