"""Touches beside other bodies: what they did to these is logged, resumed, and reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import worlds
from scenes import Told

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.touch_log import read_log
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.pipeline import Scenario
from lis_grasp.results.exploring import explore_into
from lis_grasp.results.report import world_facts
from lis_grasp.stages.regrasp import Attempt
from lis_grasp.task.task import Task
from lis_grasp.world import Body, Surroundings


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Task:
    """Return the task of the usual box at the origin, beside a block and a light, free wall.

    The robot is wrong about their places, and touches the wall.
    """
    folder = tmp_path_factory.mktemp("world")
    np.savetxt(folder / "pose.txt", make_pose(np.eye(3), [0.0, 0.0, 0.06]))
    wall = Body.box("wall", (0.02, 0.44, 0.1), (-0.17, 0.0, 0.05), mass=0.05)
    beside = Surroundings((*worlds.block(0.02, mass=None), wall))
    return Task.of(
        "box",
        hand="wsg50",
        pose=str(folder / "pose.txt"),
        region=(0.2, 0.2, 0.2),
        world=str(worlds.saved(beside, folder / "beside.sdf")),
        touches=3,
        body_error=0.015,
    )


def facts_of(scenario: Scenario) -> dict[str, object]:
    """Return what touches did by the report, before any grasp."""
    estimate, plan = scenario.truth.shape.mesh, GraspSearch((), 0, {})
    facts = world_facts([Attempt(scenario, Contacts.empty(), estimate, plan, 0, None)])
    return facts["world"]["touch"] if facts else {}


@pytest.mark.slow
def test_an_interrupted_exploration_resumes_with_the_same_bytes_and_reports(
    task: Task, tmp_path: Path
) -> None:
    scenario = Scenario.from_config(task)
    assert [body.is_fixed for body in scenario.truth.surroundings] == [True, False]
    whole, part = tmp_path / "whole", tmp_path / "part"
    whole.mkdir()
    part.mkdir()
    after, _ = explore_into(whole, scenario)
    log = (whole / "touches.jsonl").read_bytes()
    logged = [p.disturbance for p in read_log(whole / "touches.jsonl")[1] if p.disturbance]
    assert len(logged) >= 1
    lines = log.splitlines(keepends=True)
    (part / "touches.jsonl").write_bytes(b"".join(lines[:3]))  # the header and two probes
    resumed, _ = explore_into(part, scenario)
    assert (part / "touches.jsonl").read_bytes() == log
    again, _ = explore_into(whole, scenario)  # from the finished log
    facts = facts_of(after)
    assert facts["moved"].keys() == {"wall"}
    assert facts == facts_of(resumed) == facts_of(again)
    moved = logged[-1].poses["wall"]
    for ended in (after, resumed, again):
        (now,) = ended.truth.surroundings.free
        assert np.allclose(now.X_EB, moved, atol=2e-3)  # the frame moves with the believed object
        assert now.X_EB.tobytes() == after.truth.surroundings.free[0].X_EB.tobytes()


def test_another_world_in_the_file_begins_anew(task: Task, tmp_path: Path) -> None:
    path = worlds.saved(worlds.walls(0.4, 0.1, ("west",)), tmp_path / "walls.sdf")
    by_geometry = task.having(prober="kinematic", free=False, touches=1, world=str(path))
    folder = tmp_path / "results"
    folder.mkdir()
    explore_into(folder, Scenario.from_config(by_geometry))
    worlds.saved(worlds.walls(0.42, 0.1, ("west",)), path)
    told = Told()
    explore_into(folder, Scenario.from_config(by_geometry), progress=told)
    assert "starting from the beginning: walls.sdf was edited" in told.lines


def test_alone_the_report_has_no_world(tmp_path: Path) -> None:
    task = Task.of("box", hand="wsg50", prober="kinematic", touches=1)
    assert facts_of(Scenario.from_config(task)) == {}
