"""Scene files: a whole task as YAML, its schema, and what options of the command line change."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import lis_grasp as lg
from lis_grasp.cli.main import build_parser, main
from lis_grasp.cli.options import configure_touch
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.option import options_of
from lis_grasp.pipeline import direct
from lis_grasp.task.scene_file import SCHEMA_NAME, InvalidSceneError
from lis_grasp.task.task import PARTS, task_options

TASK = lg.Task.of("mallet", hand="wsg50", touches=7, region=(0.3, 0.3, 0.2), seed=5, mass=0.3)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    lg.write_scene(TASK, tmp_path / "mallet.yaml")
    return tmp_path / "mallet.yaml"


@pytest.mark.parametrize("task", [TASK, lg.Task(), lg.Task.of(known=True, prober="kinematic")])
def test_a_written_scene_is_the_same_task(task: lg.Task, tmp_path: Path) -> None:
    lg.write_scene(task, tmp_path / "scene.yaml")
    assert lg.load_scene(tmp_path / "scene.yaml") == task


def test_a_scene_is_nested_as_the_records_are(scene: Path) -> None:
    written = yaml.safe_load(scene.read_text(encoding="utf-8"))
    assert list(written) == [*PARTS, "seed"]
    for part, record in PARTS.items():
        assert list(written[part]) == list(options_of(record))


@pytest.mark.parametrize("content", ["", "{}", "world: {}\n", "seed: 0\n"])
def test_what_a_scene_leaves_out_has_the_defaults_of_a_run(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(content)
    asked = configure_touch(build_parser("run").parse_args(["run", "box"]))
    assert lg.load_scene(tmp_path / "a.yaml") == asked == lg.Task.of("box")


def test_options_of_the_command_line_replace_those_of_a_scene(scene: Path) -> None:
    arguments = ["run", str(scene), "--touches", "3", "--hand", "barrett", "--mass", "0.2"]
    asked = configure_touch(build_parser("run").parse_args(arguments))
    assert asked == TASK.having(touches=3, hand="barrett", mass=0.2)
    known = configure_touch(build_parser("run").parse_args(["run", str(scene), "--known"]))
    assert known == TASK.having(known=True)
    assert (known.known.region, known.world.pose, known.decide.touches) == (None, None, 7)


def test_python_runs_a_scene(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[lg.Task] = []
    monkeypatch.setattr(direct, "run_task", lambda task, *_, **__: seen.append(task))
    lg.run(scene)
    lg.run(str(scene), touches=2)
    assert seen == [TASK, TASK.having(touches=2)]


def test_paths_of_a_scene_start_at_its_folder(tmp_path: Path) -> None:
    lg.shapes.find("box").mesh.export(tmp_path / "part.stl")
    (tmp_path / "a.yaml").write_text("world: {object: part.stl, units: m}\n")
    assert Path(lg.load_scene(tmp_path / "a.yaml").world.object) == tmp_path / "part.stl"


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ("world: {fricton: 0.5}", "world.fricton"),
        ("word: {}", "word"),
        ("world: {mass: heavy}", "world.mass"),
        ("decide: {touches: 2.5}", "decide.touches"),
        ("robot: wsg50", "robot"),
        ("- world", ""),
    ],
)
def test_a_wrong_key_or_type_is_named(content: str, key: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(content)
    with pytest.raises(InvalidSceneError) as error:
        lg.load_scene(tmp_path / "a.yaml")
    assert (error.value.file, error.value.key) == ("a.yaml", key)


def test_values_of_a_scene_are_checked_as_options_are(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("world: {friction: -1.0}")
    with pytest.raises(InvalidOptionError) as error:
        lg.load_scene(tmp_path / "a.yaml")
    assert error.value.option == "friction"
    with pytest.raises(InvalidFileError) as missing:
        lg.load_scene(tmp_path / "none.yaml")
    assert missing.value.path == tmp_path / "none.yaml"


def test_the_schema_has_every_option_with_its_meaning_and_default(scene: Path) -> None:
    schema = json.loads(scene.with_name(SCHEMA_NAME).read_text(encoding="utf-8"))
    assert f"$schema={SCHEMA_NAME}" in scene.read_text(encoding="utf-8").split("\n")[0]
    told = {n: p for part in schema["$defs"].values() for n, p in part["properties"].items()}
    told["seed"] = schema["properties"]["seed"]
    assert told.keys() == task_options().keys()
    for name, option in task_options().items():
        assert told[name]["description"] == option.help
        assert set(told[name].get("enum", ())) - {None} == set(option.choices)
    assert told["touches"]["default"] == lg.Task().decide.touches


def test_the_command_writes_a_scene_and_runs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "box.yaml"
    assert main(["run", "box", "--hand", "wsg50", "--write-scene", str(path)]) == 0
    assert lg.load_scene(path) == lg.Task.of("box", hand="wsg50")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["box.yaml", SCHEMA_NAME]
    assert main(["run", "box", "--write-scene", str(tmp_path / "box.json")]) == 2


def test_a_task_with_other_options_is_checked_again() -> None:
    with pytest.raises(InvalidOptionError) as error:
        TASK.having(simulator="mujoco", arm="iiwa14")
    assert error.value.option == "arm"
    with pytest.raises(TypeError, match="tuoches"):
        TASK.having(tuoches=3)
    assert replace(TASK, seed=6) == TASK.having(seed=6)


def test_an_option_in_a_wrong_part_is_told_its_own(tmp_path: Path) -> None:
    for part, record in PARTS.items():
        for name in options_of(record):
            for wrong in {*PARTS} - {part, name} | {""}:
                if not wrong and name in PARTS:  # a part
                    continue
                content = {wrong: {name: 1}} if wrong else {name: 1}
                (tmp_path / "a.yaml").write_text(yaml.safe_dump(content))
                with pytest.raises(InvalidSceneError, match=rf"there: write {part}\.{name}$"):
                    lg.load_scene(tmp_path / "a.yaml")


def test_a_misspelt_key_gets_the_place_of_the_right_one(tmp_path: Path) -> None:
    for content, place in (("touchs: 3", "decide.touches"), ("robot: {hnd: x}", "robot.hand")):
        (tmp_path / "a.yaml").write_text(content)
        with pytest.raises(InvalidSceneError, match=f"did you mean '{place}'"):
            lg.load_scene(tmp_path / "a.yaml")
