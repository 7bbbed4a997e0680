"""Pool of worker processes, which end with the process that opened it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, parent_process
from multiprocessing.context import SpawnContext, SpawnProcess

from lis_grasp.exceptions import InvalidOptionError


@contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of processes that end with this one, even if it is killed.

    On exit, work that has not started is cancelled, and work that has is awaited; after Ctrl-C, or
    if an iterator over results is dropped, it is killed. Ctrl-C does not reach the processes.
    """
    pool = ProcessPoolExecutor(processes, mp_context=_Context(), initializer=_end_with_parent)
    try:
        yield pool
    except (KeyboardInterrupt, GeneratorExit):
        for process in active_children():
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def process_count(jobs: int | None) -> int:
    """Return the number of processes: `jobs`, or the number of cores for None."""
    if jobs is None:
        return os.cpu_count() or 1
    if jobs < 1:
        raise InvalidOptionError.out_of_range("jobs", jobs, "at least 1")
    return jobs


class _Process(SpawnProcess):
    """A process that Ctrl-C does not reach, not even while it starts."""

    def start(self) -> None:
        """Start with SIGINT blocked, which the process inherits."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    Process = _Process  # type: ignore[assignment]


def _end_with_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
