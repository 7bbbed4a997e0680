"""Resumable runner of trials: in this process, in local processes, or on a Dask cluster."""

from __future__ import annotations

import logging
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from lis_grasp.exceptions import EstimationError, InvalidOptionError, LisGraspError, needed_package
from lis_grasp.io.json_lines import Row
from lis_grasp.stages.worker_pool import process_count, worker_pool
from lis_grasp_studies.harness.rows import Job

Runner = Callable[[Job], list[Row]]
Result = TypeVar("Result")

_TRIES = 3  # of a job alone
_TRIES_WITH_ERRORS = 2
_KILLED = "their processes were killed repeatedly"
_CONNECT = 15  # [s] to wait for a cluster
_ALONE = threading.Lock()


class Scheduler(Protocol):
    """Runs jobs somewhere."""

    def run(self, runner: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
        """Yield the result of each job as soon as it is complete, in any order.

        Jobs are taken when there is a process for them, so that results decide on later ones.

        Raises `EstimationError` if jobs could not be finished, after all others were.
        """
        ...


@dataclass(frozen=True, slots=True)
class InProcess:
    """Runs jobs in this process, one after the other."""

    def run(self, runner: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
        return map(runner, jobs)


@dataclass(frozen=True, slots=True)
class LocalPool:
    """Runs jobs in so many processes of this machine, and replaces processes that were killed.

    Jobs of killed processes are tried again at the end, alone.
    """

    processes: int

    def run(self, runner: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
        left, suspects, unfinished = iter(jobs), list[Job](), 0
        while True:
            at_work: list[Job] = []
            try:
                yield from self._run(runner, left, at_work)
                break
            except BrokenProcessPool:
                # One killed process breaks the pool. One of the jobs at work may be the cause: try
                # them alone, so that no other job suffers.
                suspects += at_work
        for job in suspects:
            for _ in range(_TRIES):
                try:
                    yield from self._run(runner, iter([job]), [])
                except BrokenProcessPool:
                    continue
                break
            else:
                unfinished += 1
        if unfinished:
            raise _unfinished(unfinished, _KILLED, "with fewer --jobs if memory ran out")

    def _run(
        self, runner: Callable[[Job], Result], jobs: Iterator[Job], at_work: list[Job]
    ) -> Iterator[Result]:
        """Yield results; `at_work` has the jobs that are taken and have none."""
        with worker_pool(self.processes) as pool:
            pending: dict[Future[Result], Job] = {}
            while True:
                for job in islice(jobs, self.processes - len(pending)):
                    at_work.append(job)
                    pending[pool.submit(runner, job)] = job
                if not pending:
                    return
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    result = future.result()
                    at_work.remove(pending.pop(future))
                    yield result


@dataclass(frozen=True, slots=True)
class DaskCluster:
    """Runs jobs on a Dask cluster, whose workers need this package and the files of the trials.

    Dask runs the jobs of a lost worker again, on another.
    """

    address: str
    """Address of its scheduler, such as ``tcp://host:8786``."""

    def run(self, runner: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
        with needed_package("Dask", "study", option="scheduler"):
            import distributed
        try:
            client = distributed.Client(self.address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            raise self._error(
                "be the address of a running Dask scheduler, such as tcp://host:8786", str(error)
            ) from None
        killed, lost = 0, 0
        # A lost scheduler is an error of its jobs; its client would also log a traceback, and does
        # so after it has been closed.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        with client:
            self._require_single_threads(client)
            waiting, left = distributed.as_completed(), iter(jobs)
            while True:
                if not lost:  # workers may join later
                    room = max(len(client.nthreads()), 1) - waiting.count()
                    for job in islice(left, max(room, 0)):
                        # Impure: a cluster that outlives a study must not return older rows.
                        waiting.add(client.submit(runner, job, pure=False))
                if not waiting.count():
                    break
                future = next(waiting)
                try:
                    yield future.result()
                except distributed.KilledWorker:
                    killed += 1
                except distributed.CancelledError:
                    lost += 1
                future.release()
        if lost:
            reason = f"{self.address} was lost"
            raise _unfinished(
                killed + lost + sum(1 for _ in left), reason, "when the scheduler runs again"
            )
        if killed:
            raise _unfinished(killed, _KILLED, "with workers of more memory if memory ran out")

    def _require_single_threads(self, client: Any) -> None:
        try:
            client.wait_for_workers(1, timeout=_CONNECT)
        except TimeoutError:
            raise self._error(
                f"have a worker: start one with dask worker {self.address} --nthreads 1",
                f"none came within {_CONNECT} s",
            ) from None
        threads = list(client.nthreads().values())
        if max(threads) > 1:
            raise self._error(
                "have workers of one thread each: start them with --nthreads 1",
                f"{sum(n > 1 for n in threads)} of {len(threads)} have more",
            )

    def _error(self, required: str, found: str) -> InvalidOptionError:
        return InvalidOptionError(
            f"--scheduler must {required}; it is {self.address}: {found}",
            option="scheduler",
            value=self.address,
        )


def local_scheduler(jobs: int | None) -> Scheduler:
    """Return a scheduler of so many local processes; None for one per core."""
    processes = process_count(jobs)
    return InProcess() if processes == 1 else LocalPool(processes)


@contextmanager
def single_thread(*modules: str) -> Iterator[None]:
    """Limit numerical libraries to one thread, and run one block at a time.

    Sums then have the same order on every machine, also in a Dask worker with more threads. Only
    libraries that are loaded can be limited: those of these modules are, and are loaded first.
    """
    for name in modules:
        import_module(name)
    with _ALONE, threadpool_limits(1):
        yield


@dataclass(frozen=True, slots=True)
class _Failure:
    """A job without rows."""

    job: Job
    error: str
    expected: bool
    """Whether another try may succeed: a file may have been missing for a moment."""


def _rows_or_failure(runner: Runner, job: Job) -> list[Row] | _Failure:
    """Run a job; return an error as text, so that other jobs are not lost."""
    try:
        return runner(job)
    except LisGraspError as error:
        return _Failure(job, str(error), expected=True)
    except Exception as error:  # noqa: BLE001 - reported after all other jobs
        # The name comes first: messages lose their middle, and an error's text may be long.
        name = type(error).__name__
        return _Failure(job, f"{name} in {job.trial}\n{traceback.format_exc()}", expected=False)


class Results(Protocol):
    """Receives rows, such as `TrialResults`."""

    def append(self, rows: Sequence[Row]) -> None:
        """Add the rows of a job."""
        ...


def run_trials(
    jobs: Iterable[Job],
    total: int,
    results: Results,
    scheduler: Scheduler,
    runner: Runner,
) -> Iterator[tuple[int, int]]:
    """Run the missing jobs of an experiment; yield the number of trials done and in total.

    Rows do not depend on the scheduler, except for times and versions.

    Parameters
    ----------
    jobs
        See `missing_jobs`; an iterator may end early.
    total
        Number of trials of the experiment, finished ones included; of an iterator, of its jobs.
    results
        Receives the rows of each finished job.
    scheduler, runner
        Runs the jobs; returns the rows of one.

    Raises
    ------
    InvalidFileError
        If rows cannot be written.
    EstimationError
        If trials could not be finished, as when a file of theirs cannot be used any more, twice;
        all others are among the results.
    """
    done = total - len(jobs) if isinstance(jobs, Sequence) else 0
    yield done, total
    if not jobs:
        return
    failures: list[_Failure] = []
    for _ in range(_TRIES_WITH_ERRORS):
        again = [failure.job for failure in failures if failure.expected]
        failures = [failure for failure in failures if not failure.expected]
        for result in scheduler.run(partial(_rows_or_failure, runner), again or jobs):
            if isinstance(result, _Failure):
                failures.append(result)
                continue
            results.append(result)
            done += 1
            yield done, total
        if not any(failure.expected for failure in failures):
            break
    if failures:
        raise _failed(failures)


def _failed(failures: Sequence[_Failure]) -> EstimationError:
    unexpected = [failure.error for failure in failures if not failure.expected]
    if unexpected:
        return EstimationError(
            f"{len(unexpected)} trials met an error of the program, all others are done; please"
            f" report the first with its traceback: {unexpected[0]}"
        )
    return EstimationError(
        f"{len(failures)} trials failed, all others are done: run the command again to try them"
        f" again; the first: {failures[0].error}"
    )


def _unfinished(count: int, reason: str, advice: str) -> EstimationError:
    return EstimationError(
        f"{count} trials were not finished, because {reason}: run the command again to continue,"
        f" {advice}"
    )
