"""The pages under docs/: every command and every block of code that they show runs as it stands."""

import argparse
import json
import re
import shlex
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.cli.main import build_parser, main

DOCS = Path(__file__).parents[1] / "docs"
GUIDES = ("own-contacts", "own-objects", "own-estimator")
UNRUN = "cluster"  # needs a cluster

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
        ran += language in ("python", "sh") or bool(name)
    return ran


@pytest.mark.parametrize("guide", GUIDES)
def test_blocks_of_a_guide_run(
    guide: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run_page(DOCS / "how-to" / f"{guide}.md", tmp_path) >= 3


@pytest.mark.slow
def test_blocks_of_the_tutorial_run_and_the_page_on_files_names_every_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run_page(DOCS / "tutorial.md", tmp_path) == 4
    page = (DOCS / "reference" / "file-formats.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_A-Z0-9]+)`", page))
    run = tmp_path / "results" / "demo"
    report = json.loads((run / "report.json").read_text())
    keys = {*report, *report["surface"], *report["grasps"], *report["lift"]}
    grasps = json.loads((run / "grasps.json").read_text())
    best = grasps["grasps"][0]
    keys |= {*grasps, *best, *best["contacts"][0], *best["quality"]}
    keys |= {*json.loads((tmp_path / "results" / "gpis" / "lifts.json").read_text())}
    for line in (run / "touches.jsonl").read_text().splitlines()[1:]:
        keys |= {*json.loads(line)}
    keys |= {*np.load(run / "motion.npz")}
    assert keys <= named


@pytest.mark.slow
def test_examples_of_the_command_line_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    page = DOCS / "reference" / "command-line.md"
    assert _run_page(page, tmp_path) >= 6
    (verbs,) = (
        action.choices
        for action in build_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    for verb in verbs:
        assert f"\n## {verb}\n" in page.read_text(encoding="utf-8")


def test_every_guide_is_among_those_that_are_run() -> None:
    pages = {path.stem for path in (DOCS / "how-to").glob("*.md")} - {"index"}
    assert pages == {*GUIDES, UNRUN}


def test_the_readme_s_table_of_the_study_is_the_page_s() -> None:
    def table_of(page: Path, first: str) -> dict[str, list[str]]:
        """Return the cells of the table with a row that begins so, by each row's first cell."""
        lines = page.read_text(encoding="utf-8").split("\n")
        start = next(k for k, line in enumerate(lines) if line.startswith(first))
        rows = takewhile(lambda line: line.startswith("|"), lines[start:])
        cells = [[c.strip() for c in row.replace("**", "").strip("|").split("|")] for row in rows]
        return {name.strip("`"): values for name, *values in cells}

    readme = table_of(DOCS.parent / "README.md", "| `blend` |")
    page = table_of(DOCS / "study.md", "| GPIS |")
    names = {"gpis": "GPIS", "lis` (the paper's)": "LIS"}
    assert {names.get(name, name) for name in readme} == set(page)
    for name, values in readme.items():
        # Planning on the true mesh does not depend on touches: those cells are empty.
        shown = [(k, value) for k, value in enumerate(values) if value]
        assert len(shown) == 3 if name == "the true mesh" else len(shown) == 7
        assert shown == [(k, page[names.get(name, name)][k]) for k, _ in shown], name
