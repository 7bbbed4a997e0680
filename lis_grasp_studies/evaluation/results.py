"""Rows of an evaluation: made in order of importance, within a time, and stored as Parquet."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.json_lines import Row
from lis_grasp.io.schemas import FileRecord, Number, checked
from lis_grasp.version import __version__
from lis_grasp_studies.evaluation.configuration import Configuration, measure_part
from lis_grasp_studies.evaluation.part import Places
from lis_grasp_studies.harness.parquet import read_parquet, write_parquet
from lis_grasp_studies.harness.rows import Job, TrialResults
from lis_grasp_studies.harness.runner import Scheduler, run_trials


class _Row(FileRecord):
    part: str
    job_seconds: Number
    version: str
    commit: str


@dataclass(frozen=True, slots=True)
class EvaluationResults:
    """The rows of an evaluation in a folder: ``rows.jsonl``, which grows, and ``rows/*.parquet``.

    A row has its part, the commit that made it, and the time of its job; no row is made twice. The
    folder need not exist.
    """

    folder: Path

    @property
    def lines(self) -> TrialResults:
        """The file of rows that grows."""
        return TrialResults(self.folder / "rows.jsonl", "evaluate")

    def read(self, *, any_version: bool = False) -> list[Row]:
        """Return all rows, of the file that grows, or else of the Parquet files.

        Raises `InvalidFileError` if a file cannot be read, or is of another version.
        """
        if self.lines.path.is_file():
            path, rows = self.lines.path, self.lines.read(any_version=any_version)
        else:
            path = self.folder / "rows"
            paths = sorted(path.glob("[!.]*.parquet"))  # a kill leaves .partial-*
            rows = [row | {"part": file.stem} for file in paths for row in read_parquet(file)]
        for row in rows:
            made_by = checked(_Row, row, path, "row").version
            if made_by != __version__ and not any_version:
                raise InvalidFileError(
                    f"{path} must have rows of lis_grasp {__version__}; one is of {made_by}: write"
                    " to another folder",
                    path=path,
                )
        return rows

    def write_parquet(self, rows: dict[str, list[Row]]) -> None:
        """Write the rows of each part as a Parquet file named after it."""
        for name, part in rows.items():
            write_parquet(self.folder / "rows" / f"{name}.parquet", part)


@dataclass(slots=True)
class Evaluation:
    """The run of what is missing of an evaluation.

    Parameters
    ----------
    configuration, places
        What to measure, and where files are.
    results
        Receives the rows.
    scheduler
        Runs the jobs.
    hours
        Time for all of them; None for no limit. A job that would not be done by then, as others of
        its part were, ends the run.
    """

    configuration: Configuration
    places: Places
    results: EvaluationResults
    scheduler: Scheduler
    hours: float | None = None
    spent: dict[str, list[float]] = field(default_factory=dict)
    """Times of the jobs of each part so far [s]."""

    def run(self) -> Iterator[tuple[int, int, float]]:
        """Yield the numbers of jobs done and in total, and the time that the rest needs [s].

        The time is infinite until jobs are done, which say how many are done at a time.

        Errors as of `run_trials`.
        """
        known = self.results.read()
        for part, seconds in {(row["part"], row["job_seconds"]) for row in known}:
            self.spent.setdefault(part, []).append(seconds)
        left = self.configuration.missing(self.places, known)
        total, missing = sum(1 for _ in self.configuration.jobs(self.places)), len(left)
        if left and known and not self.results.lines.path.is_file():
            self.results.lines.append(known)  # of the Parquet files, which new ones replace
        start, before = time.time(), self._total()
        end = np.inf if self.hours is None else start + 3600.0 * self.hours

        def jobs() -> Iterator[Job]:
            while left and time.time() + self.expected(left[0]) <= end:
                yield left.pop(0)

        for done, _ in run_trials(jobs(), missing, self, self.scheduler, measure_part):
            rate = (self._total() - before) / max(time.time() - start, 1e-9)
            rest = sum(map(self.expected, left)) / rate if rate else np.inf
            yield total - missing + done, total, min(rest, end - time.time())

    def append(self, rows: Sequence[Row]) -> None:
        """Store the rows of a job with the commit, and learn what it cost."""
        made_by = {"version": __version__, "commit": commit()}
        self.results.lines.append([row | made_by for row in rows])
        self.spent.setdefault(rows[0]["part"], []).append(rows[0]["job_seconds"])

    def expected(self, job: Job) -> float:
        """Return the expected time of a job [s]: the mean of its part, or the configuration's."""
        part = job.trial.part
        times = self.spent.get(part) or [self.configuration.parts[part].seconds]
        return sum(times) / len(times)

    def _total(self) -> float:
        return sum(map(sum, self.spent.values()))


@lru_cache(maxsize=1)
def commit() -> str:
    """Return the commit of the package's source, with "-dirty" if files differ; or its version."""
    words = ("git", "describe", "--always", "--dirty", "--exclude=*", "--abbrev=10")
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return __version__
    done = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip() or __version__
