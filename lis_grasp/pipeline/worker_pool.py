"""Processes of this machine that share work: spawned, so that they inherit no threads or locks."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process

from lis_grasp.exceptions import InvalidOptionError


@contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of processes that leave interrupts to this one; cancel what is not begun.

    They end when this process does, however it does.
    """
    pool = ProcessPoolExecutor(
        processes, mp_context=get_context("spawn"), initializer=_depend_on_the_parent
    )
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def process_count(jobs: int | None) -> int:
    """Return how many processes to use: `jobs`, at least 1, or the machine's cores for None."""
    if jobs is None:
        return os.cpu_count() or 1
    if jobs < 1:
        raise InvalidOptionError(f"--jobs must be at least 1; {jobs} came")
    return jobs


def _depend_on_the_parent() -> None:
    """Leave interrupts to the parent, but end with it, and do not wait for work forever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_the_parent, daemon=True).start()


def _end_with_the_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
