"""Who runs the trials of a study: this process, all cores, or a cluster; the rows are the same."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from lis_grasp.exceptions import EstimationError, InvalidOptionError, LisGraspError
from lis_grasp.experiments.study.study import Study
from lis_grasp.experiments.study.study_results import StudyResults
from lis_grasp.experiments.study.study_trial import Job, run_job
from lis_grasp.io.json_lines import Row
from lis_grasp.pipeline.worker_pool import worker_pool

Runner = Callable[[Job], list[Row]]
Result = TypeVar("Result")

_TRIES = 3  # of a job alone
_KILLED = "their processes were killed again and again"
_CONNECT = 15  # [s] to wait for a cluster


class Scheduler(Protocol):
    """Runs jobs somewhere."""

    def run(self, runner: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the result of each job as soon as it is there, in any order.

        Raises
        ------
        EstimationError
            If jobs could not be finished, after all others were.
        """
        ...


@dataclass(frozen=True, slots=True)
class InProcess:
    """Runs jobs here, one after the other."""

    def run(self, runner: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
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

    def run(self, runner: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
        left, suspects, unfinished = list(jobs), list[Job](), 0
        while left:
            try:
                for job, result in self._attempt(runner, list(left)):
                    left.remove(job)
                    yield result
            except BrokenProcessPool:
                # One killed process takes the pool with it. Who was at work are the first of what
                # is left: one of them may have killed it, and others should not suffer from that.
                suspects += left[: self.processes]
                del left[: self.processes]
        for job in suspects:
            for _ in range(_TRIES):
                try:
                    yield from (result for _, result in self._attempt(runner, [job]))
                except BrokenProcessPool:
                    continue
                break
            else:
                unfinished += 1
        if unfinished:
            raise _unfinished(unfinished, _KILLED, "with fewer --jobs if memory ran out")

    def _attempt(
        self, runner: Callable[[Job], Result], jobs: Sequence[Job]
    ) -> Iterator[tuple[Job, Result]]:
        with worker_pool(min(self.processes, len(jobs))) as pool:
            pending = {pool.submit(runner, job): job for job in jobs}
            while pending:
                finished, _ = wait(pending, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield pending.pop(future), future.result()


@dataclass(frozen=True, slots=True)
class DaskCluster:
    """Runs jobs on a cluster of Dask, whose workers need this package and the study's files.

    Dask runs again what a lost worker was at, elsewhere.

    Parameters
    ----------
    address
        Of its scheduler, such as ``tcp://host:8786``.
    """

    address: str

    def run(self, runner: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the result of each job; see `Scheduler`."""
        distributed = _distributed()
        try:
            client = distributed.Client(self.address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            raise InvalidOptionError(
                f"--scheduler must be the address of a running Dask scheduler, such as"
                f" tcp://host:8786; {self.address} is none: {error}"
            ) from None
        killed, lost = 0, 0
        with client:
            _require_one_thread(client, self.address)
            # Impure: a cluster that outlives a study must not remember rows of older code.
            futures = client.map(runner, jobs, pure=False)
            for future in distributed.as_completed(futures):
                try:
                    yield future.result()
                except distributed.KilledWorker:
                    killed += 1
                except distributed.CancelledError:
                    lost += 1
                future.release()
        if lost:
            reason = f"{self.address} was lost"
            raise _unfinished(killed + lost, reason, "when the scheduler runs again")
        if killed:
            raise _unfinished(killed, _KILLED, "with workers of more memory if memory ran out")


@dataclass(frozen=True, slots=True)
class _Unforeseen:
    """An error that nobody foresaw: of which job, and what it says."""

    job: Job
    told: str


@dataclass(frozen=True, slots=True)
class _Guarded:
    """Runs a job; what nobody foresaw is a result too, so that other jobs are not lost."""

    runner: Runner

    def __call__(self, job: Job) -> list[Row] | _Unforeseen:
        try:
            return self.runner(job)
        except LisGraspError:
            raise
        except Exception as error:  # noqa: BLE001 - told when all others are done
            return _Unforeseen(job, "".join(traceback.format_exception(error)))


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
    LisGraspError
        If a file of the study cannot be used any more.
    """
    jobs, total = results.missing(study), len(study.trials())
    done = total - len(jobs)
    yield done, total
    if not jobs:
        return
    unforeseen = []
    for result in scheduler.run(_Guarded(runner), jobs):
        if isinstance(result, _Unforeseen):
            unforeseen.append(result)
            continue
        results.write(result)
        done += 1
        yield done, total
    if unforeseen:
        first = unforeseen[0]
        raise EstimationError(
            f"{len(unforeseen)} trials met a mistake in the program, all others are done; the first"
            f" is of {first.job.trial}: please report it with what follows\n{first.told}"
        )


def _require_one_thread(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_CONNECT)
    except TimeoutError:
        raise InvalidOptionError(
            f"--scheduler must have a worker; {address} had none for {_CONNECT} s: start some with"
            f" dask worker {address} --nthreads 1"
        ) from None
    threads = list(client.nthreads().values())
    if max(threads) > 1:
        raise InvalidOptionError(
            "workers must have one thread each, so that trials run alone in their process;"
            f" {sum(n > 1 for n in threads)} of {len(threads)} have more: start them with"
            " --nthreads 1"
        )


def _unfinished(count: int, reason: str, advice: str) -> EstimationError:
    return EstimationError(
        f"{count} trials were not finished, because {reason}: run the command again to go on,"
        f" {advice}"
    )


def _distributed() -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        raise InvalidOptionError("--scheduler needs Dask: pip install 'lis-grasp[study]'") from None
    return distributed
