"""Types of the columns of a study's rows."""

from __future__ import annotations

from pydantic import Field, create_model

from lis_grasp.io.schemas import FileRecord, Number
from lis_grasp_studies.study.study_trial import COLUMNS, MACHINE, TIMES

_TYPES: dict[type, str] = {
    int: "touches seed grasps contacts triangles grasps_found candidates",
    bool: "edged watertight lifted held",
    str: "key object object_digest hand noise estimator prober explorer policy units"
    f" conditions version {MACHINE} contacts_digest rejections reason failure",
}


def column_type(name: str) -> type:
    """Return the type of a column's values; each may also be None."""
    return next((kind for kind, names in _TYPES.items() if name in names.split()), float)


class RowKey(FileRecord):
    """What a row has in every version."""

    key: str = Field(min_length=1)


_Columns = {
    name: (Number if (kind := column_type(name)) is float else kind)
    for name in COLUMNS
    if name != "key"
}

StudyRow = create_model(
    "StudyRow",
    __base__=RowKey,
    **{  # type: ignore[call-overload]
        name: (kind | None, None if name in TIMES else ...) for name, kind in _Columns.items()
    },
)
"""A row of this version: all columns but times, each of its type or None."""
