"""Command line: exit codes, one-sentence messages, files, equal bytes."""

import argparse
import errno
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh
from random_directions import random_directions
from threadpoolctl import threadpool_info, threadpool_limits

import lis_grasp
from lis_grasp import GraspSearch, Hand, RunConfig, shapes
from lis_grasp.cli.main import build_parser, main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    EstimationError,
    InvalidFileError,
    InvalidHandError,
    InvalidOptionError,
    SimulationError,
    nearest_of,
)
from lis_grasp.exploration.planar_motion import planar_pose
from lis_grasp.exploration.touch_log import read_log
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface
from lis_grasp.motion import OBJECT, Motion
from lis_grasp.results.page import scene_of
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.visualization._drawing import OBJECT_NODE, Canvas, animate
from lis_grasp.visualization.hand_layers import draw_motion
from lis_grasp_studies.harness.parquet import read_parquet
from lis_grasp_studies.harness.rows import TrialResults

NEEDS_STUDY = pytest.mark.skipif(find_spec("pyarrow") is None, reason="needs lis-grasp[study]")
CUBE_AXES = np.vstack([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with six contacts of a cube, the surface, and grasps of a gripper."""
    folder = tmp_path_factory.mktemp("cube")
    rows = np.hstack([0.03 * CUBE_AXES, CUBE_AXES])
    path = folder / "contacts.csv"
    np.savetxt(path, rows, delimiter=",", header="x,y,z,nx,ny,nz", comments="")
    assert main(["estimate", str(path), "--output", str(folder)]) == 0
    assert main(["grasp", str(folder / "surface.ply"), "--hand", "wsg50", "--grasps", "1"]) == 0
    return folder


def _misuse(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    message = capsys.readouterr().err
    assert "Traceback" not in message
    assert message.count("\n") == 1, "a mistake gets one sentence"
    return message


def test_own_contacts_become_a_closed_surface_and_grasps(cube: Path) -> None:
    mesh = load_surface(cube / "surface.ply")
    assert mesh.is_watertight
    # Six contacts on the faces of a 6 cm cube show no edge: the estimate is the ball inside.
    assert mesh.volume == pytest.approx(np.pi / 6.0 * 0.06**3, rel=0.01)
    grasps = json.loads((cube / "grasps.json").read_text())
    assert len(grasps["grasps"]) == 1


def test_a_command_computes_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[int] = []

    def execute(options: argparse.Namespace) -> None:
        counts.extend(pool["num_threads"] for pool in threadpool_info())

    monkeypatch.setattr("lis_grasp.cli.doctor.execute", execute)
    with threadpool_limits(2):
        assert main(["doctor"]) == 0
    assert set(counts) == {1}


@pytest.mark.slow
def test_the_number_of_threads_changes_no_byte(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    normals = random_directions(60, rng)
    points = 0.04 * normals + rng.normal(scale=0.001, size=(60, 3))
    Contacts(points, normals).save(tmp_path / "contacts.ply")
    written = []
    for threads in ("1", "2"):
        output = tmp_path / threads
        subprocess.run(
            [
                *(sys.executable, "-m", "lis_grasp.cli.main", "estimate"),
                *(str(tmp_path / "contacts.ply"), "--estimator", "gpis", "--output", str(output)),
            ],
            env={**os.environ, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads},
            check=True,
            capture_output=True,
        )
        written.append((output / "surface.ply").read_bytes())
    assert written[0] == written[1]


def test_a_missing_file_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert "absent.ply" in _misuse(capsys, "estimate", "absent.ply")
    assert "absent.stl" in _misuse(capsys, "grasp", "absent.stl")
    assert "absent.json" in _misuse(capsys, "lift", "absent.json")
    assert "absent" in _misuse(capsys, "view", "absent")


@pytest.mark.parametrize(
    "arguments",
    [["run", "{}.stl"], ["explore", "{}"], ["grasp", "{}.ply"], ["view", "{}"]]
    + [["doctor", "--hand", "{}"], ["explore", "box", "--hand", "{}.yaml"]],
)
def test_a_name_longer_than_a_file_may_have_is_one_sentence(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    name = "9" * 400
    assert name in _misuse(capsys, *(argument.format(name) for argument in arguments))


@pytest.mark.parametrize(
    ("verb", "name"),
    [("grasp", "surface.ply"), ("export", "surface.ply"), ("estimate", "contacts.ply")]
    + [("next", "contacts.ply"), ("lift", "grasps.json"), ("motion", "grasps.json")],
)
def test_a_folder_in_place_of_a_file_is_answered_with_the_file_in_it(
    verb: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).touch()
    assert str(tmp_path / name) in _misuse(capsys, verb, str(tmp_path))


@pytest.mark.parametrize("name", ["contacts.csv", "points.ply"])
def test_points_in_place_of_a_mesh_are_referred_to_estimate(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for header in ("", provenance.describe(object="box")):  # its own PLY files are read apart
        Contacts(0.03 * CUBE_AXES, CUBE_AXES).save(tmp_path / name, header=header)
        assert f"estimate {tmp_path / name}" in _misuse(capsys, "grasp", str(tmp_path / name))


def test_an_unknown_name_lists_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    for words, known in ((["teapot"], "mallet"), (["box", "--hand", "claw"], "allegro")):
        message = _misuse(capsys, "explore", *words)
        assert words[-1] in message
        assert known in message


@pytest.mark.parametrize(
    "arguments",
    [["--touches", "0"], ["--seed", "-1"], ["--size", "0"], ["--size", "nan"]],
)
def test_options_out_of_range_are_refused_before_work(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    _misuse(capsys, "explore", "box", *arguments)


@pytest.mark.parametrize("height", ["nan", "inf", "1e13"])
def test_a_support_is_a_height(height: str, cube: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (cube / "grasps.json").read_bytes()
    assert "support" in _misuse(capsys, "grasp", str(cube / "surface.ply"), "--support", height)
    assert (cube / "grasps.json").read_bytes() == before


def test_a_log_is_not_replaced_by_its_contacts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time,force,x,y,z\n0,0,0,0,0\n0.01,2,0,0,0.1\n")
    before = log.read_bytes()
    assert main(["contacts", str(log), "--output", str(log), "--normals", "approach"]) == 2
    assert "another file than the log" in capsys.readouterr().err
    assert log.read_bytes() == before


def test_contacts_without_a_row_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "none.csv").write_text("x,y,z,nx,ny,nz\n")
    assert "none.csv has no contacts" in _misuse(capsys, "estimate", str(tmp_path / "none.csv"))


def test_a_scene_of_an_object_that_is_elsewhere_lacks_it(cube: Path, tmp_path: Path) -> None:
    facts = {"object": str(tmp_path / "gone.stl"), "hand": "wsg50"}
    Contacts.load(cube / "contacts.ply").save(
        tmp_path / "contacts.ply", header=provenance.describe(**facts)
    )
    with pytest.raises(InvalidFileError):
        shapes.find(facts["object"], size=None)
    assert scene_of(tmp_path).truth is None


def test_a_scene_shows_an_object_where_touches_left_it(cube: Path, tmp_path: Path) -> None:
    X_WO, X_EO = (planar_pose(np.array(d)) for d in ([0.1, 0.0, 0.3], [-0.02, 0.01, 0.7]))
    header = provenance.describe(object="box", hand="wsg50", X_WO=X_WO.tolist(), X_EO=X_EO.tolist())
    Contacts.load(cube / "contacts.ply").save(tmp_path / "contacts.ply", header=header)
    truth = scene_of(tmp_path).truth
    assert truth is not None
    expected = trimesh.transform_points(shapes.find("box", size=None).mesh.vertices, X_EO @ X_WO)
    np.testing.assert_allclose(truth.vertices, expected, atol=1e-12)
    # The lift begins there, and moves what is drawn from there on.
    turns = np.stack([X_EO, planar_pose(np.array([0.0, 0.0, 0.1])) @ X_EO])
    motion = Motion(np.array([0.0, 1.0]), {OBJECT: turns})
    canvas = Canvas()
    draw_motion(canvas, motion, Hand.load("wsg50"))
    played = animate(motion.times, [(OBJECT_NODE, turns @ np.linalg.inv(X_EO))])
    assert canvas.commands == [played]


def test_an_empty_folder_has_no_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no results" in _misuse(capsys, "view", str(tmp_path))


def test_grasps_of_an_unknown_object_need_the_option_object(
    cube: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "--object" in _misuse(capsys, "lift", str(cube / "grasps.json"))


@pytest.mark.parametrize(
    ("raised", "code"),
    [(None, 0), (SimulationError("x"), 1), (InvalidHandError("x"), 2), (KeyboardInterrupt(), 130)],
)
def test_exit_codes(
    raised: BaseException | None,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def execute(options: argparse.Namespace) -> None:
        if raised is not None:
            raise raised

    monkeypatch.setattr("lis_grasp.cli.doctor.execute", execute)
    assert main(["doctor"]) == code
    assert capsys.readouterr().err.count("\n") == (raised is not None)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["lis", "gpis"])
def test_stages_run_alone_repeat_the_run_byte_for_byte(
    estimator: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = ["--touches", "15", "--seed", "1", "--estimator", estimator]
    run, alone = tmp_path / "run", tmp_path / "alone"
    # A test of a grasp, or a further attempt, would add contacts.
    once = ["--attempts", "1", "--closings", "0"]
    assert main(["run", "box", *chosen, *once, "--output", str(run)]) == 0
    assert main(["explore", "box", *chosen, "--output", str(alone)]) == 0
    assert main(["estimate", str(alone / "contacts.ply")]) == 0
    capsys.readouterr()
    assert main(["grasp", str(alone / "surface.ply")]) == 0
    assert ("success is predicted too high" in capsys.readouterr().out) == (estimator == "lis")
    for name in ("contacts.ply", "surface.ply", "grasps.json"):
        assert (run / name).read_bytes() == (alone / name).read_bytes(), name
    assert len(Contacts.load(run / "contacts.ply")) == 15
    report = json.loads((run / "report.json").read_text())
    assert report["touches"] == 15
    assert report["surface"]["watertight"]
    if report["grasps"]["number"]:
        assert main(["lift", str(alone / "grasps.json")]) == 0
        lifts = json.loads((alone / "lifts.json").read_text())["lifts"]
        assert lifts[0]["held"] == report["lift"]["held"]
        assert lifts[0]["slip"] == report["lift"]["slip"]


@pytest.mark.slow
def test_sensor_noise_is_recorded_and_given_to_the_estimator(tmp_path: Path) -> None:
    options = ["--known", "--hand", "wsg50", "--prober", "kinematic", "--touches", "12"]
    options += ["--position-noise", "0.002"]
    assert main(["explore", "box", *options, "--output", str(tmp_path)]) == 0
    path = tmp_path / "contacts.ply"
    assert provenance.read(path)["position_noise"] == 0.002
    box = shapes.build("box")
    noisy = Contacts.load(path)
    off = distances_to_mesh(noisy.points, box.mesh)[0]
    assert 0.0005 < np.sqrt(np.mean(off**2)) < 0.004  # 2 mm along the normal
    assert main(["estimate", str(path)]) == 0
    surface = tmp_path / "surface.ply"
    recorded = load_surface(surface).vertex_attributes["uncertainty"].min()
    # Each contact keeps its own noise; the option is for those without.
    assert main(["estimate", str(path), "--position-noise", "0.004"]) == 0
    assert load_surface(surface).vertex_attributes["uncertainty"].min() == recorded
    plain, surface = tmp_path / "plain" / "plain.csv", tmp_path / "plain" / "surface.ply"
    plain.parent.mkdir()
    Contacts(noisy.points, noisy.normals).save(plain)
    assert main(["estimate", str(plain), "--position-noise", "0.004"]) == 0
    # Near contacts, where the noise dominates.
    assert load_surface(surface).vertex_attributes["uncertainty"].min() > 1.02 * recorded


@pytest.mark.slow
def test_contacts_of_failed_attempts_are_kept_in_the_results(tmp_path: Path) -> None:
    # After six touches of a pentagon the first grasp of this seed fails.
    arguments = ["--known", "--seed", "3", "--touches", "6", "--prober", "kinematic"]
    assert main(["run", "pentagon", *arguments, "--output", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    failed = report["attempts"][:-1]
    assert failed
    last = report["attempts"][-1]
    assert last["reason"] == report["lift"]["reason"]
    grasps = GraspSearch.load(tmp_path / "grasps.json")
    assert last["family"] == grasps[last["grasp"] - 1].family
    count = 6
    for lesson in (attempt["lesson"] for attempt in failed):
        count = lesson["touched"] + (0 if lesson["lost"] else count + lesson["felt"])
    assert len(Contacts.load(tmp_path / "contacts.ply")) == count
    # The files are those of the last attempt.
    again = tmp_path / "again"
    assert main(["estimate", str(tmp_path / "contacts.ply"), "--output", str(again)]) == 0
    assert (again / "surface.ply").read_bytes() == (tmp_path / "surface.ply").read_bytes()


def test_help_loads_no_module_of_a_verb() -> None:
    code = (
        "import sys\nfrom lis_grasp.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'lis_grasp.cli.run')))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_a_mistyped_option_gets_the_nearest_one(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["run", "box", "--tuches", "5"])
    assert end.value.code == 2
    message = capsys.readouterr().err
    assert message.startswith("lis-grasp run: unrecognized arguments: --tuches 5")
    assert "did you mean '--touches'?" in message


@pytest.mark.parametrize(
    ("value", "nearest"),
    [
        ("--tuches", "--touches"),
        ("--random-seed", "--seed"),
        ("--n_grasps", "--grasps"),
        ("--positon-noise", "--position-noise"),
        ("--noise", "--position-noise"),
        ("--gripper", "--hand"),
        ("--method", "--estimator"),
        ("--suction", "--hand"),
        ("--resume", None),
        ("--format", None),
        ("--headless", None),
        ("--top", None),
        ("--resolution", None),
    ],
)
def test_only_a_similar_option_or_one_of_its_words_is_suggested(
    value: str, nearest: str | None
) -> None:
    options = ["--touches", "--seed", "--hand-eye", "--grasps", "--mass", "--up", "--estimator"]
    others = ["--position-noise", "--friction", "--pose", "--hand", "--free", "--normals"]
    suggestion = nearest_of(value, [*options, *others])
    assert suggestion == (f": did you mean '{nearest}'?" if nearest else "")


def test_a_file_where_a_folder_is_asked_for_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "surface.stl"
    with pytest.raises(SystemExit) as end:
        main(["estimate", "examples/contacts.csv", "--output", str(file)])
    assert end.value.code == 2
    assert "--output must be a folder" in capsys.readouterr().err
    assert not file.exists()


@pytest.mark.parametrize(
    ("verb", "name", "text", "cure"),
    [
        ("estimate", "rag.csv", "x,y,z\n1,2", "give every row as many"),
        ("estimate", "rag.csv", "x,y,z\n0,1;0,2;0,3", "write a decimal point"),
        ("estimate", "n.csv", "x,y,z,n1,n2,n3\n0,0,0,0,0,1", "columns nx,ny,nz or ax,ay,az"),
        (
            "estimate --estimator absent:A",
            "c.csv",
            "x,y,z,nx,ny,nz\n0,0,0,0,0,1",
            "put absent",
        ),
        ("hand new", "part.stl", "\0\xff", "give a URDF, SDF or MJCF"),
        ("next", "grasps.json", "{}", "name {}/contacts.ply"),
        ("lift", "grasps.json", "{}", "name a grasps.json of `lis-grasp grasp`"),
        ("lift", "contacts.ply", "ply", "name a grasps.json of `lis-grasp grasp`"),
    ],
)
def test_a_mistake_is_answered_with_its_cure(
    verb: str, name: str, text: str, cure: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "contacts.ply").touch()
    (tmp_path / name).write_text(text, encoding="latin-1")
    assert main([*verb.split(), str(tmp_path / name)]) == 2
    assert cure.format(tmp_path) in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "content", "said"),
    [
        (
            "estimate {} --viewpoint 0 0 nan",
            "x,y,z,nx,ny,nz\n1,0,0,1,0,0\n",
            "it is [0.0, 0.0, nan]",
        ),
        ("explore box --pose {}", "1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "4 x 4 finite"),
        ("explore box --taxel-pitch 1e9 --output {}", "", "--taxel-pitch must be at least 0 and"),
        pytest.param(
            "evaluate {}",
            "parts: {a: {measure: b}}",
            "a.measure must be one of 'grasps'",
            marks=NEEDS_STUDY,
        ),
        pytest.param(
            "evaluate {}", "parts: {a: {title: b}}", "parts.a.measure is missing", marks=NEEDS_STUDY
        ),
        ("compare --study {}", "parts: [x]", "study.yaml: each key"),
        ("compare --study {}", "touches: [-1]", "study.yaml: touches, entry 0,"),
        ("compare --study {} --touches 0", "touches: [-1]", "lis-grasp: --touches, entry 0,"),
    ],
)
def test_a_wrong_value_is_named_with_its_true_reason(
    line: str,
    content: str,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / ("study.yaml" if content.startswith(("parts", "touches")) else "file.csv")
    path.write_text(content)
    assert said in _misuse(capsys, *(word.format(path) for word in line.split()))


def test_objects_that_are_missing_are_named_once(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run"])
    assert "required: OBJECT;" in capsys.readouterr().err


def test_without_a_verb_the_help_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    captured = capsys.readouterr()
    assert captured.err == ""
    assert all(verb in captured.out for verb in ("run", "estimate", "doctor"))


@pytest.mark.parametrize(
    ("line", "required"),
    [
        ("run box --touches many", "--touches must be a whole number; it is 'many'"),
        ("run box --region 1 2 x", "--region must be a number; it is 'x'"),
        ("view . --port 1.5", "--port must be a whole number; it is '1.5'"),
    ],
)
def test_what_is_no_number_is_refused_by_its_option(
    line: str, required: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(line.split())
    assert required in capsys.readouterr().err


@pytest.mark.parametrize("line", ["rnu box", "run", "run box --prober dyn", "run box --seed x"])
def test_misuse_is_one_sentence(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(line.split())
    except SystemExit as end:
        code = int(end.code or 0)
    captured = capsys.readouterr()
    assert (code, captured.out, captured.err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("line", "option"),
    [
        ("run box --force-threshold 1 --prober kinematic", "--force-threshold"),
        ("run box --slide 0.02", "--slide needs a fixed object"),
        ("explore box --known --arm iiwa14 --slide 0.02", "--slide needs a fixed object"),
        ("grasp box.stl --jobs 2", "--jobs"),
        pytest.param("evaluate --jobs 0", "--jobs", marks=NEEDS_STUDY),
        pytest.param("evaluate --report-only", "a report needs rows", marks=NEEDS_STUDY),
        pytest.param("evaluate --fill no.in page.md", "--fill", marks=NEEDS_STUDY),
        pytest.param("evaluate --quick --report-only --jobs 2", "--jobs", marks=NEEDS_STUDY),
        pytest.param(
            "evaluate --quick --report-only --scheduler tcp://x:1", "--scheduler", marks=NEEDS_STUDY
        ),
        ("run box nothing.stl", "nothing.stl"),
        ("grasp box.stl --obstacles nothing.stl", "nothing.stl"),
        ("grasp box.stl --friction 1e9", "--friction must be above 0 and at most 100"),
    ],
)
def test_what_would_have_no_effect_or_fail_later_is_refused_before_work(
    line: str,
    option: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shapes.find("box").mesh.export(tmp_path / "box.stl")
    monkeypatch.chdir(tmp_path)
    message = _misuse(capsys, *line.split(), "--output", "out")
    assert option in message
    assert not Path("out").exists()
    verb, *_ = line.split()
    (verbs,) = (a for a in build_parser(verb)._actions if isinstance(a.choices, dict))
    there = {name for action in verbs.choices[verb]._actions for name in action.option_strings}
    assert there >= {*re.findall(r"--[a-z][a-z-]+", message)}


def test_an_object_that_fails_does_not_end_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = []

    def run(config: RunConfig, folder: Path, *, fresh: bool) -> None:
        if config.world.object == "torus":
            raise EstimationError("no contact was made")
        done.append(folder)

    monkeypatch.setattr("lis_grasp.cli.run._run", run)
    assert main(["run", "torus", "box", "mallet", "--output", str(tmp_path)]) == 1
    assert done == [tmp_path / "box", tmp_path / "mallet"]
    message = "torus: no contact was made\nlis-grasp: of 3 objects, 1 failed: torus\n"
    assert capsys.readouterr().err == message


@pytest.mark.parametrize(
    ("read", "advice"),
    [
        (read_log, "restore it"),  # of a real robot, perhaps
        pytest.param(read_parquet, "restore it", marks=NEEDS_STUDY),  # of an earlier version
        (lambda path: TrialResults(path, "study").read(), "made again"),
    ],
)
def test_only_what_is_made_again_is_advised_to_be_removed(
    read: Callable[[Path], object], advice: str, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text('{"touch_log": 1}\nnonsense\n')
    with pytest.raises(InvalidFileError) as error:
        read(tmp_path / "file")
    assert advice in str(error.value)
    assert ("remove" in str(error.value)) == (advice == "made again")


def test_units_of_a_built_in_shape_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explore", "box", "--units", "mm", "--output", str(tmp_path / "new")]) == 2
    assert "--units is for mesh files; it is mm for the built-in box" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    ["run {}", "run box --hand {}", "run box --arm {}", "run box --world {}", "run box --cloud {}"]
    + ["estimate {}", "grasp {}", "lift {}", "next {}"]
    + ["doctor --hand {}", "hand view {}"],
)
def test_a_folder_in_place_of_a_file_is_named(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    assert main(line.format(folder).split()) == 2
    assert re.search(r"folder'? ?(must be a file; it )?is a folder", capsys.readouterr().err)
    assert not [*folder.iterdir()]


def test_a_full_disk_is_named_with_the_file_that_the_user_knows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", no_room)
    assert main(["estimate", "examples/contacts.csv", "--output", str(tmp_path)]) == 2
    path = re.escape(str(tmp_path / "surface.ply"))
    assert re.search(rf"cannot write {path}: .*: make room, or name", capsys.readouterr().err)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    "line",
    ["estimate examples/contacts.csv", "run box", "explore box", "next examples/contacts.csv"],
)
def test_noise_in_degrees_is_refused(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*line.split(), "--normal-noise", "3"]) == 2
    assert "--normal-noise must be in radians" in capsys.readouterr().err
    with pytest.raises(InvalidOptionError, match="radians"):
        lis_grasp.estimate("examples/contacts.csv", normal_noise=3.0)
