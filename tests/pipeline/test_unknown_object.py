"""Explorations of an object of which only a region is known: what is used of the true object."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp.contacts import HALF_SPACE, Contacts
from lis_grasp.exceptions import EstimationError, InvalidOptionError
from lis_grasp.exploration import Exploration
from lis_grasp.io import provenance
from lis_grasp.pipeline import RunConfig, Scenario, estimate, run, touch
from lis_grasp.pipeline.names_of_2 import UNKNOWN
from lis_grasp.results.report import exploration_facts
from lis_grasp.results.summary import exploration_lines
from lis_grasp.shapes import Shape, placed
from lis_grasp.stages.touch import make_prober
from lis_grasp.task.task import IDEAL_SENSOR

CONFIG = RunConfig(
    **{**UNKNOWN, "free": False}, object="cylinder", prober="kinematic", touches=8, seed=2
)


@cache
def scenario() -> Scenario:
    return Scenario.from_config(CONFIG)


@cache
def honest() -> Exploration:
    return touch(scenario())


def test_a_region_is_the_only_prior_knowledge() -> None:
    known = vars(scenario().agent) | {"hand": None}
    for name in ("box", "torus"):
        other = vars(Scenario.from_config(CONFIG, shapes.build(name)).agent) | {"hand": None}
        np.testing.assert_array_equal(other.pop("X_WE"), known["X_WE"])
        assert other == {field: value for field, value in known.items() if field != "X_WE"}


@pytest.mark.slow
def test_a_lie_about_the_true_object_changes_nothing_but_what_the_prober_measures() -> None:
    lie = shapes.build("torus", 0.3)
    lied = touch(Scenario.from_config(CONFIG, lie), prober=make_prober(scenario()))
    assert honest().made == CONFIG.touches
    assert len(lied.outcomes) == len(honest().outcomes)
    assert np.array_equal(lied.contacts.points, honest().contacts.points)
    assert np.array_equal(lied.contacts.free_points, honest().contacts.free_points)


@pytest.mark.slow
def test_contacts_are_on_the_placed_object_and_above_the_table() -> None:
    contacts = honest().contacts
    gaps = np.abs(scenario().truth.shape.mesh.nearest.on_surface(contacts.points)[1])
    # Noise of 0.5 mm along each axis, and half a taxel of 2 mm along a surface of radius 36 mm.
    assert gaps.max() < 4.0 * 0.0005 + 0.001**2 / 0.036 + 1e-4
    assert contacts.points[:, 2].min() > -0.002
    assert np.all(contacts.position_noise == 0.0005)


@pytest.mark.slow
def test_the_hand_stays_above_the_table() -> None:
    free = honest().contacts
    # Each free ball is inside a link, but for half-spaces beyond ends, whose sides are upright.
    is_link = free.free_radii < HALF_SPACE
    assert np.min((free.free_points[:, 2] - free.free_radii)[is_link]) > -1e-9


@pytest.mark.slow
def test_the_estimate_is_closed_at_the_table() -> None:
    _, mesh = estimate(scenario().agent, honest().contacts)
    assert mesh.is_watertight
    assert mesh.bounds[0, 2] > -0.001


@pytest.mark.slow
def test_a_ruler_of_4_mm_is_touched_along_its_whole_length() -> None:
    ruler = Shape("ruler", trimesh.creation.box([0.22, 0.03, 0.004]), np.empty((0, 2, 3)))
    # Seeds 2 to 5 reach 0.22 m of 0.22 m, seeds 0 and 1 only 0.16 and 0.13 m.
    config = RunConfig(**UNKNOWN, object="ruler", touches=30, seed=2)
    on_table = Scenario.from_config(config, ruler)
    contacts = touch(on_table).contacts
    along = contacts.points @ on_table.truth.X_WO[:3, 0]
    assert np.ptp(along) > 0.2


@pytest.mark.slow
def test_an_object_below_the_fingertips_that_search_for_it_is_named(tmp_path: Path) -> None:
    card = trimesh.creation.box((0.0856, 0.054, 0.0008))
    card.export(tmp_path / "card.stl")
    config = RunConfig(**UNKNOWN, object=str(tmp_path / "card.stl"), hand="wsg50", touches=10)
    with pytest.raises(EstimationError, match="0.8 mm high, .*1.5 mm"):
        run(config, folder=tmp_path / "card")
    with pytest.raises(EstimationError, match="0.8 mm high"):
        run(RunConfig(config.object, hand="wsg50", touches=10, prober="kinematic"), tmp_path / "b")


@pytest.mark.slow
def test_the_summary_says_when_the_object_was_found() -> None:
    facts = exploration_facts(scenario(), honest())
    search = facts["search"]
    assert search["found"]
    before = honest().outcomes[: search["probes"]]
    assert [len(outcome.contacts) > 0 for outcome in before].index(True) == len(before) - 1
    assert search["seconds"] == pytest.approx(sum(outcome.duration for outcome in before))
    found, touched, *_ = exploration_lines(facts)
    assert f"after {search['probes']} probe" in found
    purposes = facts["purposes"]
    assert purposes["search"] == search["probes"]
    assert sum(purposes.values()) == facts["probes"]
    assert touched.endswith(f"{purposes['policy'] or 'none'} by the policy")


def test_an_object_in_a_region_needs_a_pose() -> None:
    with pytest.raises(InvalidOptionError) as error:
        RunConfig(region=(0.4, 0.4, 0.3))
    assert error.value.option == "pose"


def test_an_ideal_sensor_is_the_default_of_the_records() -> None:
    assert {name: RunConfig().facts()[name] for name in IDEAL_SENSOR} == IDEAL_SENSOR


@pytest.mark.slow
def test_the_files_record_pose_region_and_sensor(tmp_path: Path) -> None:
    arguments = ["explore", "box", "--prober", "kinematic", "--touches", "6"]
    assert main([*arguments, "--output", str(tmp_path)]) == 0
    facts = provenance.read(tmp_path / "contacts.ply")
    for name, value in {**UNKNOWN, "free": False}.items():
        assert facts[name] == value
    assert facts["support_height"] == 0.0
    there = placed(shapes.build("box"), facts["X_WO"]).mesh
    gaps = there.nearest.on_surface(Contacts.load(tmp_path / "contacts.ply").points)[1]
    assert np.abs(gaps).max() < 0.003
    header = json.loads((tmp_path / "touches.jsonl").read_text().splitlines()[0])
    assert header["X_WO"] == facts["X_WO"]
    # The later stages work in the same frame.
    assert main(["estimate", str(tmp_path / "contacts.ply")]) == 0
    assert provenance.read(tmp_path / "surface.ply")["X_WO"] == facts["X_WO"]


def test_options_that_contradict_each_other_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explore", "box", "--free", "--clamped"]) == 2
    assert "--clamped" in capsys.readouterr().err
