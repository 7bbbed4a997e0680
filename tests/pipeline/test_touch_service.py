"""The service for touches: the same touches as single commands, on the disk before the answer."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lis_grasp import Contacts, Hand, shapes
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidInputError, LisGraspError
from lis_grasp.exploration import TouchLog, load_observations, load_outcomes
from lis_grasp.pipeline import RunConfig
from lis_grasp.service.touch_service import TouchService
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.next_touch import ObjectPlace, next_touch
from lis_grasp.surfaces.contact_checks import doubt_of_side

BOX = shapes.build("box", 0.12).mesh
PLACE = ObjectPlace(center=(0.0, 0.0, 0.0), size=0.12, support=float(BOX.bounds[0, 2]))


def _service(folder: Path, **known: Any) -> TouchService:
    config = RunConfig(hand="wsg50", estimator="gpis", policy="spread")
    log = TouchLog(folder / "touches.jsonl", {"hand": "wsg50", "estimator": "gpis"})
    return TouchService(Agent.of(config, 0.0), known.pop("place", PLACE), folder, log, **known)


def _feel(touch: dict[str, Any]) -> dict[str, Any]:
    """Return what a point that moves from start to end feels of the box."""
    start, end = np.array(touch["start"]), np.array(touch["end"])
    points, _, faces = BOX.ray.intersects_location([start], [end - start], multiple_hits=False)
    if not len(points) or np.linalg.norm(points[0] - start) > np.linalg.norm(end - start):
        return {"status": "missed", "free_points": [start.tolist()]}
    return {"points": points.tolist(), "normals": BOX.face_normals[faces].tolist()}


@pytest.mark.slow
def test_each_touch_is_that_of_the_command_with_the_log(tmp_path: Path) -> None:
    service, hand = _service(tmp_path), Hand.load("wsg50")
    touch = service.answer({})
    for count in range(12):
        if count == 5:  # resumed in another process
            recorded = load_observations(tmp_path / "touches.jsonl")
            assert len(recorded) == count
            service = _service(tmp_path, recorded=recorded)
            assert service.answer({"request": "next"}) == touch
        touch = service.answer({"request": "next", **_feel(touch)})
        recorded = load_observations(tmp_path / "touches.jsonl")
        space = PLACE.space(Contacts.empty())
        config = RunConfig(estimator="gpis", policy="spread")
        known = Agent.of(config, 0.0, hand=hand).placed(space)
        alone = next_touch(known, Contacts.empty(), recorded).facts(hand)
        assert {name: touch[name] for name in alone} == alone
        assert service.answer({"request": "next"}) == touch  # asked again, it is the same
    assert touch["contacts"] > 5
    surface = service.answer({"request": "estimate"})
    grasps = service.answer({"request": "grasp", "grasps": 2, "friction": 0.9})
    assert surface["extents"] == pytest.approx(BOX.extents.tolist(), rel=0.15)
    assert len(grasps["grasps"]) <= 2
    assert json.loads((tmp_path / "grasps.json").read_text())["grasps"] == grasps["grasps"]
    names = {"touches.jsonl", "contacts.ply", "surface.ply", "grasps.json"}
    assert {path.name for path in tmp_path.iterdir()} == names


def test_a_normal_that_is_not_measured_is_that_of_the_motion(tmp_path: Path) -> None:
    service = _service(tmp_path)
    touch = service.answer({})
    point = [0.0, 0.0, 0.06]
    service.answer({"points": [point], "position_noise": 0.001})
    (outcome,) = load_outcomes(tmp_path / "touches.jsonl")
    np.testing.assert_allclose(outcome.contacts.normals, [-np.array(touch["direction"])])
    assert outcome.contacts.normal_noise == pytest.approx([0.5])
    assert outcome.contacts.position_noise == pytest.approx([0.001])


def test_contacts_that_nobody_asked_for_begin_an_exploration(tmp_path: Path) -> None:
    place = ObjectPlace(held=True)
    service = _service(tmp_path, place=place)
    with pytest.raises(LisGraspError, match="need normals"):
        service.answer({"points": [[0.03, 0.0, 0.0]]})
    lone = service.answer({"points": [[0.03, 0.0, 0.0]], "normals": [[1, 0, 0]]})
    assert (lone["ok"], lone["recorded"], lone["contacts"]) == (False, True, 1)
    assert "`size`" in lone["error"]
    more = {"points": [[-0.03, 0.01, 0.0], [0.0, 0.0, 0.03]], "normals": [[-1, 0, 0], [0, 0, 1]]}
    assert service.answer(more)["contacts"] == 3
    assert "warning" not in service.answer({})
    recorded = load_observations(service.log.path)
    unknown = _service(tmp_path, place=ObjectPlace(), recorded=recorded)
    assert "z = 0.0 mm" in unknown.answer({})["warning"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normals_that_point_inward_are_told_with_the_answers(tmp_path: Path, sign: float) -> None:
    service = _service(tmp_path)
    axes = np.vstack([np.eye(3), -np.eye(3)])
    report = {"points": (0.06 * axes).tolist(), "normals": (sign * axes).tolist()}
    doubt = doubt_of_side(Contacts(0.06 * axes, sign * axes))
    assert bool(doubt) == (sign < 0.0)
    assert service.answer(report).get("warning", "") == doubt
    assert service.answer({"request": "estimate"}).get("warning", "") == doubt


@pytest.mark.parametrize(
    "request_",
    [
        {"request": "move"},
        {"request": ["next"]},
        {"request": "estimate"},  # no contact yet
        {"request": "grasp", "output": "/etc"},
        {"request": "grasp", "grasps": 10**9},
        {"free_points": [[0.0, 0.0, 0.0]]},
        {"points": [[0.0, 0.0]]},
        {"points": [[0.0, 0.0, 0.0]] * 1001},
        {"points": [[0.0, 0.0, "1"]]},
        {"points": [[0.0, 0.0, 0.0]], "normals": [[0.0, 0.0, 0.0]]},
        {"points": [[0.0, 0.0, 0.0]], "status": "missed"},
        {"status": "touched"},
        {"status": "lost"},
    ],
)
def test_a_wrong_request_changes_nothing(tmp_path: Path, request_: dict[str, Any]) -> None:
    service = _service(tmp_path)
    touch = service.answer({})
    with pytest.raises(InvalidInputError):
        service.answer(request_)
    assert not list(tmp_path.iterdir())
    assert service.answer({}) == touch


@pytest.mark.by_default("points-place0", "free_points-place0", "points-place1")
@pytest.mark.parametrize("place", [PLACE, ObjectPlace(region=(0.4, 0.4, 0.3))])
@pytest.mark.parametrize("key", ["points", "free_points"])
def test_points_in_millimetres_are_refused_before_the_log(
    tmp_path: Path, place: ObjectPlace, key: str
) -> None:
    service = _service(tmp_path, place=place)
    touch = service.answer({})
    report = {"status": "touched" if key == "points" else "missed"}
    with pytest.raises(InvalidInputError, match="must be in metres"):
        service.answer({**report, key: [[30.0, 0.0, 30.0]]})
    assert not list(tmp_path.iterdir())
    assert service.answer({}) == touch
    service.answer({**report, key: [[0.03, 0.0, 0.03]]})
    assert len(load_outcomes(service.log.path)) == 1


def test_the_command_answers_on_its_streams_and_keeps_what_is_there(tmp_path: Path) -> None:
    options = ["--hand", "wsg50", "--size", "0.12", "--support", "-0.06"]
    command = [sys.executable, "-m", "lis_grasp.cli.main", "next", "--serve", *options]
    lines = '{"request": "next", "id": 1}\nnonsense\n{"status": "missed"}\n{"request": "stop"}\n'
    done = subprocess.run(
        [*command, "--output", tmp_path], input=lines, capture_output=True, text=True, check=True
    )
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert [answer["ok"] for answer in answers] == [True, False, True, True]
    assert len(load_outcomes(tmp_path / "touches.jsonl")) == 1
    assert "ready" in done.stderr
    assert main(["next", "--serve", *options, "--output", str(tmp_path)]) == 2
    assert main(["next", "--serve", *options, "--output", str(tmp_path / "x.json")]) == 2
    assert not (tmp_path / "x.json").exists()
    Contacts([[0.0, 0.0, 0.06]], [[0.0, 0.0, 1.0]]).save(tmp_path / "own" / "contacts.ply")
    assert main(["next", str(tmp_path / "own" / "contacts.ply"), "--serve", *options]) == 2
