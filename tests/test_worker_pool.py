"""Pools of worker processes: they end when the parent is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import os, time
from lis_grasp.stages.lift import worker_pool
from lis_grasp.stages.worker_pool import worker_pool

if __name__ == "__main__":
    with worker_pool(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        list(pool.map(time.sleep, [60.0] * 2))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks processes up in /proc")
def test_a_worker_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "program.py")],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    worker = int(parent.stdout.readline())
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 30.0
    while _is_running(worker):
        assert time.monotonic() < deadline, "the worker outlives its parent"
        time.sleep(0.05)


def _is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


SLEEP = """
import signal, time
from concurrent.futures import wait
from lis_grasp.stages.lift import worker_pool
from lis_grasp.stages.worker_pool import worker_pool
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored if the tests' parent does
    with worker_pool(2) as pool:
        pool.submit(int, "1").result()
        work = [pool.submit(time.sleep, 60) for _ in range(4)]
        print("working", flush=True)
        wait(work)
"""


@pytest.mark.slow
def test_one_interrupt_ends_work_at_once(tmp_path: Path) -> None:
    script = tmp_path / "sleep.py"
    script.write_text(SLEEP)
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout.readline() == b"working\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)  # a quiet machine takes a tenth of a second
        assert process.returncode != 0
        assert process.stdout.read() == b""  # no process holds the pipe any more
