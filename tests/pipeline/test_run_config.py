"""Run configuration: types and ranges of its values, and options of stages on files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lis_grasp import Hand, RunConfig, explore, pipeline, shapes
from lis_grasp.exceptions import InvalidHandError, InvalidInputError, InvalidOptionError
from lis_grasp.io.option import options_of
from lis_grasp.stages import regrasp
from lis_grasp.stages.scenario import workspace


@pytest.mark.parametrize(
    ("name", "values"),
    {
        "size": (-1.0, 0.0, "0.1", True, np.nan),
        "touches": (2.5, 0, True, "40", None),
        "seed": (-1, 0.0),
        "attempts": (0, -1),
        "object": ("", 3, None),
        "free": (1, "yes", None),
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
        with pytest.raises(InvalidOptionError, match=f"^{name} must be") as error:
            RunConfig(**{**needed, name: value})
        assert error.value.option == name


def test_a_hand_or_arm_that_no_name_stands_for_is_refused() -> None:
    with pytest.raises(InvalidHandError, match="'alegro' is neither: did you mean 'allegro'"):
        RunConfig(hand="alegro")
    with pytest.raises(InvalidInputError, match="'iiwa15' is neither: did you mean 'iiwa14'"):
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
        with pytest.raises(InvalidOptionError, match="^slide needs a fixed object"):
            run(config, folder)
    with pytest.raises(InvalidOptionError, match="^slide needs a fixed object"):
        explore("box", "wsg50", slide=0.02, **moving)
    assert not folder.exists()


def test_numbers_of_numpy_are_kept_as_plain_ones() -> None:
    config = RunConfig(touches=np.int64(7), friction=np.float64(0.5))
    assert (type(config.touches), type(config.friction)) == (int, float)


def test_every_decision_of_the_robot_is_an_option() -> None:
    """What `Known` repeats of a configuration has the configured value."""
    given: dict[str, Any] = {
        "policy": "spread",
        "touches": 7,
        "grasps": 2,
        "seed": 5,
        "attempts": 1,
    }
    given |= {"until_coverage": 0.9, "max_seconds": 60.0, "free_space": False, "estimator": "gpis"}
    hand, space = Hand.load("wsg50"), workspace(shapes.find("box"))
    known = pipeline.Known.for_hand(RunConfig(**given), hand, space, 0.0)
    for name in set(options_of(RunConfig)) & set(vars(known)) - {"hand", "load"}:
        assert getattr(known, name) == getattr(RunConfig(**given), name), name


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
        with pytest.raises(InvalidOptionError, match="must be"):
            pipeline.lift_file(grasps, object="box", **options)
    with pytest.raises(InvalidOptionError, match="^support must be"):
        pipeline.grasp_file(tmp_path / "box.stl", support=np.nan)
    with pytest.raises(InvalidOptionError, match="records no object"):
        pipeline.lift_file(grasps)


def test_the_help_of_grasps_says_how_many_follow_a_failure() -> None:
    assert f", {regrasp._MORE_GRASPS} after one failed" in options_of(RunConfig)["grasps"].help
