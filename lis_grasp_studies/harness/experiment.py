"""Experiments: trials of one kind, their keys, and rows that are completed and never made twice."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lis_grasp.io.json_lines import Row
from lis_grasp_studies.harness.rows import Job, TrialResults, missing_jobs
from lis_grasp_studies.harness.runner import Scheduler, local_scheduler, run_trials, single_thread


@dataclass(frozen=True, slots=True)
class Experiment:
    """A way to measure trials, each in several variants such as estimators.

    A row has the facts of its trial, the name of its variant, and what was measured. The first two
    and the digest of a plug-in are its key.
    """

    kind: str
    """Name in the header of the file of rows."""
    measure: Callable[[Any, str], Row | list[Row]]
    """Returns what a trial measures in a variant: a row's columns, or those of several rows. A
    function of a module, so that other processes can call it."""
    facts: Callable[[Any], Row] = asdict  # type: ignore[assignment]
    """Returns the columns of a row that identify its trial: texts and numbers."""
    variant: str = "estimator"
    """Column of the variant's name."""
    source: Callable[[str], str] | None = None
    """Returns a digest of a variant's source if a plug-in makes it; a function of a module too."""
    modules: tuple[str, ...] = ()
    """Modules whose numerical libraries are limited to one thread too, such as Drake's."""

    def key(self, trial: Any, variant: str) -> tuple[Any, ...]:
        """Return the key of a row."""
        return *self.facts(trial).values(), variant, self._digest(variant)

    def run(self, job: Job) -> list[Row]:
        """Return the rows of a job, made with one thread."""
        rows: list[Row] = []
        with single_thread(*self.modules):
            for name in job.variants:
                facts = self.facts(job.trial) | {self.variant: name}
                source = self._digest(name)
                facts |= {"source": source} if source else {}
                measured = self.measure(job.trial, name)
                measured = [measured] if isinstance(measured, dict) else measured
                rows += [facts | columns for columns in measured]
        return rows

    def run_missing(
        self,
        trials: Sequence[Any],
        variants: Sequence[str],
        results: TrialResults,
        scheduler: Scheduler,
    ) -> Iterator[tuple[int, int]]:
        """Run what has no row yet; yield the numbers of trials done and in total.

        Errors as of `run_trials`.
        """
        if not trials:
            return
        known = {self.key_of(row, trials[0]) for row in results.read()}
        jobs = missing_jobs(trials, variants, known, self.key)
        yield from run_trials(jobs, len(trials), results, scheduler, self.run)

    def rows(
        self, trials: Sequence[Any], variants: Sequence[str], results: TrialResults
    ) -> list[Row]:
        """Return the rows of some trials that exist, in the order of trials and variants."""
        order = {self.key(trial, name): None for trial in trials for name in variants}
        places = {key: place for place, key in enumerate(order)}
        rows = [row for row in results.read() if self.key_of(row, trials[0]) in places]
        return sorted(rows, key=lambda row: places[self.key_of(row, trials[0])])

    def complete(
        self,
        trials: Sequence[Any],
        variants: Sequence[str],
        path: Path,
        *,
        jobs: int | None = None,
    ) -> list[Row]:
        """Run what has no row yet in a file, with progress on stderr; return all rows in order."""
        results = TrialResults(path, self.kind)
        for done, total in self.run_missing(trials, variants, results, local_scheduler(jobs)):
            print(f"\r{self.kind}: {done} of {total} trials", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        return self.rows(trials, variants, results)

    def _digest(self, variant: str) -> str:
        return self.source(variant) if self.source else ""

    def key_of(self, row: Row, trial: Any) -> tuple[Any, ...]:
        """Return the key of a row that exists, as `key` does; any trial has its columns."""
        names = (*self.facts(trial), self.variant)
        values = [row.get(name) for name in names] + [row.get("source") or ""]
        # A damaged row has the key of no trial.
        return tuple(repr(v) if isinstance(v, list | dict) else v for v in values)
