"""Progress of stages: steps are shown while a stage runs, on terminals and elsewhere."""

import io
import logging
import time

import pytest

from lis_grasp.cli import progress
from lis_grasp.cli.progress import Stage


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_the_last_step_and_then_the_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stderr", terminal := _Terminal())
    with Stage("Planning") as stage:
        logging.getLogger("lis_grasp.grasping.sampler").info("%d candidates", 100)
        assert terminal.getvalue().endswith("Planning ... 100 candidates")
        stage.count(3, 4)
        assert terminal.getvalue().endswith("Planning ... 3/4")
        stage.result = "10 grasps"
    logging.getLogger("lis_grasp").info("later")
    assert terminal.getvalue().splitlines()[-1].endswith(" s)")
    assert "\x1b[KPlanning: 10 grasps (" in terminal.getvalue()
    assert logging.getLogger("lis_grasp").handlers == []


def test_a_slow_stage_is_not_silent_without_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "_SILENCE", 0.02)
    end, lines = time.monotonic() + 60.0, []
    with Stage("Lifting"):
        logging.getLogger("lis_grasp.simulation").info("shake")
        while "Lifting ... shake" not in lines:
            assert time.monotonic() < end, lines
            time.sleep(0.02)
            lines += capsys.readouterr().err.splitlines()
    lines += capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("Lifting: done (")


def test_a_fast_stage_is_one_line_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RuntimeError), Stage("Lifting") as stage:
        stage.count(1, 2)
        raise RuntimeError
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("Lifting: failed (")


def test_a_stage_that_was_interrupted_is_not_a_failure(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(KeyboardInterrupt), Stage("Lifting"):
        raise KeyboardInterrupt
    assert capsys.readouterr().err.startswith("Lifting: interrupted (")
