"""Run configuration: types and ranges of its values, and options of stages on files."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from lis_grasp import Hand, RunConfig, explore, pipeline, shapes
from lis_grasp.exceptions import InvalidHandError, InvalidInputError, InvalidOptionError
from lis_grasp.io import provenance
from lis_grasp.io.option import options_of
from lis_grasp.results.lifted_file import lifting_of
from lis_grasp.results.progress import SILENT
from lis_grasp.stages import regrasp
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.scenario import known_place
from lis_grasp.task.task import PARTS, Task, task_options


@pytest.mark.parametrize(
    ("name", "values"),
    {
        "size": (-1.0, 0.0, "0.1", True, np.nan),
        "touches": (2.5, 0, True, "40", None),
        "seed": (-1, 0.0),
        "attempts": (0, -1),
        "object": ("", 3),
        "free": (1, "yes"),
        "until_success": (0.0, 1.0),
        "until_coverage": (0.0, 1.1),
        "until_uncertainty": (0.0, -1.0, np.inf),
        "max_seconds": (0.0, "1"),
        "position_noise": (-1e-3, np.inf, None),
        "friction": (0.0, np.nan, 100.1, 1e9),
        "mass": (0.0,),
        "prober": ("kinetic", None),
        "base": ((0.0, 0.0), (0.0, 0.0, np.nan), 1.0),
        "region": ((1.0, 1.0), 0.3),
    }.items(),
)
def test_a_value_out_of_its_range_or_type_names_its_field(name: str, values: tuple[Any]) -> None:
    needed = {"base": {"arm": "iiwa14"}, "region": {"pose": "stable"}}.get(name, {})
    for value in values:
        with pytest.raises(InvalidOptionError) as error:
            RunConfig(**{**needed, name: value})
        assert error.value.option == name


def test_a_hand_or_arm_that_no_name_stands_for_is_refused() -> None:
    with pytest.raises(InvalidHandError, match="'allegro'"):
        RunConfig(hand="alegro")
    with pytest.raises(InvalidInputError, match="'iiwa14'"):
        RunConfig(arm="iiwa15")
    assert RunConfig(hand=Path("elsewhere/now.yaml")).hand == "elsewhere/now.yaml"


@pytest.mark.parametrize(
    "moving", [{"free": True}, {"arm": "iiwa14"}, {"fingers": "all", "prober": "kinematic"}]
)
def test_slides_are_refused_where_none_would_be_made(
    moving: dict[str, Any], tmp_path: Path
) -> None:
    config = RunConfig("box", hand="wsg50", slide=0.02, **moving)  # `next` reads such facts
    folder = tmp_path / "results"
    for run in (pipeline.run, pipeline.explore_object):
        with pytest.raises(InvalidOptionError) as error:
            run(config, folder)
        assert error.value.option == "slide"
    with pytest.raises(InvalidOptionError) as error:
        explore("box", "wsg50", slide=0.02, **moving)
    assert error.value.option == "slide"
    assert not folder.exists()


def test_numbers_of_numpy_are_kept_as_plain_ones() -> None:
    config = RunConfig(touches=np.int64(7), friction=np.float64(0.5))
    assert (type(config.touches), type(config.friction)) == (int, float)


def test_no_option_is_a_field_of_two_records() -> None:
    names = [name for record in (*PARTS.values(), Task) for name in options_of(record)]
    assert len(names) == len(set(names)) == len(task_options())


def test_an_agent_decides_as_its_task_says() -> None:
    task = Task.of(policy="spread", touches=7, until_coverage=0.9, seed=5, prober="kinematic")
    agent = Agent.of(task, 0.0, hand=Hand.load("wsg50")).placed(known_place(shapes.find("box")))
    assert (agent.decide, agent.robot, agent.known) == (task.decide, task.robot, task.known)
    assert agent.seed == 5


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda path: pipeline.estimate_file([], estimater="lis"), "estimator"),
        (lambda path: pipeline.grasp_file(path, graps=1), "grasps"),
        (lambda path: pipeline.lift_file(path, touches=1), "touches"),
    ],
)  # fmt: skip
def test_an_option_that_a_stage_on_files_has_not_is_refused(call: Any, word: str) -> None:
    with pytest.raises(TypeError, match=word):
        call(Path("missing.ply"))


def test_numbers_of_a_stage_on_files_are_checked(tmp_path: Path) -> None:
    shapes.find("box").mesh.export(tmp_path / "box.stl")
    grasps = pipeline.grasp_file(tmp_path / "box.stl", hand="wsg50", grasps=1).path
    for options in ({"best": None}, {"best": 0}, {"jobs": 0}):
        with pytest.raises(InvalidOptionError) as error:
            pipeline.lift_file(grasps, object="box", **options)
        assert error.value.option in options
    with pytest.raises(InvalidOptionError) as error:
        pipeline.grasp_file(tmp_path / "box.stl", support=np.nan)
    assert error.value.option == "support"
    with pytest.raises(InvalidOptionError) as error:
        pipeline.lift_file(grasps)
    assert error.value.option == "object"


def test_another_true_object_than_that_of_the_grasps_is_told(tmp_path: Path) -> None:
    shapes.find("box").mesh.export(tmp_path / "box.stl")
    made = pipeline.grasp_file(tmp_path / "box.stl", hand="wsg50", grasps=1)
    made.search.save(made.path, header=provenance.merge({}, object="box", hand="wsg50"))
    for lifted in ("box", "cylinder"):
        with patch.object(type(SILENT), "say") as told:
            lifting_of(made.path, {"object": lifted}, SILENT)
        lines = [call.args[0] for call in told.call_args_list]
        expected = ["warning: grasps.json has grasps of box, and the true object is cylinder"]
        assert lines == (expected if lifted == "cylinder" else [])


def test_the_help_of_grasps_says_how_many_follow_a_failure() -> None:
    assert f", {regrasp._MORE_GRASPS} after one failed" in task_options()["grasps"].help
