"""The story of a scene: its chapters, the estimates on the way, and the hand at its touches."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from numpy.testing import assert_allclose, assert_array_equal

from lis_grasp import pipeline
from lis_grasp.cli.explore import explored_header
from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import TouchLog, Workspace, load_outcomes
from lis_grasp.hands.collision import HandCollisionChecker
from lis_grasp.hands.hand import Hand
from lis_grasp.io import provenance
from lis_grasp.io.surface_files import load_surface, save_surface
from lis_grasp.shapes import Shape, find
from lis_grasp.visualization.run_scene import (
    counts_on_the_way,
    estimates_on_the_way,
    poses_of_touches,
    write_scene_of,
)
from lis_grasp.visualization.story import Story

# ---- chapters -------------------------------------------------------------------------------


def test_chapters_follow_each_other_without_gaps() -> None:
    story = Story.of(contacts=40, surfaces=[5, 40], grasps=3, lift_seconds=7.0)
    assert [c.name for c in story.chapters] == ["touch", "grasp", "lift"]
    ends = [0.0, *(c.end for c in story.chapters)]
    assert [c.start for c in story.chapters] == ends[:-1]
    assert np.all(np.diff(ends) > 0.0)
    assert story.duration == ends[-1]


def test_every_contact_has_come_before_the_touches_end() -> None:
    for contacts in (2, 40, 5000):
        touch = Story.of(contacts=contacts, surfaces=[], grasps=0, lift_seconds=0.0).chapters[0]
        assert contacts * touch.facts["step"] < touch.end <= 25.0


def test_a_scene_rests_where_all_is_known_and_nothing_is_lifted() -> None:
    full = Story.of(contacts=6, surfaces=[6], grasps=2, lift_seconds=2.0)
    assert full.rest == full.chapter("grasp").end == full.chapter("lift").start
    touched = Story.of(contacts=6, surfaces=[6], grasps=0, lift_seconds=0.0)
    assert touched.rest == touched.duration


def test_a_lift_lasts_as_long_as_it_did() -> None:
    lift = Story.of(contacts=6, surfaces=[6], grasps=2, lift_seconds=2.5).chapter("lift")
    assert lift.end - lift.start == pytest.approx(2.5)


def test_what_never_changes_is_no_story() -> None:
    for grasps in (0, 1):
        still = Story.of(contacts=1, surfaces=[1], grasps=grasps, lift_seconds=0.0)
        assert (still.chapters, still.duration, still.rest) == ((), 0.0, 0.0)


# ---- growth ---------------------------------------------------------------------------------


def test_growth_must_lead_up_to_the_estimate() -> None:
    mesh = scenes.estimate()
    assert scenes.scene(growth=((2, mesh), (5, mesh))).html()
    wrong: list[dict[str, Any]] = [
        {"growth": ((3, mesh), (3, mesh))},
        {"growth": ((0, mesh),)},
        {"growth": ((6, mesh),)},  # all six contacts are the estimate's
        {"growth": ((3, mesh),), "estimate": None},
    ]
    for changes in wrong:
        with pytest.raises(InvalidOptionError, match="must lead up to an estimate"):
            scenes.scene(**changes)


def test_a_pose_for_some_contacts_only_is_refused() -> None:
    with pytest.raises(InvalidOptionError, match=r"one a contact \(6\), or none; 2 came"):
        scenes.scene(touch_poses=scenes.touch_poses()[:2])
    assert scenes.scene(touch_poses=(None,) * 6).html()


@pytest.mark.parametrize("contacts", [*range(12), 40, 300, 10_000])
def test_steps_on_the_way_are_few_and_end_before_the_last_contact(contacts: int) -> None:
    counts = counts_on_the_way(contacts)
    assert counts == sorted(set(counts))
    assert len(counts) <= 9
    assert all(2 <= n < contacts and n <= 300 for n in counts)
    assert bool(counts) == (contacts > 2)


# ---- a folder of results --------------------------------------------------------------------


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Shape, Hand]:
    """Return a folder with contacts, their log and the surface of a box, touched by geometry."""
    directory = tmp_path_factory.mktemp("explored")
    config = pipeline.RunConfig(object="box", prober="kinematic", touches=12, seed=4)
    shape, hand = find("box"), Hand.load("allegro")
    header = explored_header(config, shape)
    log = TouchLog(directory / "touches.jsonl", provenance.parse(header))
    contacts = pipeline.touch(shape, hand, config, log=log).contacts
    contacts.save(directory / "contacts.ply", header=header)
    _, mesh = pipeline.estimate(contacts, config.estimator)
    made = provenance.merge(provenance.parse(header), estimator=config.estimator)
    save_surface(mesh, directory / "surface.ply", header=made)
    return directory, shape, hand


def test_estimates_on_the_way_are_the_estimators_own(explored: tuple[Path, Shape, Hand]) -> None:
    contacts = Contacts.load(explored[0] / "contacts.ply")
    for estimator in ("blend", "gpis"):
        growth = estimates_on_the_way(contacts, {"estimator": estimator})
        assert [count for count, _ in growth] == counts_on_the_way(len(contacts))
        count, mesh = growth[2]
        first = Contacts(contacts.points[:count], contacts.normals[:count])
        _, expected = pipeline.estimate(first, estimator)
        assert_array_equal(mesh.vertices, expected.vertices)
        assert_array_equal(mesh.faces, expected.faces)


def test_a_surface_of_unknown_origin_has_nothing_on_the_way() -> None:
    assert estimates_on_the_way(scenes.contacts(), {}) == []
    assert estimates_on_the_way(scenes.contacts(), {"estimator": "magic"}) == []


def test_hands_at_their_touches_touch_there_and_nowhere_deeper(
    explored: tuple[Path, Shape, Hand],
) -> None:
    directory, shape, hand = explored
    contacts = Contacts.load(directory / "contacts.ply")
    facts = provenance.read(directory / "contacts.ply")
    poses = poses_of_touches(directory / "touches.jsonl", contacts, facts, shape, hand)
    assert len(poses) == len(contacts)
    checker = HandCollisionChecker(hand, shape.mesh)
    for pose, point in zip(poses, contacts.points, strict=True):
        assert pose is not None
        checker.place(pose.X_OH, checker.poses_in_hand(pose.joint_positions))
        nearest = checker.nearest(np.zeros(3))
        # Guarded motions end within 0.02 mm, and the same motion ends at the same place.
        assert 0.0 <= nearest.distance < 5e-5
        assert_allclose(nearest.point, point, atol=1e-4)


def test_a_log_of_other_contacts_tells_nothing(explored: tuple[Path, Shape, Hand]) -> None:
    directory, shape, hand = explored
    log = directory / "touches.jsonl"
    contacts = Contacts.load(directory / "contacts.ply")
    facts = provenance.read(directory / "contacts.ply")
    moved = Contacts(contacts.points + 1e-3, contacts.normals)
    assert poses_of_touches(log, moved, facts, shape, hand) == []
    assert poses_of_touches(log, contacts, {}, shape, hand) == []
    assert poses_of_touches(directory / "surface.ply", contacts, facts, shape, hand) == []


def test_touches_that_do_not_end_where_they_were_felt_are_left_out(
    explored: tuple[Path, Shape, Hand],
) -> None:
    from lis_grasp.surfaces import ESTIMATORS
    from lis_grasp.visualization.touch_poses import replay_touches

    directory, shape, hand = explored
    grown = shape.mesh.copy()
    grown.apply_scale(1.2)  # the hand now stops 5 to 10 mm earlier
    space = Workspace(0.25 * shape.size, shape.mesh.bounds.mean(axis=0), shape.size)
    outcomes = load_outcomes(directory / "touches.jsonl")
    poses = replay_touches(
        outcomes, 12, mesh=grown, hand=hand, space=space, estimate=ESTIMATORS["blend"]
    )
    assert poses == [None] * 12


def test_the_scene_of_a_folder_tells_how_its_surface_grew(
    explored: tuple[Path, Shape, Hand], tmp_path: Path
) -> None:
    directory = tmp_path / "copy"
    shutil.copytree(explored[0], directory)
    page = write_scene_of(directory).read_text(encoding="utf-8")
    assert page == write_scene_of(directory).read_text(encoding="utf-8")
    text = re.search(r'id="scene-data">(.*?)</script>', page, re.S)
    assert text is not None
    facts = json.loads(text[1])
    [touch] = facts["story"]["chapters"]
    assert touch["surfaces"] == [*counts_on_the_way(12), 12]
    assert len(facts["touching"]["touches"]) == 12
    assert None not in facts["touching"]["touches"]
    last = load_surface(directory / "surface.ply")
    assert len(last.faces) > 100


@pytest.mark.slow
def test_a_run_of_forty_touches_makes_a_page_of_less_than_fifteen_megabytes(
    tmp_path: Path,
) -> None:
    options = ["--touches", "40", "--prober", "kinematic", "--estimator", "lis", "--grasps", "5"]
    assert main(["run", "cylinder", *options, "--output", str(tmp_path)]) == 0
    assert (tmp_path / "scene.html").stat().st_size < 15e6
