"""Tests of the lock of a folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.atomic_writing import sole_writer

HOLD = """
import sys, time
from pathlib import Path
from lis_grasp.io.atomic_writing import sole_writer
with sole_writer(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_refused_until_the_first_ends(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    command = [sys.executable, "-c", HOLD, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(InvalidFileError) as error, sole_writer(folder):
            pass
        assert error.value.path == folder
        other.kill()
    with sole_writer(folder):
        assert folder.is_dir()


def test_a_refused_command_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("")
    for folder in (tmp_path / "new" / "results", tmp_path):
        with pytest.raises(InvalidOptionError), sole_writer(folder):
            raise InvalidOptionError("refused", option="jobs")
        assert [path.name for path in tmp_path.rglob("*")] == ["mine.txt"]
    with pytest.raises(InvalidOptionError), sole_writer(tmp_path / "new"):
        (tmp_path / "new" / "partial.csv").write_text("")
        raise InvalidOptionError("refused", option="jobs")
    assert (tmp_path / "new" / "partial.csv").exists()


def test_one_process_writes_again_and_again(tmp_path: Path) -> None:
    for _ in range(2):
        with sole_writer(tmp_path):
            pass


def test_a_file_in_place_of_the_folder_is_named(tmp_path: Path) -> None:
    file = tmp_path / "results"
    file.write_text("mine")
    with pytest.raises(InvalidFileError) as error, sole_writer(file):
        pass
    assert error.value.path == file
    assert file.read_text() == "mine"
