"""Results of trials: a file of JSON lines that grows row by row and survives interruption."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lis_grasp
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.json_lines import Row, append_lines, read_lines


@dataclass(frozen=True, slots=True)
class Job:
    """A trial to run, for those of its variants that have no row yet.

    Parameters
    ----------
    trial
        Frozen record of what the variants have in common: the object, the seed, ...
    variants
        Names, such as those of estimators; each makes one row.
    """

    trial: Any
    variants: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TrialResults:
    """Rows of finished trials in a file that only grows; its header names kind and version.

    Parameters
    ----------
    path
        Of the file; need not exist.
    kind
        Of the trials, such as "paper".
    """

    path: Path
    kind: str

    def read(self, *, any_version: bool = False) -> list[Row]:
        """Return the rows so far.

        Parameters
        ----------
        any_version
            Whether the rows may come from another version of the package.

        Raises
        ------
        InvalidFileError
            If the file is of another kind or version, or not a file of results.
        """
        header, rows = read_lines(self.path)
        wanted = self._header()
        found = header | wanted if any_version and header.get("results") == self.kind else header
        if header and found != wanted:
            raise InvalidFileError(
                f"{self.path} must hold {self.kind} results of lis_grasp {lis_grasp.__version__};"
                f" its header is {header}: write to another folder, or remove the file",
                path=self.path,
            )
        return rows

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows; they are on the disk when this returns.

        Raises
        ------
        InvalidFileError
            If the file cannot be written, or a worker of another version made a row.
        """
        for row in rows:
            made_by = row.get("version", lis_grasp.__version__)
            if made_by != lis_grasp.__version__:
                raise InvalidFileError(
                    f"rows must be of lis_grasp {lis_grasp.__version__}; a worker made one of"
                    f" {made_by}: give all workers the same version",
                    path=self.path,
                )
        append_lines(self.path, self._header(), rows)

    def _header(self) -> Row:
        return {"results": self.kind, "version": lis_grasp.__version__}


def missing_jobs(
    trials: Iterable[Any],
    variants: Sequence[str],
    known: Collection[Hashable],
    key: Callable[[Any, str], Hashable],
) -> list[Job]:
    """Return a job for each trial that lacks a row, with the variants that it lacks.

    Parameters
    ----------
    trials
        In the order to run them.
    variants
        Wanted of each trial.
    known
        Keys of the rows that exist.
    key
        Returns the key of the row of a trial and a variant.
    """
    jobs = []
    for trial in trials:
        names = tuple(name for name in variants if key(trial, name) not in known)
        if names:
            jobs.append(Job(trial, names))
    return jobs
