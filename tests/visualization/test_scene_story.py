"""Time line of a scene: its chapters, growing estimates, and the hand at its touches."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import scenes
from numpy.testing import assert_allclose, assert_array_equal

from lis_grasp import pipeline, shapes
from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Exploration, load_observations
from lis_grasp.io import provenance
from lis_grasp.meshing import extract_mesh
from lis_grasp.results import exploring
from lis_grasp.results.growing import growth_counts
from lis_grasp.results.page import scene_of, write_scene_of
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.visualization._story import Story

# ---- chapters -------------------------------------------------------------------------------


def test_chapters_follow_each_other_without_gaps() -> None:
    story = Story.of(contacts=40, surfaces=[5, 40], grasps=3, lift_seconds=7.0)
    assert [c.name for c in story.chapters] == ["touch", "grasp", "lift"]
    ends = [0.0, *(c.end for c in story.chapters)]
    assert [c.start for c in story.chapters] == ends[:-1]
    assert np.all(np.diff(ends) > 0.0)
    assert story.duration == ends[-1]


def test_every_contact_is_shown_before_the_touch_chapter_ends() -> None:
    for contacts in (2, 40, 5000):
        touch = Story.of(contacts=contacts, surfaces=[], grasps=0, lift_seconds=0.0).chapters[0]
        assert contacts * touch.facts["step"] < touch.end <= 25.0


def test_the_resting_time_is_before_the_lift() -> None:
    full = Story.of(contacts=6, surfaces=[6], grasps=2, lift_seconds=2.0)
    assert full.rest == full.chapters[1].end == full.chapters[2].start
    touched = Story.of(contacts=6, surfaces=[6], grasps=0, lift_seconds=0.0)
    assert touched.rest == touched.duration


def test_the_lift_chapter_has_the_simulated_duration() -> None:
    lift = Story.of(contacts=6, surfaces=[6], grasps=2, lift_seconds=2.5).chapters[2]
    assert lift.end - lift.start == pytest.approx(2.5)


def test_a_static_scene_has_no_chapters() -> None:
    for grasps in (0, 1):
        still = Story.of(contacts=1, surfaces=[1], grasps=grasps, lift_seconds=0.0)
        assert (still.chapters, still.duration, still.rest) == ((), 0.0, 0.0)


# ---- growth and touches ---------------------------------------------------------------------


@pytest.mark.parametrize("counts", [(3, 3), (0,), (6,)])
def test_growth_of_unordered_or_too_many_contacts_is_refused(counts: tuple[int, ...]) -> None:
    mesh = scenes.estimate()
    assert scenes.scene(growth=((2, mesh), (5, mesh))).growth
    with pytest.raises(InvalidOptionError) as error:
        scenes.scene(growth=tuple((count, mesh) for count in counts))
    assert (error.value.option, error.value.value) == ("growth", list(counts))


def test_growth_may_reach_all_contacts_while_the_estimate_is_missing() -> None:
    growing = scenes.scene(estimate=None, growth=((6, scenes.estimate()),))
    assert growing.growth
    with pytest.raises(InvalidOptionError) as error:
        scenes.scene(estimate=None, growth=((7, scenes.estimate()),))
    assert error.value.option == "growth"


def test_touches_are_one_per_contact_or_none() -> None:
    with pytest.raises(InvalidOptionError) as error:
        scenes.scene(touches=scenes.touches()[:2])
    assert error.value.value == 2
    assert scenes.facts_of(scenes.scene(touches=(None,) * 6).html())["touches"] == [None] * 6


def test_the_page_has_the_recorded_hand_and_direction_of_each_touch() -> None:
    hand, touches = scenes.hand(), scenes.touches()
    for touch, drawn in zip(
        touches, scenes.facts_of(scenes.scene().html())["touches"], strict=True
    ):
        assert_allclose(drawn["direction"], touch.probe.direction)
        poses = hand.forward_kinematics(touch.hand_pose.X_OH, touch.hand_pose.joint_positions)
        for link, X_OL in zip(hand.links, drawn["links"], strict=True):
            # The page rounds to 7 decimals.
            assert_allclose(np.reshape(X_OL, (4, 4)).T, poses[link], atol=1e-7)


@pytest.mark.parametrize("contacts", [*range(12), 40, 300, 10_000])
def test_kept_estimates_are_few_and_before_the_last_contact(contacts: int) -> None:
    counts = growth_counts(contacts)
    assert counts == sorted(set(counts))
    assert len(counts) <= 24
    assert all(2 <= count < contacts for count in counts)
    assert bool(counts) == (contacts > 2)


# ---- a folder of results --------------------------------------------------------------------

HAND = ["--prober", "kinematic", "--hand", "wsg50"]
EXPLORE = ["explore", "box", "--known", *HAND, "--touches", "6", "--seed", "4"]
GROWTH = [3, 4, 5]


def scene_counts(folder: Path) -> list[int]:
    return [count for count, _ in scene_of(folder).growth]


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the contacts, the log, the growth and the surface of a box."""
    folder = tmp_path_factory.mktemp("explored")
    assert main([*EXPLORE, "--output", str(folder)]) == 0
    assert main(["estimate", str(folder / "contacts.ply")]) == 0
    return folder


@pytest.fixture
def folder(explored: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(explored, tmp_path / "copy"))


def test_growth_is_the_estimate_from_the_first_contacts(explored: Path) -> None:
    observations = load_observations(explored / "touches.jsonl")
    growth = scene_of(explored).growth
    assert [count for count, _ in growth] == GROWTH
    for count, mesh in growth[1::2]:
        first = Exploration.replay(observations).first(count)
        surface, _ = pipeline.estimate(pipeline.Perception(estimator="blend"), first)
        cell = float(np.ptp(surface.bounds, axis=0).max()) / 26
        expected = extract_mesh(surface, resolution=cell)
        assert_array_equal(mesh.vertices, expected.vertices)
        assert_array_equal(mesh.faces, expected.faces)


def test_before_the_first_touch_the_object_and_its_region_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    placed = {"region": (0.4, 0.4, 0.3), "pose": "stable"}
    config = pipeline.RunConfig("box", hand="wsg50", prober="kinematic", **placed)

    def shown(*_: object) -> Iterator[None]:
        scene = scene_of(tmp_path)
        assert scene.region is not None
        assert tuple(scene.region.lengths) == config.region
        assert scene.truth is not None
        assert not len(scene.contacts)
        raise KeyboardInterrupt

    monkeypatch.setattr(exploring, "touch_steps", shown)
    with pytest.raises(KeyboardInterrupt):
        pipeline.explore_object(config, tmp_path)


def test_a_growing_exploration_has_a_scene(folder: Path) -> None:
    whole = scene_of(folder)
    for name in ("contacts.ply", "surface.ply"):
        (folder / name).unlink()
    growing = scene_of(folder)
    assert growing.estimate is None
    assert_array_equal(growing.contacts.points, whole.contacts.points)
    assert [count for count, _ in growing.growth] == GROWTH
    lines = (folder / "touches.jsonl").read_text().splitlines(keepends=True)
    (folder / "touches.jsonl").write_text(lines[0])
    assert not len(scene_of(folder).contacts)  # the true object alone
    (folder / "touches.jsonl").write_text("".join(lines[:4]) + lines[4][:20])  # half a line
    growing = scene_of(folder)
    assert [count for count, _ in growing.growth] == [3]
    assert len(growing.touches) == len(growing.contacts) == 3
    assert "<!DOCTYPE html>" in growing.html()


def test_recorded_hands_touch_the_object_at_their_contacts(explored: Path) -> None:
    scene = scene_of(explored)
    checker = HandCollisionChecker(scene.hand, shapes.build("box").mesh)
    for touch, point in zip(scene.touches, scene.contacts.points, strict=True):
        pose = touch.hand_pose
        checker.place(pose.X_OH, checker.poses_in_hand(pose.joint_positions))
        nearest = checker.nearest(np.zeros(3))
        # Guarded motions end within 0.02 mm of the surface.
        assert 0.0 <= nearest.distance < 5e-5
        assert_allclose(nearest.point, point, atol=1e-4)


def test_touches_of_other_contacts_and_of_a_damaged_log_are_not_drawn(folder: Path) -> None:
    path = folder / "contacts.ply"
    header = provenance.merge(provenance.read(path))
    contacts = Contacts.load(path)
    later = contacts.append(contacts.subset([0]))
    later.save(path, header=header)  # as after a regrasp
    assert [touch is None for touch in scene_of(folder).touches] == [False] * 6 + [True]
    Contacts(contacts.points + 1e-3, contacts.normals).save(path, header=header)
    assert not scene_of(folder).touches
    contacts.save(path, header=header)
    (folder / "touches.jsonl").write_text("no log")
    assert not scene_of(folder).touches


@pytest.mark.slow
def test_growth_of_another_estimator_is_not_drawn(folder: Path) -> None:
    assert main(["estimate", str(folder / "contacts.ply"), "--estimator", "lis"]) == 0
    assert scene_counts(folder) == []
    assert main(["estimate", str(folder / "contacts.ply"), "--estimator", "blend"]) == 0
    assert scene_counts(folder) == GROWTH


@pytest.mark.slow
def test_a_new_exploration_replaces_the_growth(folder: Path) -> None:
    own = folder / "growth" / "mine.ply"
    own.write_text("mine")
    assert main([*EXPLORE, "--touches", "4", "--output", str(folder)]) == 0
    assert main(["estimate", str(folder / "contacts.ply")]) == 0
    assert scene_counts(folder) == [3]
    assert {path.name for path in own.parent.iterdir()} == {"3.ply"}
    assert (folder / "earlier" / "1" / "growth" / "mine.ply").read_text() == "mine"


def test_a_resumed_exploration_keeps_the_same_growth(folder: Path) -> None:
    log = folder / "touches.jsonl"
    rows = log.read_bytes().splitlines(keepends=True)
    before = {path.name: path.read_bytes() for path in (folder / "growth").iterdir()}
    log.write_bytes(b"".join(rows[:5]))  # the header and four probes
    for name in before:
        (folder / "growth" / name).unlink()
    assert main([*EXPLORE, "--output", str(folder)]) == 0
    after = {path.name: path.read_bytes() for path in (folder / "growth").iterdir()}
    assert after == {name: before[name] for name in before if name != "3.ply"}
    assert main(["estimate", str(folder / "contacts.ply")]) == 0
    assert scene_counts(folder) == GROWTH[1:]


def test_the_scene_of_a_folder_has_equal_bytes_each_time(folder: Path) -> None:
    first, second = (write_scene_of(folder).read_text(encoding="utf-8") for _ in range(2))
    assert first == second
    [touch] = scenes.facts_of(first)["story"]["chapters"]
    assert touch["surfaces"] == [*GROWTH, 6]


@pytest.mark.slow
def test_a_run_of_forty_touches_makes_a_page_of_less_than_fifteen_megabytes(
    tmp_path: Path,
) -> None:
    options = ["--touches", "40", "--prober", "kinematic", "--estimator", "lis", "--grasps", "5"]
    assert main(["run", "cylinder", *options, "--output", str(tmp_path)]) == 0
    assert (tmp_path / "scene.html").stat().st_size < 15e6
