"""Documentation tests: commands and code blocks of README.md and docs/ run as shown."""

import argparse
import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from lis_grasp import GraspSearch
from lis_grasp.cli.main import build_parser, main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
GUIDES = (
    "own-contacts",
    "robot-logs",
    "own-objects",
    "own-estimator",
    "own-policy",
    "own-planner",
    "own-diagram",
    "arm",
    "real-robot",
    "moveit",
    "unknown-place",
    "see",
    "world",
    "place",
)
UNRUN = {"cluster", "second-simulator", "benchmark"}  # need a cluster, MuJoCo, minutes

# A fenced block: its language, the name of the file that it becomes (optional), and its content.
_BLOCK = re.compile(
    r"^```(?:\{code-block\} )?(\w+)\n(?::caption: (\S+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL
)


def _run_page(path: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """Run a page's blocks in order, in an empty folder; return their number.

    A block of text after one of commands is their output.
    """
    space: dict[str, object] = {"__name__": path.stem}
    ran, before = 0, ""
    for language, name, text in _BLOCK.findall(path.read_text(encoding="utf-8")):
        if language == "text" and before == "sh" and not name:
            printed = capsys.readouterr().out.splitlines()
            for line in text.splitlines():
                assert line in printed, f"{path}: no command prints {line!r}"
        before = language
        if name:
            (folder / name).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, str(path), "exec"), space)
        elif language == "sh":
            for line in text.splitlines():
                words = shlex.split(line, comments=True)
                assert not words or words[0] == "lis-grasp", f"{path}: {line}"
                assert not words or main(words[1:]) == 0, line
        ran += language in ("python", "sh") or bool(name)
    return ran


@pytest.mark.slow  # examples and the command line's tests cover their steps
@pytest.mark.parametrize("guide", GUIDES)
def test_blocks_of_a_guide_run(
    guide: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))  # blocks import the files of others
    assert _run_page(DOCS / "how-to" / f"{guide}.md", tmp_path, capsys) >= 2


@pytest.mark.slow
def test_tutorial_runs_and_file_formats_page_names_every_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert _run_page(DOCS / "tutorial.md", tmp_path, capsys) == 4
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
    assert _run_page(page, tmp_path, capsys) >= 6
    (verbs,) = (
        action.choices
        for action in build_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    for verb in verbs:
        assert f"\n## {verb}\n" in page.read_text(encoding="utf-8")


def test_every_guide_is_run() -> None:
    pages = {path.stem for path in (DOCS / "how-to").glob("*.md")} - {"index"}
    assert pages == {*GUIDES, *UNRUN}


@pytest.mark.slow
def test_readme_examples_run_on_the_contacts_of_the_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").mkdir()
    shutil.copy(ROOT / "examples" / "contacts.csv", "examples")
    for line in _readme_commands():
        words = shlex.split(line, comments=True)[1:]
        if words[0] in ("estimate", "grasp", "next"):
            assert main(words) == 0, line
    assert (tmp_path / "results" / "own" / "next.json").exists()
    blocks = _BLOCK.findall(README.read_text(encoding="utf-8"))
    (example,) = [text for language, _, text in blocks if language == "python"]
    space: dict[str, object] = {}
    exec(compile(example, str(README), "exec"), space)
    assert isinstance(space["search"], GraspSearch)
    assert len(space["search"].grasps) > 0


def _readme_commands() -> list[str]:
    return [
        line
        for language, _, text in _BLOCK.findall(README.read_text(encoding="utf-8"))
        if language == "sh"
        for line in text.splitlines()
        if line.startswith("lis-grasp")
    ]


def test_readme_commands_parse() -> None:
    lines = _readme_commands()
    assert len(lines) == 8
    for line in lines:
        build_parser().parse_args(shlex.split(line, comments=True)[1:])


def test_contributing_describes_every_folder() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    folders = [path.parent.name for path in (ROOT / "lis_grasp").glob("*/__init__.py")]
    assert len(folders) > 10
    for folder in folders:
        assert f"| `{folder}/` |" in page, folder


def test_readme_is_short() -> None:
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 100
    assert sum(map(str.isdigit, text)) <= 60


def test_front_page_fits_on_one_screen() -> None:
    page, _, _ = (DOCS / "index.md").read_text(encoding="utf-8").partition("```{toctree}")
    assert len(page.splitlines()) <= 75


def test_questions_and_terms_that_users_ask_for_are_answered() -> None:
    page = (DOCS / "faq.md").read_text(encoding="utf-8")
    for word in ("hand", "robot", "contacts", "GPU", "display", "camera", "Windows"):
        assert re.search(rf"^\*\*[^*]*\b{word}[^*]*\?\*\*", page, re.MULTILINE), word
    terms = (DOCS / "reference" / "glossary.md").read_text(encoding="utf-8")
    for term in ("LIS", "GPIS", "Epsilon", "Force closure", "Held", "Pad", "Policy", "Probe"):
        assert f"\n{term}\n" in terms
