"""Killed commands, run again, write the files of an uninterrupted run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases import SEED, TIMES
from kills import half_written, interrupted, uninterrupted


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "count"),
    [
        *[("explore", 2), ("run", 1), ("label", 1)],
        *[("compare", min(1, TIMES - 1)), ("evaluate", min(1, TIMES - 1))],
    ],
)
def test_a_killed_command_run_again_writes_the_same_files(
    verb: str, count: int, tmp_path: Path
) -> None:
    plain = uninterrupted(verb, tmp_path / "plain")
    for index in range(count if TIMES == 1 else TIMES):
        rng = np.random.default_rng([SEED, index])
        assert not interrupted(verb, tmp_path / f"killed{index}", plain, rng)


@pytest.mark.slow
def test_an_incomplete_file_is_detected(tmp_path: Path) -> None:
    plain = uninterrupted("explore", tmp_path)
    assert not half_written(tmp_path, plain)
    log = tmp_path / "touches.jsonl"
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) // 2])  # an interrupted log is a beginning
    assert not half_written(tmp_path, plain)
    log.write_bytes(whole.replace(b"touched", b"missed", 1))
    contacts = tmp_path / "contacts.ply"
    contacts.write_bytes(contacts.read_bytes()[:-5])
    assert half_written(tmp_path, plain) == [
        "contacts.ply after a kill",
        "touches.jsonl after a kill",
    ]
