"""Rows of a study: one small Parquet file each as they come, one for all in the end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import lis_grasp
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.experiments.study.keys import columns_of, label, row_key
from lis_grasp.experiments.study.study import TRIAL_COLUMNS, Setup, Study, Trial
from lis_grasp.experiments.study.study_trial import MACHINE, TIMES, Job
from lis_grasp.hands.shipped_models import HAND_NAMES
from lis_grasp.io.atomic_writing import whole_file
from lis_grasp.io.json_lines import Row
from lis_grasp.shapes import NAMES

_PARTS = "rows"


@dataclass(frozen=True, slots=True)
class StudyResults:
    """The rows of a study in a folder: ``rows/<key>.parquet``, each written whole or not at all.

    A row's key is a hash of all that decides what is in it, so that whoever writes a row writes the
    same file, nothing is done twice, and a killed study goes on where it was. ``rows.parquet`` has
    all rows in one file; where there is nothing but that file, on another machine say, a study
    goes on from it.

    Parameters
    ----------
    folder
        Of the study; need not exist.
    """

    folder: Path

    def write(self, rows: Iterable[Row]) -> None:
        """Add rows, on the disk when this returns.

        Raises
        ------
        InvalidFileError
            If a row is of another version of the package, as a worker elsewhere may make it.
        """
        for row in rows:
            if row["version"] != lis_grasp.__version__:
                raise InvalidFileError(
                    f"rows must be of lis_grasp {lis_grasp.__version__}; a worker made one of"
                    f" {row['version']}: give all workers the same version"
                )
            self._write(self.folder / _PARTS / f"{row['key']}.parquet", [row])

    def write_merged(self) -> Path:
        """Write all rows that there are as one file, ``rows.parquet``, and return its path."""
        self._write(self._merged, self.read())
        return self._merged

    def keys(self) -> set[str]:
        """Return the keys of the rows that there are."""
        return {*self._parts(), *self._merged_keys()}

    def read(self, keys: Iterable[str] | None = None, *, any_version: bool = False) -> list[Row]:
        """Return rows, all or those of the keys given that there are, ordered by key.

        Parameters
        ----------
        keys
            Of the rows wanted; None for all.
        any_version
            Whether rows may be of another version of the package; to go on with a study they must
            not.

        Raises
        ------
        InvalidFileError
            If a file cannot be read, or is of another version.
        """
        merged = self._read(self._merged, any_version) if self._merged.is_file() else []
        found = {row["key"]: row for row in merged}
        wanted = self.keys() if keys is None else set(keys)
        for key, path in self._parts().items():
            if key in wanted and key not in found:
                (found[key],) = self._read(path, any_version)
        return [found[key] for key in sorted(wanted & found.keys())]

    def row(self, key: str) -> Row:
        """Return the row of a key, or of the beginning of one.

        Raises
        ------
        InvalidOptionError
            If there is none, or more than one.
        """
        found = [name for name in self.keys() if name.startswith(key)]
        if len(found) != 1:
            raise InvalidOptionError(
                f"a key must name one row of {self.folder}; '{key}' names {len(found)}: take it"
                " from the column 'key' of rows.csv"
            )
        return self.read(found)[0]

    def missing(self, study: Study) -> list[Job]:
        """Return what of a study there is to do, in its order; its files must be there.

        Raises
        ------
        InvalidFileError
            If a row cannot be read, or is of another version: better now than after the work.
        """
        known = {row["key"] for row in self.read()}
        jobs = []
        for trial in study.trials():
            names = tuple(
                name for name in study.estimators if row_key(trial, study.setup, name) not in known
            )
            if names:
                jobs.append(Job(trial, study.setup, names))
        return jobs

    def of(self, study: Study) -> list[Row]:
        """Return the rows of a study that there are, in its order."""
        order = [
            row_key(trial, study.setup, name)
            for trial in study.trials()
            for name in study.estimators
        ]
        found = {row["key"]: row for row in self.read(order)}
        return [found[key] for key in order if key in found]

    def alike(self, study: Study) -> list[Row]:
        """Return the rows that a study names, in its order, without looking at any mesh.

        Rows may be of another version.

        Raises
        ------
        InvalidFileError
            If rows are of different files of one name.
        """
        order = {
            (*columns_of(trial).values(), name): number
            for number, (trial, name) in enumerate(product(study.trials(), study.estimators))
        }
        places = (*TRIAL_COLUMNS, "estimator")
        setup = asdict(study.setup)
        found: dict[int, Row] = {}
        for row in self.read(any_version=True):
            place = order.get(tuple(row.get(name) for name in places))  # type: ignore[arg-type]
            if place is None or any(row.get(name) != value for name, value in setup.items()):
                continue
            if place in found:
                raise InvalidFileError(
                    f"{self.folder} must have one row of each trial; it has two of"
                    f" {row['object']} and {row['hand']}, of different files: write them to"
                    " different folders"
                )
            found[place] = row
        return [found[place] for place in sorted(found)]

    @property
    def _merged(self) -> Path:
        return self.folder / "rows.parquet"

    def _merged_keys(self) -> list[str]:
        if not self._merged.is_file():
            return []
        return [row["key"] for row in _table(self._merged, ["key"])]

    def _parts(self) -> dict[str, Path]:
        """Return the file of each row that has one of its own, in the order of their keys."""
        paths = sorted((self.folder / _PARTS).glob("*.parquet"))
        return {path.stem: path for path in paths if not path.name.startswith(".")}

    def _write(self, path: Path, rows: Sequence[Row]) -> None:
        arrow, parquet = _pyarrow()
        table = arrow.Table.from_pylist(list(rows), schema=_schema(arrow))
        with whole_file(path) as temporary:
            parquet.write_table(table, temporary, compression="zstd")

    def _read(self, path: Path, any_version: bool) -> list[Row]:
        rows = _table(path)
        for row in rows:
            if not any_version and row.get("version") != lis_grasp.__version__:
                raise InvalidFileError(
                    f"{path} must be of lis_grasp {lis_grasp.__version__}; it is of"
                    f" {row.get('version')}: write to another folder, or remove this one"
                )
        return rows


def job_of(row: Row, files: Iterable[str] = ()) -> Job:
    """Return the job that makes a row again.

    Parameters
    ----------
    row
        As it was recorded.
    files
        Paths of objects and hands; rows have nothing but the files' names.

    Raises
    ------
    InvalidOptionError
        If the file of the row's object or hand is not among them, or has changed.
    """
    places = {label(path): path for path in files}
    named = {name: row[name] for name in TRIAL_COLUMNS}
    for what, known in (("object", NAMES), ("hand", HAND_NAMES)):
        if named[what] not in known:
            if named[what] not in places:
                raise InvalidOptionError(
                    f"the row is of the file {named[what]}, which the study in this folder does"
                    " not name: give it in study.yaml, or its folder by --meshes"
                )
            named[what] = places[named[what]]
    trial = Trial(**named)
    setup = Setup(**{name: row[name] for name in Setup.__dataclass_fields__})
    if row_key(trial, setup, row["estimator"]) != row["key"]:
        raise InvalidOptionError(
            f"the files of row {row['key']} must be those that it was made of; {row['object']} or"
            f" {row['hand']} has changed since"
        )
    return Job(trial, setup, (row["estimator"],))


def without_times(row: Row) -> Row:
    """Return what equal trials have in common: all but times and what machine it was."""
    return {name: value for name, value in row.items() if name not in (*TIMES, MACHINE)}


def _schema(arrow: ModuleType) -> Any:
    """Return the types of all columns, so that part files agree where a value is missing."""
    whole, number, yes_no = arrow.int64(), arrow.float64(), arrow.bool_()
    types = {
        **dict.fromkeys(("touches", "seed", "grasps", "contacts", "triangles"), whole),
        **dict.fromkeys(("grasps_found", "candidates"), whole),
        **dict.fromkeys(("edged", "watertight", "lifted", "held"), yes_no),
        **dict.fromkeys(_TEXTS, arrow.string()),
    }
    return arrow.schema([(name, types.get(name, number)) for name in COLUMNS])


_TEXTS = (
    *(
        "key",
        "object",
        "object_digest",
        "hand",
        "noise",
        "estimator",
        "prober",
        "explorer",
        "policy",
        "units",
        "version",
    ),
    *(MACHINE, "contacts_digest", "rejections", "reason", "failure"),
)

COLUMNS = (
    *("key", "object", "object_digest", "edged", "hand", "touches", "noise", "seed", "estimator"),
    *("held", "lifted", "reason", "slip", "acceleration_survived"),
    *("epsilon_estimate", "epsilon_truth", "epsilon_gap"),
    *("closure_probability", "success_probability"),
    *("grasps_found", "candidates", "rejections"),
    *("rmsd", "rmsd_truth_to_estimate", "edge_rmsd", "hausdorff_95", "chamfer"),
    *("f_score_1mm", "f_score_2mm", "f_score_5mm", "iou", "normal_error", "coverage"),
    *("explored_radius", "triangles", "watertight", "contacts", "contacts_digest", "failure"),
    *Setup.__dataclass_fields__,
    *("version", MACHINE, *TIMES),
)
"""Columns of the files of results, in their order; lengths in metres, times in seconds."""


def _table(path: Path, columns: list[str] | None = None) -> list[Row]:
    arrow, parquet = _pyarrow()
    try:
        # ParquetFile and not read_table: a file alone, no data set around it.
        rows: list[Row] = parquet.ParquetFile(path).read(columns=columns).to_pylist()
    except (OSError, arrow.ArrowException, ValueError) as error:
        raise InvalidFileError(
            f"cannot read {path}: {error}; remove it, and it is made again"
        ) from None
    return rows


def _pyarrow() -> tuple[ModuleType, ModuleType]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise InvalidOptionError(
            "studies keep their rows in Parquet files, which needs pyarrow:"
            " pip install 'lis-grasp[study]'"
        ) from None
    return pyarrow, parquet
