"""Standard streams that are closed or full, and folders that cannot be written to."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import Contacts
from lis_grasp.cli.main import main

pytestmark = pytest.mark.slow  # each starts Python


@pytest.fixture
def contacts(tmp_path: Path) -> Path:
    axes = np.vstack([np.eye(3), -np.eye(3)])
    path = tmp_path / "contacts.csv"
    Contacts(0.03 * axes, axes).save(path)
    return path


def _estimate(contacts: Path, redirections: str, output: str = "out") -> tuple[int, str, str]:
    """Return the exit code, stdout and stderr of an estimate with a shell's redirections."""
    command = f'exec "$0" -m lis_grasp.cli.main estimate "$1" --output "$2" {redirections}'
    arguments = ["sh", "-c", command, sys.executable, str(contacts), str(contacts.parent / output)]
    ended = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=False)
    return ended.returncode, ended.stdout, ended.stderr


def test_a_full_stdout_is_one_sentence(contacts: Path) -> None:
    code, _, complaint = _estimate(contacts, "> /dev/full")
    assert code == 1
    assert complaint.splitlines() == [
        "lis-grasp: cannot write to standard output: No space left on device"
    ]


def test_a_reader_that_ends_early_is_no_error(contacts: Path) -> None:
    # `true` ends at once, so that the first line of the result has no reader.
    cut = 'set -o pipefail; "$0" -m lis_grasp.cli.main estimate "$1" --output "$2" | true'
    ended = subprocess.run(
        [
            *("bash", "-c", cut, sys.executable),
            *(str(contacts), str(contacts.parent / "out")),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 141
    assert "cannot write" not in ended.stderr


@pytest.mark.parametrize("redirections", ["2>&-", "2>/dev/full", ">&-", "<&- >&- 2>&-"])
def test_work_goes_on_without_the_other_streams(contacts: Path, redirections: str) -> None:
    code, out, complaint = _estimate(contacts, redirections)
    assert code == 0
    assert (contacts.parent / "out" / "surface.ply").stat().st_size > 1000
    assert "Traceback" not in out + complaint
    if redirections.startswith("2"):
        assert "wrote" in out
        assert complaint == ""


def test_what_libraries_print_gets_into_no_file(contacts: Path) -> None:
    # Without the null device in its place, a file would get the number 2.
    script = (
        "import os; from lis_grasp.cli.progress import open_streams as f; f();"
        f"file = open({str(contacts)!r}); assert file.fileno() > 2; os.write(2, b'lost')"
    )
    ended = subprocess.run(["sh", "-c", f'exec "{sys.executable}" -c "{script}" 2>&-'], check=False)
    assert ended.returncode == 0


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_letters_that_an_output_lacks_are_replaced(contacts: Path, encoding: str) -> None:
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    output = contacts.parent / "夹爪"
    command = [sys.executable, "-m", "lis_grasp.cli.main", "estimate", str(contacts)]
    ended = subprocess.run(
        [*command, "--output", str(output)],
        capture_output=True,
        env=environment,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 0
    assert (output / "surface.ply").is_file()
    shown = "夹爪" if encoding == "utf-8" else "??"
    assert shown.encode(encoding) + b"/surface.ply" in ended.stdout


def test_a_folder_that_cannot_be_written_to_is_one_sentence(
    contacts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A file in place of a folder refuses root, too.
    (contacts.parent / "out").write_text("")
    assert main(["estimate", str(contacts), "--output", str(contacts.parent / "out")]) == 2
    assert "cannot write" in capsys.readouterr().err.splitlines()[-1]
