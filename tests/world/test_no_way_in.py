"""Worlds without a way in: one sentence says so before the hand moves."""

from __future__ import annotations

import numpy as np
import pytest
import worlds

from lis_grasp import Hand, pipeline, shapes
from lis_grasp.exploration import Exploration
from lis_grasp.geometry import make_pose
from lis_grasp.task.task import Task
from lis_grasp.world import Body, Surroundings

SHAPE = shapes.find("box")  # 84 x 60 x 120 mm
SHAPE = shapes.placed(SHAPE, make_pose(np.eye(3), np.array([0.0, 0.0, -SHAPE.mesh.bounds[0, 2]])))
LID = Body.box("lid", (0.24, 0.24, 0.02), (0.0, 0.0, 0.16))

SCENES = {
    "a bin narrower than the open hand": worlds.walls(0.12, 0.25),
    "a lid": Surroundings((*worlds.walls(0.2, 0.15), LID)),
}


def explored_in(world: Surroundings) -> Exploration:
    task = Task.of(
        hand="wsg50", region=(0.2, 0.2, 0.2), prober="kinematic", touches=20, world=world, seed=5
    )
    scenario = pipeline.Scenario.from_config(
        task, SHAPE, Hand.load("wsg50"), recorded={"X_EO": None}
    )
    return pipeline.touch(scenario)


@pytest.mark.by_default("a lid")
@pytest.mark.parametrize("scene", SCENES)
def test_no_way_in_is_said_with_a_bodys_name_before_any_motion(scene: str) -> None:
    world = SCENES[scene]
    explored = explored_in(world)
    assert explored.ended.startswith("20 probes blocked: ")
    assert any(f": {body.name} is in the way" in explored.ended for body in world)
    assert explored.ended.count(". ") == 0
    assert len(explored.contacts) == len(explored.observations) == 0


@pytest.mark.slow
def test_a_shelf_5_mm_above_the_object_is_entered_by_its_open_side() -> None:
    explored = explored_in(worlds.shelf(under=0.125))
    assert explored.made == 20
    assert "no finger reaches" in explored.ended
    assert "the top" in explored.ended
