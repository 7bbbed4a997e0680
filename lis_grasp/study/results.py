"""Rows of a study, one small Parquet file each, kept as they come and taken up again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import lis_grasp
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.output_files import whole_file
from lis_grasp.study.study import Setup, Study, Trial
from lis_grasp.study.trial import MACHINE, TIMES, Job, Row, row_key

_PARTS = "rows"


@dataclass(frozen=True, slots=True)
class StudyResults:
    """The rows of a study in a folder: ``rows/<key>.parquet``, each written whole or not at all.

    A row's key is a hash of all that decides what is in it, so that whoever writes a row writes the
    same file, nothing is done twice, and a killed study goes on where it was.

    Parameters
    ----------
    folder
        Of the study; need not exist.
    """

    folder: Path

    def write(self, rows: Iterable[Row]) -> None:
        """Add rows, on the disk when this returns."""
        for row in rows:
            self._write(self.folder / _PARTS / f"{row['key']}.parquet", [row])

    def write_merged(self, rows: Sequence[Row]) -> Path:
        """Write rows as one file, ``rows.parquet``, and return its path."""
        path = self.folder / "rows.parquet"
        self._write(path, rows)
        return path

    def keys(self) -> set[str]:
        """Return the keys of the rows that there are."""
        return {path.stem for path in self._parts()}

    def read(self, keys: Iterable[str] | None = None) -> list[Row]:
        """Return rows, all or those of the keys given that there are, ordered by key.

        Raises
        ------
        InvalidFileError
            If a file cannot be read, or is of another version.
        """
        wanted = None if keys is None else set(keys)
        return [self._read(p) for p in self._parts() if wanted is None or p.stem in wanted]

    def row(self, key: str) -> Row:
        """Return the row of a key, or of the beginning of one.

        Raises
        ------
        InvalidOptionError
            If there is none, or more than one.
        """
        found = [path for path in self._parts() if path.stem.startswith(key)]
        if len(found) != 1:
            raise InvalidOptionError(
                f"a key must name one row of {self.folder}; '{key}' names {len(found)}: take it"
                " from the column 'key' of rows.csv"
            )
        return self._read(found[0])

    def missing(self, study: Study) -> list[Job]:
        """Return what of a study there is to do, in its order."""
        known = self.keys()
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

    def _parts(self) -> list[Path]:
        return sorted(
            path
            for path in (self.folder / _PARTS).glob("*.parquet")
            if not path.name.startswith(".")
        )

    def _write(self, path: Path, rows: Sequence[Row]) -> None:
        arrow, parquet = _pyarrow()
        table = arrow.Table.from_pylist(list(rows), schema=_schema(arrow))
        with whole_file(path) as temporary:
            parquet.write_table(table, temporary)

    def _read(self, path: Path) -> Row:
        arrow, parquet = _pyarrow()
        try:
            # ParquetFile and not read_table: a file alone, no data set around it.
            row: Row = parquet.ParquetFile(path).read().to_pylist()[0]
        except (OSError, arrow.ArrowException, ValueError, IndexError) as error:
            raise InvalidFileError(
                f"cannot read {path}: {error}; remove it, and it is made again"
            ) from None
        if row.get("version") != lis_grasp.__version__:
            raise InvalidFileError(
                f"{path} must be of lis_grasp {lis_grasp.__version__}; it is of"
                f" {row.get('version')}: write to another folder, or remove this one"
            )
        return row


def job_of(row: Row) -> Job:
    """Return the job that makes a row again."""
    trial = Trial(**{name: row[name] for name in Trial.__dataclass_fields__})
    setup = Setup(**{name: row[name] for name in Setup.__dataclass_fields__})
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
    *("key", "object", "edged", "hand", "touches", "noise", "seed", "estimator"),
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
