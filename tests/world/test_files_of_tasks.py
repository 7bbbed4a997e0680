"""Bodies beside the object as options of a task: files, places, refusals, and what is recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import lis_grasp as lg
from lis_grasp import pipeline
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import make_pose
from lis_grasp.stages.agent import Agent
from lis_grasp.task.recorded_facts import located
from lis_grasp.world import ALONE, Body, Surroundings
from lis_grasp.world.files import file_of, scenario_of
from lis_grasp.world.touching import bodies_touching

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_world" / "bin.dmd.yaml"
WALL = Surroundings((Body.box("wall", (0.02, 0.4, 0.2), (0.2, 0.0, 0.1)),))


def test_bodies_in_memory_and_in_a_file_reach_truth_and_agent() -> None:
    for world, names in ((WALL, ["wall"]), (EXAMPLE, ["bin", "carton"]), (None, [])):
        at = "middle" if world is EXAMPLE else None
        task = lg.Task.of("box", hand="wsg50", region=(0.2, 0.2, 0.2), world=world, at=at)
        scenario = pipeline.Scenario.from_config(task)
        assert [body.name for body in scenario.truth.surroundings] == names
        assert [body.name for body in scenario.agent.surroundings] == names
        assert ("X_WE" in scenario.facts()) == bool(names)


def test_the_table_of_a_file_is_that_of_the_task() -> None:
    """A known object is in its own frame, whose table is below its middle."""
    task = lg.Task.of("box", hand="wsg50", known=True, world=str(EXAMPLE), at="middle")
    scenario = pipeline.Scenario.from_config(task)
    height = scenario.agent.support_height
    assert height < -0.01
    assert scenario.truth.surroundings.mesh is not None
    assert scenario.truth.surroundings.mesh.bounds[0, 2] == pytest.approx(height, abs=1e-12)


def test_recorded_bodies_are_where_the_contacts_are() -> None:
    X_WE = make_pose(np.eye(3), [0.003, -0.002, 0.0])
    task = lg.Task.of("box", hand="wsg50", known=True, world=WALL)
    (first,), (moved,) = (
        Agent.of(task, 0.0, poses=poses).surroundings for poses in ({}, {"X_WE": X_WE.tolist()})
    )
    np.testing.assert_allclose(X_WE @ moved.X_EB, first.X_EB, atol=1e-15)
    agent = Agent.of(task, 0.0).in_frame(X_WE)
    np.testing.assert_array_equal(agent.X_WE, X_WE)


@pytest.mark.parametrize(
    ("name", "sides", "center"),
    [
        ("through", (0.02, 0.02, 0.5), (0.03, 0.0, 0.0)),  # meets its surface
        ("inside", (0.01, 0.01, 0.01), (0.0, 0.0, 0.0)),
        ("around", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)),
    ],
)
def test_an_object_that_begins_in_a_body_is_refused_with_its_name(
    name: str, sides: tuple[float, float, float], center: tuple[float, float, float]
) -> None:
    world = Surroundings((*WALL, Body.box(name, sides, center)))
    with pytest.raises(InvalidOptionError) as refused:
        lg.explore("box", "wsg50", known=True, prober="kinematic", touches=1, world=world)
    assert (refused.value.option, refused.value.value) == ("world", name)


def test_bodies_touch_up_to_their_distance() -> None:
    """A wall whose face is at x = 0.19 m, in closed form."""
    for reach, touching in ((0.3799, []), (0.3801, ["wall"])):
        assert bodies_touching(WALL, trimesh.creation.box((reach, 0.1, 0.1))) == touching


def test_a_place_without_a_file_and_a_run_without_one_are_refused() -> None:
    for world in (None, WALL):
        with pytest.raises(InvalidOptionError) as refused:
            lg.Task.of("box", world=world, at="middle")
        assert refused.value.option == "at"
    with pytest.raises(TypeError):
        lg.run("box", world=WALL)
    assert lg.Task.of("box", world=ALONE).facts()["world"] == ""


def test_a_scenario_is_named_behind_its_file(tmp_path: Path) -> None:
    assert (file_of("a/b.yaml#C"), scenario_of("a/b.yaml#C")) == (Path("a/b.yaml"), "C")
    assert (file_of("a/b.yaml"), scenario_of("a/b.yaml")) == (Path("a/b.yaml"), None)
    odd = tmp_path / "b#c.stl"
    odd.touch()
    assert (file_of(odd), scenario_of(odd)) == (odd, None)


def test_files_of_scenarios_are_found_beside_scenes_and_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "worlds.yaml").write_text("Bins: {directives: []}\n")
    (tmp_path / "scene.yaml").write_text("known: {world: 'worlds.yaml#Bins'}\n")
    (tmp_path / "results").mkdir()
    found = str(tmp_path / "worlds.yaml#Bins")
    assert lg.load_scene(tmp_path / "scene.yaml").known.world == found
    monkeypatch.chdir(tmp_path / "results")
    facts = {"world": "worlds.yaml#Bins"}
    assert located(facts, tmp_path / "results")["world"] == found
