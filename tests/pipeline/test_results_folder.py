"""Default folders of results, and outdated results in a folder that is used again."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp import Contacts, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.exploration import TouchLog, load_outcomes
from lis_grasp.io import provenance
from lis_grasp.pipeline import RunConfig
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.results.folder import EARLIER, LOG, default_output, made_from, scene_is_outdated
from lis_grasp.task.recorded_facts import read_facts

EXPLORE = ["explore", "box", "--known", "--prober", "kinematic", "--hand", "wsg50"]
EXPLORE += ["--touches", "6"]
AXES = np.vstack([np.eye(3), -np.eye(3)])
LATER = ("grasps.isaac.yaml", "motion.npz", "lifts.json", "report.json", "scene.html", "scene.png")


def files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*.*")}


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explored")
    assert main([*EXPLORE, "--output", str(folder)]) == 0
    return folder


@pytest.fixture
def folder(explored: Path, tmp_path: Path) -> Path:
    """Return a folder with an exploration."""
    return Path(shutil.copytree(explored, tmp_path / "results"))


@pytest.fixture(scope="module")
def estimated(explored: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(shutil.copytree(explored, tmp_path_factory.mktemp("estimated") / "results"))
    assert main(["estimate", str(folder / "contacts.ply")]) == 0
    return folder


@pytest.fixture
def full_folder(estimated: Path, tmp_path: Path) -> Path:
    """Return a folder with the files of all stages, placeholders for those of the later ones."""
    folder = Path(shutil.copytree(estimated, tmp_path / "results"))
    made = {"header": provenance.describe(hand="wsg50")}
    (folder / "grasps.json").write_text(json.dumps(made))
    for name in LATER:
        (folder / name).write_text('{"version": "older"}')
    (folder / "notes.txt").write_text("mine")
    return folder


@pytest.mark.slow
def test_a_stage_moves_the_files_made_from_the_one_it_replaces(
    full_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = full_folder
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    capsys.readouterr()
    assert main(["estimate", str(folder / "contacts.ply"), "--estimator", "lis"]) == 0
    said = capsys.readouterr().out
    moved = sorted(["grasps.json", "surface.ply", *LATER])
    place = folder / EARLIER / "1"
    assert f"moved {', '.join(moved)} to {place}: made from an earlier surface.ply" in said
    assert {path.name: path.read_bytes() for path in place.iterdir()} == {
        name: before[name] for name in moved
    }
    left = {path.name for path in folder.iterdir()}
    made = {".lock", "touches.jsonl", "growth", "contacts.ply", "surface.ply"}
    assert left == {*made, "notes.txt", EARLIER}
    # Now nothing is left to move, and no message is printed.
    assert main(["estimate", str(folder / "contacts.ply"), "--estimator", "gpis"]) == 0
    assert "moved" not in capsys.readouterr().out


@pytest.mark.parametrize("options", [["--seed", "1"], ["--touches", "2"], ["--fresh"]])
def test_a_new_exploration_loses_nothing_of_the_earlier_one(
    full_folder: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, place = full_folder, full_folder / EARLIER / "1"
    before = {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    assert main([*EXPLORE, *options, "--output", str(folder)]) == 0
    assert f"to {place}: made by an earlier exploration" in capsys.readouterr().out
    made = {".lock", "touches.jsonl", "growth", "contacts.ply", "notes.txt", EARLIER}
    assert {*(path.name for path in folder.iterdir()), "growth"} == made
    after = {p.name: p.read_bytes() for p in place.rglob("*") if p.is_file()}
    assert after == {name: before[name] for name in before.keys() - {"notes.txt", ".lock"}}
    assert main([*EXPLORE, "--seed", "2", "--output", str(folder)]) == 0
    assert {path.name for path in (folder / EARLIER).iterdir()} == {"1", "2"}


def test_a_run_remakes_its_own_files_and_sets_those_of_other_options_aside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "results"
    run = ["run", "box", "--known", "--prober", "kinematic", "--hand", "wsg50", "--estimator"]
    run += ["gpis", "--touches", "6", "--grasps", "1", "--output", str(folder)]
    assert main(run) in (0, 1)
    made = {path.name for path in folder.iterdir()}
    before = {path.name: path.read_bytes() for path in folder.glob("*.*") if path.is_file()}
    assert main(run) in (0, 1)  # as an interrupted run does, too
    assert {path.name for path in folder.iterdir()} == made
    assert main([*run, "--attempts", "1"]) in (0, 1)
    aside, said = folder / EARLIER / "1", capsys.readouterr().out
    assert f"to {aside}: made with other options" in said
    assert {path.name for path in folder.iterdir()} == {*made, EARLIER}
    assert {"report.json", "scene.yaml", "surface.ply"} <= {path.name for path in aside.iterdir()}
    for name in ("surface.ply", "grasps.json", "scene.yaml"):
        assert (aside / name).read_bytes() == before[name]


def test_files_next_to_a_foreign_surface_are_kept(tmp_path: Path) -> None:
    own = tmp_path / "surface.ply"
    own.write_text("ply\nformat ascii 1.0\ncomment mine\nend_header\n")
    report = tmp_path / "report.json"
    report.write_text("{}")
    assert made_from(own) == made_from(tmp_path / "contacts.ply") == []  # the second is missing


@pytest.mark.parametrize(
    ("file", "options", "code"),
    [
        ("contacts.ply", ["--position-noise", "-1"], 2),
        ("surface.ply", [], 2),  # an estimate is not taken for its contacts
        ("contacts.ply", [], 0),  # an equal surface keeps what was made from it
    ],
)
def test_a_refused_stage_or_an_equal_surface_changes_no_file(
    file: str, options: list[str], code: int, full_folder: Path
) -> None:
    before = files(full_folder)
    assert main(["estimate", str(full_folder / file), *options]) == code
    assert files(full_folder) == before


def test_a_scene_older_than_its_files_is_outdated(tmp_path: Path) -> None:
    assert scene_is_outdated(tmp_path)
    scene, surface = tmp_path / "scene.html", tmp_path / "surface.ply"
    for path, time in ((scene, 2000), (surface, 1000)):
        path.write_text("")
        os.utime(path, (time, time))
    assert not scene_is_outdated(tmp_path)
    os.utime(surface, (2001, 2001))
    assert scene_is_outdated(tmp_path)


def test_a_page_elsewhere_is_outdated_by_the_report(tmp_path: Path) -> None:
    own, other, report = tmp_path / "scene.html", tmp_path / "a" / "scene.html", "report.json"
    other.parent.mkdir()
    for path, time in ((own, 1000), (other, 1000), (tmp_path / report, 2000)):
        path.write_text("")
        os.utime(path, (time, time))
    assert scene_is_outdated(tmp_path, other)
    assert not scene_is_outdated(tmp_path, own)  # written with the report, just before it


def test_view_writes_an_outdated_scene_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = folder / "scene.html"
    scene.write_text("older")
    os.utime(scene, (1000, 1000))
    monkeypatch.setattr("lis_grasp.visualization.serve_scene", lambda *_, **__: None)
    assert main(["view", str(folder)]) == 0
    assert scene.stat().st_size > 10_000
    made = scene.stat().st_mtime_ns
    assert main(["view", str(folder)]) == 0
    assert scene.stat().st_mtime_ns == made


def test_view_renews_the_scene_when_a_file_becomes_newer(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []

    def serve(directory: Path, *, renew: Callable[[], None], **_: object) -> None:
        scene = directory / "scene.html"
        before = scene.stat().st_mtime_ns
        renew()
        unchanged = scene.stat().st_mtime_ns == before
        later = before + 10**9
        os.utime(folder / "contacts.ply", ns=(later, later))
        renew()
        found.extend([unchanged, scene.stat().st_mtime_ns == before])

    monkeypatch.setattr("lis_grasp.visualization.serve_scene", serve)
    assert main(["view", str(folder)]) == 0
    assert found == [True, False]


def test_view_shows_a_folder_that_cannot_be_written_to(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = []

    def serve(directory: Path, **_: object) -> None:
        shown.append((directory, (directory / "scene.html").stat().st_size))

    monkeypatch.setattr("lis_grasp.visualization.serve_scene", serve)
    monkeypatch.setattr("os.access", lambda *_: False)
    assert main(["view", str(folder)]) == 0
    ((directory, size),) = shown
    assert directory != folder
    assert size > 10_000
    assert not (folder / "scene.html").exists()
    assert not directory.exists()


@pytest.mark.slow
def test_a_log_of_another_source_is_not_resumed(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [*EXPLORE, "--output", str(folder)]
    log = folder / LOG
    whole = log.read_bytes()
    interrupted = b"".join(whole.splitlines(keepends=True)[:4])  # the header and three probes
    log.write_bytes(interrupted)
    capsys.readouterr()
    assert main(arguments) == 0
    assert "after 3 probes" in capsys.readouterr().out
    assert log.read_bytes() == whole

    log.write_bytes(interrupted)
    monkeypatch.setattr(provenance, "source_digest", lambda *_: "another")
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "starting from the beginning: lis_grasp itself was edited" in said
    assert "resuming" not in said
    assert len(load_outcomes(log)) >= 6


def test_a_finished_exploration_is_used_again(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, contacts = folder / LOG, folder / "contacts.ply"
    before = log.read_bytes(), contacts.read_bytes()
    monkeypatch.setattr(KinematicProber, "probe", None)  # a new probe would fail
    capsys.readouterr()
    assert main([*EXPLORE, "--output", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"probes of the same exploration in {log}" in said
    assert (log.read_bytes(), contacts.read_bytes()) == before


def test_the_same_exploration_again_keeps_what_was_made_from_it(
    full_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files(full_folder)
    capsys.readouterr()
    assert main([*EXPLORE, "--output", str(full_folder)]) == 0
    assert files(full_folder) == before
    assert "removed" not in capsys.readouterr().out


def test_recorded_files_are_found_from_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shapes.find("box").mesh.export(tmp_path / "part.stl")
    made = {"header": provenance.describe(object="part.stl", hand="wsg50", arm="iiwa14")}
    results, elsewhere = tmp_path / "results" / "part", tmp_path / "elsewhere"
    for folder in (results, elsewhere):
        folder.mkdir(parents=True)
    (results / "grasps.json").write_text(json.dumps(made))
    monkeypatch.chdir(tmp_path)
    assert read_facts(results / "grasps.json")["object"] == "part.stl"
    monkeypatch.chdir(elsewhere)
    facts = read_facts(Path("../results/part/grasps.json"))
    assert Path(facts["object"]).resolve() == tmp_path / "part.stl"
    assert (facts["hand"], facts["arm"]) == ("wsg50", "iiwa14")
    (tmp_path / "part.stl").unlink()
    facts = read_facts(results / "grasps.json")
    with pytest.raises(InvalidFileError) as error:
        shapes.find(facts["object"])
    assert error.value.path == Path("part.stl")


def test_changed_facts_of_a_log_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "touches.jsonl"
    assert TouchLog(path, {"seed": 1}).read().changes == {}
    path.write_text('{"touch_log": 0, "seed": 1, "hand": "a"}\n{"row": 1}\n')
    changed = {"seed": (1, 2), "touch_log": (0, 1)}
    assert TouchLog(path, {"seed": 2, "hand": "a"}).read().changes == changed
    path.write_text('{"touch_log": 1, "seed": 1}\n{"ended": "8 contacts made"}\n')
    assert TouchLog(path, {"seed": 2}).read().changes == {"seed": (1, 2)}
    assert TouchLog(path, {"seed": 1}).read().changes == {}


def test_every_option_gives_a_default_folder_of_its_own() -> None:
    options = {
        "object": "mallet",
        "size": 0.2,
        "units": "mm",
        "up": "y",
        "hand": "wsg50",
        "estimator": "lis",
        "prober": "kinematic",
        "free": True,
        "policy": "frontier",
        "until_coverage": 0.5,
        "until_success": 0.9,
        "load": "unknown",
        "until_uncertainty": 0.001,
        "max_seconds": 9.0,
        "slide": 0.02,
        "position_noise": 0.001,
        "normal_noise": 0.001,
        "force_threshold": 0.1,
        "taxel_pitch": 0.003,
        "miss_rate": 0.1,
        "false_rate": 0.1,
        "reports": "touch",
        "pose": "upright",
        "free_space": False,
        "cloud": "cloud.ply",
        "touches": 41,
        "seed": 1,
        "mass": 0.3,
        "friction": 0.7,
        "grasps": 11,
        "world": "shelf.stl",
        "body_error": 0.002,
        "keep_all": True,
        "attempts": 4,
        "closings": 2,
        "simulator": "mujoco",
        "place": "table",
        "arm": "iiwa14",
        "camera": True,
        "views": ("view.npz",),
    }
    based = {"arm": "iiwa14", "base": (-0.5, 0.0, 0.1)}
    every = {"fingers": "all", "prober": "kinematic"}
    placed = {"world": "shelf.stl", "at": "0.1 0 0"}
    unknown = {**UNKNOWN, "region": (0.4, 0.4, 0.3)}
    assert {*options, *based, *every, *placed, *unknown} == set(RunConfig().facts())
    configs = [RunConfig(**{name: value}) for name, value in options.items()]
    configs += [RunConfig(), RunConfig(**based), RunConfig(**every), RunConfig(**placed)]
    configs += [RunConfig(**unknown)]
    configs += [RunConfig(**{**unknown, "region": (0.5, 0.4, 0.3)})]
    names = {default_output(config) for config in configs}
    assert len(names) == len(configs)
    assert default_output(RunConfig(**unknown)) == Path("results/box-allegro-blend-seed0")
    assert default_output(RunConfig()) == Path("results/box-allegro-blend-seed0-known")


def test_a_mesh_of_the_same_name_does_not_replace_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        box.export(tmp_path / name / "part.stl")
    options = EXPLORE[2:]
    assert main(["explore", "a/part.stl", *options]) == 0
    (made,) = (tmp_path / "results").iterdir()
    before = files(made)
    capsys.readouterr()
    assert main(["explore", "b/part.stl", *options]) == 2
    assert "results of another object (a/part.stl)" in capsys.readouterr().err
    assert files(made) == before


def test_an_exploration_of_another_object_is_not_replaced(
    full_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files(full_folder)
    options = ["--output", str(full_folder)]
    assert main(["explore", "pentagon", *EXPLORE[2:], *options]) == 2
    assert "another object (box)" in capsys.readouterr().err
    own = full_folder.parent / "own.csv"
    Contacts(0.03 * AXES, AXES).save(own)
    assert main(["estimate", str(own), *options]) == 2
    assert "--output" in capsys.readouterr().err
    assert files(full_folder) == before


@pytest.mark.parametrize("name", ["contacts.ply", "surface.ply", "grasps.json", "report.json"])
def test_files_of_other_programs_are_not_replaced(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign = tmp_path / name
    foreign.write_text("{}" if foreign.suffix == ".json" else "ply\nend_header\n")
    before = foreign.read_bytes()
    assert main([*EXPLORE, "--output", str(tmp_path)]) == 2
    assert f"{foreign} would be replaced" in capsys.readouterr().err
    assert files(tmp_path) == {foreign: before}


def test_a_refused_run_makes_no_folder(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    for arguments in (["run", "nothing.stl"], ["run", "box", "--hand", "none.yaml"]):
        assert main([*arguments, "--output", str(folder)]) == 2
    assert not folder.exists()


def test_contacts_of_an_estimate_are_kept_beside_it(tmp_path: Path) -> None:
    own, folder = tmp_path / "own.csv", tmp_path / "results"
    estimate = ["estimate", str(own), "--units", "mm", "--output", str(folder)]
    Contacts(30.0 * AXES, AXES).save(own)
    assert main(estimate) == 0
    np.testing.assert_allclose(Contacts.load(folder / "contacts.ply").points, 0.03 * AXES)
    # Later contacts replace them, and what was made from them is set aside.
    (folder / "scene.html").write_text("older")
    Contacts(40.0 * AXES, AXES).save(own)
    assert main(estimate) == 0
    np.testing.assert_allclose(Contacts.load(folder / "contacts.ply").points, 0.04 * AXES)
    aside = folder / EARLIER / "1"
    np.testing.assert_allclose(Contacts.load(aside / "contacts.ply").points, 0.03 * AXES)
    assert {path.name for path in folder.iterdir()} == {"contacts.ply", "surface.ply", EARLIER}
    assert {p.name for p in aside.iterdir()} == {"contacts.ply", "surface.ply", "scene.html"}


def test_contacts_in_other_units_do_not_stand_beside_their_surface(tmp_path: Path) -> None:
    own = tmp_path / "contacts.ply"
    Contacts(30.0 * AXES, AXES).save(own, header=provenance.describe())
    before = own.read_bytes()
    assert main(["estimate", str(own), "--units", "mm"]) == 2
    assert files(tmp_path) == {own: before}
    elsewhere = tmp_path / "elsewhere"
    assert main(["estimate", str(own), "--units", "mm", "--output", str(elsewhere)]) == 0
    assert main(["estimate", str(elsewhere / "contacts.ply")]) == 0
