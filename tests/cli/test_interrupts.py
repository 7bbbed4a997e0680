"""Ctrl-C: it waits for the end of an import, and does not reach starting workers."""

import signal
import sys
import time
from pathlib import Path

import pytest

from lis_grasp.cli.importing import interrupts_after_imports
from lis_grasp.stages.worker_pool import worker_pool

MODULE = """
import os, signal, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(0.05)
finished = True
"""


@pytest.fixture
def default_handler() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("default_handler")
def test_an_import_is_finished_before_the_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "interrupting_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        import interrupting_module  # noqa: F401

        time.sleep(5.0)
    assert sys.modules.pop("interrupting_module").finished
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("default_handler")
def test_elsewhere_an_interrupt_acts_at_once() -> None:
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        signal.raise_signal(signal.SIGINT)
        time.sleep(5.0)
    assert time.monotonic() - start < 2.0


def test_workers_are_born_deaf_to_interrupts() -> None:
    with worker_pool(1) as pool:
        blocked = pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
