"""Conditions of runs and explorations on the command line: what is known, pose and sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from lis_grasp.cli.main import build_parser
from lis_grasp.cli.options import configure_touch
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.task.robot import REAL_SENSOR
from lis_grasp.task.task import IDEAL_CAMERA, IDEAL_SENSOR, KNOWN, plain_value


def facts(*arguments: str, verb: str = "run") -> dict[str, Any]:
    config = configure_touch(build_parser().parse_args([verb, "box", *arguments]))
    return {name: config.facts()[name] for name in UNKNOWN}


def plain(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: plain_value(value) for name, value in options.items()}


@pytest.mark.parametrize("verb", ["run", "explore"])
def test_nothing_is_known_by_default(verb: str) -> None:
    assert facts(verb=verb) == UNKNOWN
    assert facts("--unknown", verb=verb) == UNKNOWN
    assert facts("--known", verb=verb) == plain(KNOWN)


def test_the_real_sensor_is_that_of_the_guide() -> None:
    assert REAL_SENSOR["position_noise"] == 0.0005
    assert np.degrees(REAL_SENSOR["normal_noise"]) == pytest.approx(3.0)


def test_a_cloud_shows_where_the_object_is() -> None:
    assert facts("--cloud", "cloud.ply") == plain(KNOWN)
    assert facts("--cloud", "cloud.ply", "--unknown") == UNKNOWN


def test_geometry_alone_cannot_move_the_object() -> None:
    assert facts("--prober", "kinematic") == {**UNKNOWN, "free": False}
    assert facts("--clamped") == {**UNKNOWN, "free": False}
    with pytest.raises(InvalidOptionError) as error:
        facts("--prober", "kinematic", "--free")
    assert error.value.option == "free"


def test_each_condition_changes_alone() -> None:
    assert facts("--ideal") == {**UNKNOWN, **IDEAL_SENSOR, **plain(IDEAL_CAMERA)}
    assert facts("--pose", "upright") == {**UNKNOWN, "pose": "upright"}
    assert facts("--normal-noise", "0.1") == {**UNKNOWN, "normal_noise": 0.1}
    assert facts("--region", "0.6", "0.5", "0.4") == {**UNKNOWN, "region": [0.6, 0.5, 0.4]}
    assert facts("--known", "--pose", "stable") == {**plain(KNOWN), "pose": "stable"}
    known = facts("--known", "--region", "0.6", "0.5", "0.4")
    assert known == {**plain(KNOWN), "region": [0.6, 0.5, 0.4], "pose": "stable"}


def test_known_and_unknown_exclude_each_other() -> None:
    with pytest.raises(SystemExit):
        facts("--known", "--unknown")


def test_a_region_without_room_is_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        facts("--region", "0.4", "0", "0.3")
    assert error.value.option == "region"
