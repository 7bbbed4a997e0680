"""Worker processes for fuzzing cases: a hang or a crash ends one case only."""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path

from fuzzing.cases import case_of, verdict_of
from fuzzing.kinds import KINDS

# A process without an answer for this time hangs [s]. `Case.limit` detects slow cases; it is
# processor time, so other work on the machine does not count.
_KILLED_AFTER = 600.0
# Address space of a process [bytes]: inputs of a few kilobytes need far less.
_MEMORY = 6 * 2**30

Job = tuple[str, int, int]  # kind, seed, index


@dataclass(frozen=True)
class Result:
    """The verdict on a case, see `fuzzing.cases`, and its processor time [s]."""

    kind: str
    index: int
    verdict: str
    message: str
    seconds: float

    @property
    def group(self) -> str:
        return KINDS[self.kind].group(self.index)


def run_one(kind: str, seed: int, index: int, folder: Path) -> Result:
    """Run one case in this process."""
    start = time.process_time()
    case = case_of(kind, KINDS, seed, index, folder)
    # The system kills a case far beyond its limit, which counts as a crash.
    before = resource.getrlimit(resource.RLIMIT_CPU)
    most = int(time.process_time()) + 6 * int(case.limit)
    resource.setrlimit(resource.RLIMIT_CPU, (most, before[1]))
    try:
        verdict, message = verdict_of(case)
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, before)
    seconds = time.process_time() - start
    if seconds > case.limit and not verdict.startswith("failed"):
        verdict, message = "failed TooSlow", f"{seconds:.0f} s ({verdict})"
    return Result(kind, index, verdict, message, seconds)


def run_cases(jobs: Iterable[Job], processes: int) -> Iterator[Result]:
    """Run cases in worker processes; yield results as they arrive."""
    waiting = iter(jobs)
    workers = [_Worker() for _ in range(processes)]
    busy = [worker for worker in workers if worker.take(next(waiting, None))]
    try:
        while busy:
            wait([w.connection for w in busy] + [w.process.sentinel for w in busy], timeout=0.5)
            for worker in list(busy):
                result = worker.result()
                if result is not None:
                    yield result
                    if not worker.take(next(waiting, None)):
                        busy.remove(worker)
    finally:
        for worker in workers:
            worker.stop()


@dataclass
class _Worker:
    """A process that runs one case after the other, and is replaced when it dies."""

    job: Job | None = None
    since: float = 0.0
    connection: Connection = field(init=False)
    process: multiprocessing.process.BaseProcess = field(init=False)

    def __post_init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()

    def take(self, job: Job | None) -> bool:
        self.job = job
        if job is None:
            return False
        self.since = time.monotonic()
        self.connection.send(job)
        return True

    def result(self) -> Result | None:
        assert self.job is not None
        kind, _, index = self.job
        try:
            if self.connection.poll():
                answer = self.connection.recv()
                if isinstance(answer, Result):
                    return answer
                self.since = time.monotonic()  # the process has just started
                return None
        except (EOFError, ConnectionResetError):
            self.process.join()
            code = self.process.exitcode
            self._start()
            return Result(kind, index, "failed Crash", f"the process ended with {code}", 0.0)
        if time.monotonic() - self.since > _KILLED_AFTER:
            self.stop()
            self._start()
            return Result(kind, index, "failed Hang", f"killed after {_KILLED_AFTER:g} s", 0.0)
        return None

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def _work(connection: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    connection.send("up")
    while True:
        try:
            kind, seed, index = connection.recv()
        except EOFError:
            return
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            connection.send(run_one(kind, seed, index, Path(folder)))
