"""Who runs the trials of a study: this process, all cores, or a cluster; the rows are the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

from lis_grasp.exceptions import EstimationError, InvalidOptionError
from lis_grasp.json_lines import Row
from lis_grasp.study.results import StudyResults
from lis_grasp.study.study import Study
from lis_grasp.study.trial import Job, run_job
from lis_grasp.worker_pool import worker_pool

Runner = Callable[[Job], list[Row]]

_TRIES = 3  # of a job alone
_CONNECT = 15  # [s] to wait for a cluster


class Scheduler(Protocol):
    """Runs jobs somewhere."""

    def run(self, runner: Runner, jobs: Sequence[Job]) -> Iterator[list[Row]]:
        """Yield the rows of each job as soon as they are there, in any order.

        Raises
        ------
        EstimationError
            If jobs could not be finished, after all others were.
        """
        ...


@dataclass(frozen=True, slots=True)
class InProcess:
    """Runs jobs here, one after the other."""

    def run(self, runner: Runner, jobs: Sequence[Job]) -> Iterator[list[Row]]:
        """Yield the rows of each job; see `Scheduler`."""
        return map(runner, jobs)


@dataclass(frozen=True, slots=True)
class LocalPool:
    """Runs jobs in processes of this machine; goes on in new ones where some were killed.

    What a killed process was at has more tries at the end, alone.

    Parameters
    ----------
    processes
        How many.
    """

    processes: int

    def run(self, runner: Runner, jobs: Sequence[Job]) -> Iterator[list[Row]]:
        """Yield the rows of each job; see `Scheduler`."""
        left, suspects, unfinished = list(jobs), list[Job](), 0
        while left:
            try:
                for job, rows in self._attempt(runner, list(left)):
                    left.remove(job)
                    yield rows
            except BrokenProcessPool:
                # One killed process takes the pool with it. Who was at work are the first of what
                # is left: one of them may have killed it, and others should not suffer from that.
                suspects += left[: self.processes]
                del left[: self.processes]
        for job in suspects:
            for _ in range(_TRIES):
                try:
                    yield from (rows for _, rows in self._attempt(runner, [job]))
                except BrokenProcessPool:
                    continue
                break
            else:
                unfinished += 1
        if unfinished:
            raise _unfinished(unfinished, "fewer --jobs")

    def _attempt(self, runner: Runner, jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
        with worker_pool(min(self.processes, len(jobs))) as pool:
            pending = {pool.submit(runner, job): job for job in jobs}
            while pending:
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield pending.pop(future), future.result()


@dataclass(frozen=True, slots=True)
class DaskCluster:
    """Runs jobs on a cluster of Dask, whose workers need this package and nothing else of here.

    Dask runs again what a lost worker was at, elsewhere.

    Parameters
    ----------
    address
        Of its scheduler, such as ``tcp://host:8786``.
    """

    address: str

    def run(self, runner: Runner, jobs: Sequence[Job]) -> Iterator[list[Row]]:
        """Yield the rows of each job; see `Scheduler`."""
        distributed = _distributed()
        try:
            client = distributed.Client(self.address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            raise InvalidOptionError(
                f"--scheduler must be the address of a running Dask scheduler, such as"
                f" tcp://host:8786; {self.address} is none: {error}"
            ) from None
        unfinished = 0
        with client:
            _require_one_thread(client)
            # Impure: a cluster that outlives a study must not remember rows of older code.
            futures = client.map(runner, jobs, pure=False)
            for future in distributed.as_completed(futures):
                try:
                    yield future.result()
                except (distributed.KilledWorker, distributed.CancelledError):
                    unfinished += 1
                future.release()
        if unfinished:
            raise _unfinished(unfinished, "workers of more memory")


def run_study(
    study: Study,
    results: StudyResults,
    scheduler: Scheduler,
    *,
    runner: Runner = run_job,
) -> Iterator[tuple[int, int]]:
    """Run what of a study is not among the results yet; yield trials done and all, after each.

    Rows are the same whoever runs them, but for times and versions.

    Parameters
    ----------
    study
        What to run.
    results
        Where rows are kept.
    scheduler
        Who runs it.
    runner
        Runs one job.

    Raises
    ------
    InvalidFileError
        If rows cannot be written.
    EstimationError
        If trials could not be finished; all others are among the results.
    """
    jobs, total = results.missing(study), len(study.trials())
    done = total - len(jobs)
    yield done, total
    if not jobs:
        return
    for rows in scheduler.run(runner, jobs):
        results.write(rows)
        done += 1
        yield done, total


def _require_one_thread(client: Any) -> None:
    client.wait_for_workers(1, timeout=_CONNECT)
    threads = list(client.nthreads().values())
    if max(threads) > 1:
        raise InvalidOptionError(
            "workers must have one thread each, so that trials run alone in their process;"
            f" {sum(n > 1 for n in threads)} of {len(threads)} have more: start them with"
            " --nthreads 1"
        )


def _unfinished(count: int, advice: str) -> EstimationError:
    return EstimationError(
        f"{count} trials were not finished, because their processes were killed again and again:"
        f" run the command again to go on, with {advice} if memory ran out"
    )


def _distributed() -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        raise InvalidOptionError("--scheduler needs Dask: pip install 'lis-grasp[study]'") from None
    return distributed
