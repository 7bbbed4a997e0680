"""Runs that end on a table or in a corner: report, summary, page, exit code, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from lis_grasp import pipeline
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.results.page import scene_of
from lis_grasp.results.placed import PLACE_REASONS, place_lines
from lis_grasp.results.preparing import prepared
from lis_grasp.results.progress import SILENT
from lis_grasp.stages.place import CORNER, with_place
from lis_grasp.task.task import Task
from lis_grasp.world import Body, Surroundings

OPTIONS = {"hand": "wsg50", "prober": "kinematic", "touches": 12}


def report(**place: Any) -> dict[str, Any]:
    planned = {"gaps": {"wall_x": 0.012, "wall_y": 0.034}}
    usual = {"placed": True, "reason": "placed", "moved": 0.0017, "turned": 0.01}
    return {"place": {**usual, "planned": planned, **place}}


def test_a_placed_object_has_one_line_with_its_errors_and_gaps() -> None:
    (line,) = place_lines(report())
    for number in ("1.7 mm", "0.6 deg", "12 mm", "34 mm"):
        assert number in line
    assert place_lines({}) == []


@pytest.mark.parametrize("reason", [reason for reason in PLACE_REASONS if reason != "placed"])
def test_an_object_that_was_not_placed_has_one_line_with_the_reason(reason: str) -> None:
    (line,) = place_lines(report(placed=False, reason=reason, moved=None, planned=None))
    assert PLACE_REASONS[reason] in line


def test_a_corner_adds_two_walls_that_the_robot_knows_and_a_table_none() -> None:
    corner = with_place(pipeline.Scenario.from_config(Task.of("box", place="corner")))
    for known in (corner.truth.surroundings, corner.agent.surroundings):
        assert [body.name for body in known] == ["wall_x", "wall_y"]
        assert all(body.is_fixed for body in known)
    table = pipeline.Scenario.from_config(Task.of("box", place="table"))
    assert with_place(table) is table


def test_a_corner_in_a_world_stands_beside_its_bodies() -> None:
    crate = Body.box("crate", (0.1, 0.1, 0.1), (0.3, 0.0, 0.05))
    task = Task.of("box", place="corner", world=Surroundings((crate,)))
    corner = with_place(pipeline.Scenario.from_config(task))
    for known in (corner.truth.surroundings, corner.agent.surroundings):
        assert [body.name for body in known] == ["crate", "wall_x", "wall_y"]


def test_a_corner_where_the_object_is_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "there.stl"
    trimesh.creation.box((0.05, 0.07, 0.1)).apply_translation((*CORNER, 0.05)).export(path)
    with pytest.raises(InvalidOptionError):
        prepared(Task.of(path, known=True, place="corner"), SILENT)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["table", "corner"])
def test_a_run_says_where_it_placed_the_object(tmp_path: Path, place: str) -> None:
    run = pipeline.run(Task.of("box", place=place, **OPTIONS), tmp_path)
    assert run.report is not None
    assert run.report["lift"]["held"]
    facts = run.report["place"]
    assert (facts["placed"], facts["reason"]) == (True, "placed")
    assert facts["moved"] < 0.005
    assert facts["turned"] < np.deg2rad(5.0)
    assert {*facts["planned"]} == {"X_EO", "stands", "band", "gaps"}
    assert {*facts["planned"]["gaps"]} == ({"wall_x", "wall_y"} if place == "corner" else set())
    beside = [body.name for body in scene_of(tmp_path).surroundings]
    assert beside == (["wall_x", "wall_y"] if place == "corner" else [])
    # The motion ends with the object where the report says that it stands.
    assert run.motion is not None
    ends = run.motion.poses["object"]
    assert np.linalg.norm(ends[-1][:2, 3] - ends[0][:2, 3]) > 0.05


@pytest.mark.slow
def test_an_arm_places_an_object_in_a_corner(tmp_path: Path) -> None:
    task = Task.of("box", place="corner", arm="iiwa14", **OPTIONS)
    run = pipeline.run(task, tmp_path)
    assert run.report is not None
    assert run.report["place"]["reason"] == "placed"
    assert run.report["lift"]["arm"]["contacts"] == {}


@pytest.mark.slow
def test_the_grasps_of_a_file_are_placed(tmp_path: Path) -> None:
    pipeline.run(Task.of("box", **OPTIONS), tmp_path)
    made = pipeline.lift_file(tmp_path / "grasps.json", place="table")
    assert made.lifts[0]["place"]["placed"]
    (tmp_path / "surface.ply").unlink()
    with pytest.raises(InvalidOptionError) as refused:
        pipeline.lift_file(tmp_path / "grasps.json", place="table")
    assert refused.value.option == "place"


@pytest.mark.slow
def test_a_run_whose_object_is_not_placed_exits_with_1(tmp_path: Path) -> None:
    # No friction to speak of: nothing is held, and so nothing is placed.
    command = ["run", "box", "--hand", "wsg50", "--prober", "kinematic", "--touches", "8"]
    command += ["--friction", "0.02", "--attempts", "1", "--closings", "0", "--place", "table"]
    assert main([*command, "--output", str(tmp_path)]) == 1
    found = pipeline.Run.load(tmp_path).report
    assert found is not None
    assert found["place"]["reason"] == "not_held"
