"""The pages under docs/: every command and every block of code that they show runs as it stands."""

import re
import shlex
from pathlib import Path

import pytest

from lis_grasp.cli.main import main

DOCS = Path(__file__).parents[1] / "docs"
GUIDES = ("own-contacts", "own-objects", "own-estimator")

# A fenced block: its language, perhaps the name of the file that it is, and what is in it.
_BLOCK = re.compile(
    r"^```(?:\{code-block\} )?(\w+)\n(?::caption: (\S+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL
)


def _run_page(path: Path, folder: Path) -> int:
    """Run a page's blocks in order, in a folder of their own; return how many ran."""
    space: dict[str, object] = {"__name__": path.stem}
    ran = 0
    for language, name, text in _BLOCK.findall(path.read_text(encoding="utf-8")):
        if name:
            (folder / name).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, str(path), "exec"), space)
        elif language == "sh":
            for line in text.splitlines():
                words = shlex.split(line, comments=True)
                assert not words or words[0] == "lis-grasp", f"{path} shows what is not run: {line}"
                assert not words or main(words[1:]) == 0, line
        ran += 1
    return ran


@pytest.mark.parametrize("guide", GUIDES)
def test_blocks_of_a_guide_run(
    guide: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run_page(DOCS / "how-to" / f"{guide}.md", tmp_path) >= 3


def test_every_guide_is_among_those_that_are_run() -> None:
    pages = {path.stem for path in (DOCS / "how-to").glob("*.md")} - {"index"}
    assert pages == set(GUIDES)
