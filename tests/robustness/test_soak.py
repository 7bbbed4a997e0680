"""Long use: many runs in one process accumulate no memory, threads or files."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import soak
from soak import Counts, faults_of

STEADY = Counts(memory=200.0, python_threads=1, threads=2, files=8, temporary=0)


@pytest.mark.slow
def test_cycles_in_one_process_accumulate_no_resources() -> None:
    command = [sys.executable, str(Path(soak.__file__)), "--cycles", "21"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert ended.returncode == 0, ended.stdout[-3000:] + ended.stderr[-3000:]


def test_growth_during_the_warm_up_and_in_one_cycle_is_no_leak() -> None:
    assert not faults_of([replace(STEADY, memory=100.0, threads=1)] * 10 + [STEADY] * 90)
    assert not faults_of([*[STEADY] * 99, replace(STEADY, memory=900.0)])


@pytest.mark.parametrize(
    ("name", "step"), [("memory", 0.2), ("python_threads", 1), ("threads", 1), ("files", 1)]
)
def test_growth_in_every_cycle_is_detected(name: str, step: float) -> None:
    counts = [replace(STEADY, **{name: getattr(STEADY, name) + k * step}) for k in range(100)]
    assert [fault.split()[0] for fault in faults_of(counts)] == [name]


def test_a_remaining_temporary_file_is_detected() -> None:
    faults = faults_of([*[STEADY] * 99, replace(STEADY, temporary=1)])
    assert faults == ["1 temporary files are left"]


def test_a_failed_command_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    _, failed = soak.soak(1, ["no_such_object"], 0)
    assert failed
    assert failed[0].startswith("cycle 0: explore no_such_object")
    assert "no_such_object" in capsys.readouterr().out
