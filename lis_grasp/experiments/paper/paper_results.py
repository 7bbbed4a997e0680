"""Results of trials, one JSON line each, kept as they come and taken up again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from threadpoolctl import threadpool_limits

import lis_grasp
from lis_grasp.exceptions import EstimationError, InvalidFileError
from lis_grasp.experiments.paper.paper_trials import Trial, run_trial
from lis_grasp.io.json_lines import Row, append_lines, read_lines
from lis_grasp.pipeline.worker_pool import worker_pool


@dataclass(frozen=True, slots=True)
class ResultsFile:
    """Rows of finished trials in a file that only ever grows; its header names the version.

    Parameters
    ----------
    path
        Of the file; need not exist.
    """

    path: Path

    def read(self) -> list[Row]:
        """Return the rows so far.

        Raises
        ------
        InvalidFileError
            If the file is of another version, or no file of results.
        """
        header, rows = read_lines(self.path)
        if header and header != _header():
            raise InvalidFileError(
                f"{self.path} must be of lis_grasp {lis_grasp.__version__}; it says {header}:"
                " write to another folder, or remove it"
            )
        return rows

    def append(self, rows: Sequence[Row]) -> None:
        """Add rows, on the disk when this returns."""
        append_lines(self.path, _header(), rows)


def run_trials(
    file: ResultsFile, trials: Sequence[Trial], contenders: Sequence[str], *, jobs: int
) -> Iterator[tuple[int, int]]:
    """Run what of the trials is not in the file yet; yield the trials done and all, after each.

    Rows are the same whatever the number of jobs, their order in the file is not.

    Parameters
    ----------
    file
        Where rows are kept.
    trials
        To run.
    contenders
        Names of estimators; a trial that lacks some of them runs for these.
    jobs
        Processes.

    Raises
    ------
    InvalidFileError
        If the file is of another version, or cannot be written.
    EstimationError
        If a process was killed; what is finished is in the file.
    """
    known = {(r["experiment"], r["object"], r["seed"], r["estimator"]) for r in file.read()}
    missing: list[tuple[Trial, list[str]]] = []
    for trial in trials:
        key = (trial.experiment, trial.object, trial.seed)
        names = [name for name in contenders if (*key, name) not in known]
        if names:
            missing.append((trial, names))
    done = len(trials) - len(missing)
    yield done, len(trials)
    if not missing:
        return
    with worker_pool(jobs) as pool:
        pending = {pool.submit(_run, trial, names) for trial, names in missing}
        try:
            while pending:
                finished, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    file.append(future.result())
                    done += 1
                    yield done, len(trials)
        except BrokenProcessPool:
            raise EstimationError(
                f"a process of the experiments was killed, after {done} of {len(trials)} trials:"
                " run the command again to go on, with fewer --jobs if memory ran out"
            ) from None


def _run(trial: Trial, contenders: Sequence[str]) -> list[Row]:
    # One thread a process: as fast with all cores busy, and sums in the same order everywhere.
    with threadpool_limits(1):
        return run_trial(trial, contenders)


def _header() -> Row:
    return {"results": "paper", "version": lis_grasp.__version__}
