"""Rows of a study: a file of JSON lines while it runs, and one Parquet file at the end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import Field, create_model

from lis_grasp import version
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError, shown
from lis_grasp.io.json_lines import Row
from lis_grasp.io.schemas import FileRecord, Number, checked
from lis_grasp.robots.shipped_models import READY_HANDS
from lis_grasp_studies.harness.parquet import read_parquet, write_parquet
from lis_grasp_studies.harness.rows import Job, TrialResults, missing_jobs
from lis_grasp_studies.study.columns import COLUMNS, MACHINE, TIMES
from lis_grasp_studies.study.study import Study
from lis_grasp_studies.study.trial import (
    OBJECT_NAMES,
    SETTINGS,
    TRIAL_COLUMNS,
    Setup,
    Trial,
    columns_of,
    label,
    row_key,
)

_TYPES: dict[type, str] = {
    int: "touches seed grasps attempts closings executed contacts triangles grasps_found"
    " candidates",
    bool: "edged watertight lifted held",
    str: "key object object_digest hand noise estimator prober explorer policy units"
    f" conditions version {MACHINE} contacts_digest family rejections reason failure",
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

_MADE_AGAIN = "remove it, and its rows are made again"


@dataclass(frozen=True, slots=True)
class StudyResults:
    """The rows of a study in a folder: ``rows.jsonl``, which grows, and ``rows.parquet``.

    A row's key is a hash of everything that decides its content, so that no row is made twice and
    a killed study can be continued, also from ``rows.parquet`` alone. The folder need not exist.
    """

    folder: Path

    @property
    def lines(self) -> TrialResults:
        """The file of rows that grows."""
        return TrialResults(self.folder / "rows.jsonl", "study")

    @property
    def merged(self) -> Path:
        """The Parquet file of all rows."""
        return self.folder / "rows.parquet"

    def write_merged(self) -> Path:
        """Write all rows as one file, ``rows.parquet``, and return its path."""
        write_parquet(self.merged, self.read())
        return self.merged

    def read(self, *, any_version: bool = False) -> list[Row]:
        """Return all rows, ordered by key, by default of this version of the package only.

        Raises `InvalidFileError` if a file cannot be read, or is of another version.
        """
        merged = read_parquet(self.merged, _MADE_AGAIN) if self.merged.is_file() else []
        for row in merged:
            if not any_version and row.get("version") != version.__version__:
                raise InvalidFileError(
                    f"{self.merged} must be of lis_grasp {version.__version__}; it is of"
                    f" {row.get('version')}: write to another folder, or remove this file",
                    path=self.merged,
                )
        rows = [*self.lines.read(any_version=any_version), *merged]
        # Rows of other versions may have other columns.
        schema = RowKey if any_version else StudyRow
        for row in rows:
            checked(schema, row, self.folder, f"row {shown(row.get('key', ''))}")
        found = {row["key"]: row for row in rows}
        return [found[key] for key in sorted(found)]

    def row(self, key: str) -> Row:
        """Return the row of a key, or of the beginning of one.

        Raises `InvalidOptionError` if there is none, or more than one.
        """
        found = [row for row in self.read() if row["key"].startswith(key)]
        if len(found) != 1:
            raise InvalidOptionError(
                f"the key must identify one row of {self.folder}; '{key}' fits {len(found)} rows:"
                " take one from the column 'key' of rows.csv",
                option="rerun",
                value=key,
            )
        return found[0]

    def missing(self, study: Study) -> list[Job]:
        """Return the jobs of a study that lack rows, in its order; errors as of `read`.

        The study's files must be there.
        """
        known = {row["key"] for row in self.read()}
        return missing_jobs(study.trials(), study.estimators, known, row_key)

    def of(self, study: Study) -> list[Row]:
        """Return the rows of a study that exist, in its order."""
        found = {row["key"]: row for row in self.read()}
        keys = [row_key(*pair) for pair in product(study.trials(), study.estimators)]
        return [found[key] for key in keys if key in found]

    def alike(self, study: Study) -> list[Row]:
        """Return the rows that a study names, in its order, without opening any mesh.

        Rows may be of another version.

        Raises `InvalidFileError` if rows are of different files of one name.
        """
        order = {
            (*columns_of(trial).values(), name): number
            for number, (trial, name) in enumerate(product(study.trials(), study.estimators))
        }
        setup, default = asdict(study.setup), asdict(Setup())
        found: dict[int, Row] = {}
        for row in self.read(any_version=True):
            place = order.get(_place_of(row, self.folder))
            if place is None or default | _settings(row) != setup:
                continue
            if place in found:
                raise InvalidFileError(
                    f"{self.folder} must have one row of each trial; it has two of"
                    f" {row['object']} and {row['hand']}, of different files: write them to"
                    " different folders",
                    path=self.folder,
                )
            found[place] = row
        return [found[place] for place in sorted(found)]


def job_of(row: Row, files: Iterable[str] = ()) -> Job:
    """Return the job that makes a recorded row again.

    `files` are paths of objects and hands: rows have only the names of the files.

    Raises `InvalidOptionError` if the file of the row's object or hand is not among them, or has
    changed.
    """
    places = {label(path): path for path in files}
    named = {name: row[name] for name in TRIAL_COLUMNS}
    for what, known in (("object", OBJECT_NAMES), ("hand", READY_HANDS)):
        if named[what] not in known:
            if named[what] not in places:
                raise InvalidOptionError(
                    f"the row needs the file {named[what]}, which the study in this folder does"
                    " not name: give it in study.yaml, or its folder by --meshes",
                    option="meshes",
                    value=named[what],
                )
            named[what] = places[named[what]]
    trial = Trial(**named, setup=Setup(**_settings(row)))
    if row_key(trial, row["estimator"]) != row["key"]:
        raise InvalidOptionError(
            f"the files of row {row['key']} must be those that it was made of; {row['object']} or"
            f" {row['hand']} has changed since",
            option="rerun",
            value=row["key"],
        )
    return Job(trial, (row["estimator"],))


def _place_of(row: Row, folder: Path) -> tuple[Any, ...]:
    """Return the columns of a row that identify it within a study."""
    place = tuple(row.get(name) for name in (*TRIAL_COLUMNS, "estimator"))
    if any(isinstance(value, list | dict) for value in place):
        raise InvalidFileError(
            f"{folder} must have rows with text and numbers; row {row['key']} has a list or a"
            " mapping in a column of its trial: restore its file from a copy",
            path=folder,
        )
    return place


def _settings(row: Row) -> Row:
    """Return the settings that a row names; others have their defaults, as in its version."""
    return {name: row[name] for name in SETTINGS if row.get(name) is not None}


def without_times(row: Row) -> Row:
    """Return what equal trials have in common: all columns but times and versions."""
    return {name: value for name, value in row.items() if name not in (*TIMES, MACHINE)}
