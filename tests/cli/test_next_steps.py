"""Advice on what to do next: each command runs as it is printed, in a folder with a space."""

import io
import re
import shlex
import shutil
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
import trimesh
from touch_recording import record, write_csv

import lis_grasp
import lis_grasp_studies
from lis_grasp.cli import next_probe
from lis_grasp.cli.main import build_parser, main
from lis_grasp.cli.progress import next_step
from lis_grasp.results.page import scene_of
from lis_grasp.robots.shipped_models import model_path

HAND = ["--hand", "wsg50", "--known", "--prober", "kinematic"]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder whose name has a space and a quote, which is the current one."""
    place = tmp_path / "my lab's results"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


def _advice(capsys: pytest.CaptureFixture[str], *command: object, code: int = 0) -> str:
    """Run a command; return the words after "next:" on its last line of advice."""
    assert main([str(word) for word in command]) == code
    captured = capsys.readouterr()
    (line,) = re.findall(r"^next: (.*)$", captured.out + captured.err, re.MULTILINE)
    return line


def _commands(advice: str) -> list[list[str]]:
    """Return the words of each command of the package in an advice; the parser takes them all."""
    commands = []
    for part in re.split(r", or: |; then edit the YAML and check it: ", advice):
        words = shlex.split(part)
        if words[0] == "lis-grasp":
            build_parser(words[1]).parse_args(words[1:])
            commands.append(words[1:])
        else:
            assert words[0] in ("open", "read")
            assert Path(words[1]).exists(), part
    return commands


def test_the_advice_of_each_stage_runs_the_next_one(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    advice = _advice(
        *(capsys, "explore", "box", *HAND, "--touches", 8, "--estimator", "gpis"),
        *("--output", place / "a box"),
    )
    verbs = []
    for _ in range(2):  # the lift of the third is slow
        (command,) = _commands(advice)
        verbs.append(command[0])
        more = ["--grasps", "1"] if command[0] == "grasp" else []
        advice = _advice(capsys, *command, *more)
    assert verbs == ["estimate", "grasp"]
    assert _commands(advice) == [["lift", str(place / "a box" / "grasps.json")]]


@pytest.mark.slow
def test_a_run_and_a_lift_advise_to_look_at_their_folder(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = place / "a box"
    advice = _advice(capsys, "run", "box", *HAND, "--touches", 12, "--output", folder)
    assert _commands(advice) == [["view", str(folder)]]
    advice = _advice(capsys, "lift", folder / "grasps.json")
    assert _commands(advice) == [["view", str(folder)]]


@pytest.mark.slow
def test_a_surface_of_an_unknown_object_is_to_be_looked_at(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(Path(__file__).parents[2] / "examples" / "contacts.csv", place / "my contacts.csv")
    advice = _advice(capsys, "estimate", "my contacts.csv", "--output", place)
    (command,) = _commands(advice)
    advice = _advice(capsys, *command, "--hand", "wsg50", "--grasps", 1)
    assert _commands(advice) == [["view", str(place)]]
    too_high = ["--support", "0.137", "--output", "none found"]
    advice = _advice(capsys, *command, *too_high, "--hand", "wsg50", code=1)
    (part,) = re.findall("(lis-grasp view .*) shows the surface", advice)
    assert _commands(part) == [["view", str(place)]]


@pytest.mark.slow
def test_grasps_in_another_folder_than_their_mesh_are_to_be_lifted_then_looked_at(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trimesh.creation.box([0.05, 0.06, 0.08]).export("my box.stl")
    command = ("grasp", "my box.stl", "--hand", "wsg50", "--grasps", 1, "--output", "grasps of it")
    (lift,) = _commands(_advice(capsys, *command))
    assert lift == ["lift", "grasps of it/grasps.json", "--object", "my box.stl"]
    for folder in ("grasps of it", "lifts of it"):
        advice = _advice(capsys, *lift, "--output", folder)
        assert _commands(advice) == [["view", folder]]
        truth = scene_of(place / folder).truth
        assert truth is not None
        assert truth.extents == pytest.approx([0.05, 0.06, 0.08])


@pytest.mark.slow
def test_a_hand_is_to_be_looked_at_and_checked(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(model_path("hands/wsg50"), place / "a hand")
    output = place / "a hand" / "draft.yaml"
    new = ("hand", "new", place / "a hand" / "wsg50.urdf", "--output", output)
    view, run = _commands(_advice(capsys, *new))
    assert run == ["run", "box", "--hand", str(output)]
    advice = _advice(capsys, *view, "--output", place / "a hand" / "page.html")
    assert _commands(advice) == [["doctor", "--hand", str(output)]]


def test_a_log_and_a_scene_file_are_to_be_used(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_csv(record(), place / "a log.csv")
    command = ("contacts", log, "--tip", "tip", "--object-pose", "object", "--normals", "approach")
    advice = _advice(capsys, *command, "--output", place / "a log.ply")
    assert _commands(advice) == [["estimate", str(place / "a log.ply")]]
    advice = _advice(capsys, "explore", "box", *HAND, "--write-scene", "a scene.yaml")
    assert _commands(advice) == [["run", "a scene.yaml"]]


def test_an_exploration_without_contact_is_to_be_looked_at(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lis_grasp.cli.explore.exploration_lines", lambda facts: [])

    class Nothing:
        contacts, ended = (), "nothing"

    made = (None, Nothing())
    monkeypatch.setattr("lis_grasp.cli.explore.explore_object", lambda *_, **__: made)
    monkeypatch.setattr("lis_grasp.cli.explore.exploration_facts", lambda *_: {})
    monkeypatch.setattr("lis_grasp.cli.explore.view_facts", lambda *_: {})
    advice = _advice(capsys, "explore", "box", *HAND, "--output", "nothing there", code=1)
    (part,) = re.findall("(lis-grasp view .*) shows where", advice)
    assert _commands(part) == [["view", "nothing there"]]


def test_a_service_names_its_log(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Requests:
        buffer = io.BytesIO(b'{"status": "touched", "points": [[0.03, 0, 0]],'
                            b' "normals": [[1, 0, 0]]}\n{"request": "stop"}\n')  # fmt: skip

    monkeypatch.setattr(sys, "stdin", Requests())
    monkeypatch.setattr(next_probe, "_own_output", lambda: nullcontext(io.BytesIO()))
    options = ("--hand", "wsg50", "--center", 0, 0, 0, "--size", 0.06, "--output", place)
    advice = _advice(capsys, "next", "--serve", *options)
    assert shlex.split(advice.partition(" as CONTACTS")[0])[-1] == str(place / "touches.jsonl")


def test_advice_is_made_in_one_place() -> None:
    assert shlex.split(next_step("open {0}, {0}", Path("a b/c'd")))[2:] == ["a b/c'd,", "a b/c'd"]
    for package in (lis_grasp, lis_grasp_studies):
        for path in Path(package.__file__).parent.glob("cli/*.py"):
            found = re.findall(r'"next: ', path.read_text(encoding="utf-8"))
            assert len(found) == (path.name == "progress.py" and package is lis_grasp), path
