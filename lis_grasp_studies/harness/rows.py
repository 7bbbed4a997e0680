"""Results of trials: a file of JSON lines that grows row by row and survives interruption."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lis_grasp import version
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.json_lines import MADE_AGAIN, Row, append_lines, read_lines


@dataclass(frozen=True, slots=True)
class Job:
    """A trial to run, for those of its variants that have no row yet."""

    trial: Any
    """Frozen record of what the variants have in common: the object, the seed, ..."""
    variants: tuple[str, ...]
    """Names, such as those of estimators; each makes one row."""


@dataclass(frozen=True, slots=True)
class TrialResults:
    """Rows of finished trials of one kind, such as "paper", in a file that only grows.

    Its header names the kind and the version. The file need not exist.
    """

    path: Path
    kind: str

    def read(self, *, any_version: bool = False) -> list[Row]:
        """Return the rows so far, by default of this version of the package only.

        Raises `InvalidFileError` if the file is of another kind or version, or not a file of
        results.
        """
        header, rows = read_lines(self.path, advice=MADE_AGAIN)
        wanted = self._header()
        found = header | wanted if any_version and header.get("results") == self.kind else header
        if header and found != wanted:
            raise InvalidFileError(
                f"{self.path} must hold {self.kind} results of lis_grasp {version.__version__};"
                f" its header is {header}: write to another folder, or remove the file",
                path=self.path,
            )
        return rows

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows; they are on the disk when this returns.

        Raises `InvalidFileError` if the file cannot be written, or a worker of another version made
        a row.
        """
        for row in rows:
            made_by = row.get("version", version.__version__)
            if made_by != version.__version__:
                raise InvalidFileError(
                    f"rows must be of lis_grasp {version.__version__}; a worker made one of"
                    f" {made_by}: give all workers the same version",
                    path=self.path,
                )
        append_lines(self.path, self._header(), rows)

    def _header(self) -> Row:
        return {"results": self.kind, "version": version.__version__}


def missing_jobs(
    trials: Iterable[Any],
    variants: Sequence[str],
    known: Collection[Hashable],
    key: Callable[[Any, str], Hashable],
) -> list[Job]:
    """Return a job for each trial that lacks a row, with the variants that it lacks.

    Known are the keys of existing rows; `key` returns that of a trial and a variant.
    """
    return [
        Job(trial, names)
        for trial in trials
        if (names := tuple(name for name in variants if key(trial, name) not in known))
    ]
