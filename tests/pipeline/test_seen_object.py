"""Objects that a camera saw before the first touch: touching, estimating, resuming."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lis_grasp.cli.main import build_parser, main
from lis_grasp.cli.options import configure_touch
from lis_grasp.cli.progress import PRINTED
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import Exploration
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.io.surface_files import load_surface
from lis_grasp.results.estimated_file import estimate_file
from lis_grasp.results.exploring import explore_object
from lis_grasp.results.folder import VIEW
from lis_grasp.results.notes import say_unseen
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.contact_sources import ContactSource
from lis_grasp.stages.estimate import SurfaceEstimate, estimate
from lis_grasp.stages.looking import look
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import make_perception, touch
from lis_grasp.stages.views_prior import ViewsPrior
from lis_grasp.task.scene_file import load_scene, write_scene
from lis_grasp.task.task import Task
from lis_grasp.views import Views, load_view, save_view

TASK = Task.of("box", hand="wsg50", prober="kinematic", estimator="gpis", camera=True, touches=3)


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explored")
    explore_object(TASK, folder)
    return folder


@pytest.fixture(scope="module")
def seen() -> Scenario:
    return Scenario.from_config(TASK)


@pytest.fixture(scope="module")
def touched(seen: Scenario) -> Exploration:
    return touch(seen)


def test_a_view_gives_the_place_so_that_nothing_is_searched(
    seen: Scenario, touched: Exploration
) -> None:
    scenario, exploration = seen, touched
    assert scenario.agent.views is not None
    truth = scenario.truth.shape.mesh
    assert exploration.made == 3
    assert exploration.outcomes[0].probe.target @ [0, 0, 1] > 0.0
    targets = np.array([outcome.probe.target for outcome in exploration.outcomes])
    assert np.abs(targets - truth.bounds.mean(axis=0)).max() < truth.extents.max()


@pytest.mark.slow
def test_an_exploration_that_was_killed_ends_with_the_same_bytes(
    explored: Path, tmp_path: Path
) -> None:
    explore_object(TASK, tmp_path)
    lines = (tmp_path / "touches.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "touches.jsonl").write_bytes(b"".join(lines[:2]))
    (tmp_path / "contacts.ply").unlink()
    explore_object(TASK, tmp_path)
    for name in ("contacts.ply", VIEW):
        assert (tmp_path / name).read_bytes() == (explored / name).read_bytes()


def test_only_touches_are_saved_as_contacts_and_the_view_beside_them(
    explored: Path, seen: Scenario, touched: Exploration
) -> None:
    assert Contacts.load(explored / "contacts.ply").points == pytest.approx(touched.contacts.points)
    view = load_view(explored / VIEW)
    (kept,) = seen.agent.seen_by
    assert view == kept


@pytest.mark.slow
def test_the_estimate_of_saved_contacts_is_that_of_the_robot(explored: Path) -> None:
    made = estimate_file([ContactSource(explored / "contacts.ply")])
    agent = Scenario.from_config(TASK).agent
    own = SurfaceEstimate(Contacts.load(explored / "contacts.ply"), agent.perception).mesh
    np.testing.assert_array_equal(load_surface(made.path).vertices, own.vertices)


def test_a_view_without_any_touch_is_an_estimate(seen: Scenario) -> None:
    scenario = seen
    surface = estimate(Contacts.empty(), "gpis", views=scenario.agent.seen_by, support_height=0.0)
    made = SurfaceEstimate(Contacts.empty(), scenario.agent.perception)
    off, _ = distances_to_mesh(made.mesh.vertices, scenario.truth.shape.mesh)
    assert made.mesh.is_watertight
    assert np.median(off) < 0.004  # the camera's error of 3.3 mm and 0.5 mm
    assert float(surface.evaluate(scenario.truth.shape.mesh.bounds.mean(axis=0))) < 0.0
    with pytest.raises(InvalidOptionError) as error:
        estimate(Contacts.empty(), views=scenario.agent.seen_by)
    assert error.value.option == "support_height"


def test_a_displaced_view_makes_no_touch_a_stray_and_is_dropped() -> None:
    agent, exact = Scenario.from_config(TASK).agent, TASK.having(hand_eye=(0.0, 0.0))
    scenario = Scenario.from_config(exact)
    view = look(exact, scenario.truth.shape, 0.0)
    X_WC = view.X_WC.copy()
    X_WC[:2, 3] += 0.03
    touches = touch(Scenario.from_config(TASK.having(camera=False, touches=8))).contacts
    prior = ViewsPrior(Views((replace(view, X_WC=X_WC),), 0.0))
    given = prior.given(touches)
    assert (len(given.seen), len(given.guesses), given.free) == (0, 0, ())
    perception = make_perception(replace(agent.perception, prior=prior))
    assert perception.find_strays is not None
    assert not len(perception.find_strays(touches))


@pytest.mark.slow
def test_knowledge_of_a_view_depends_on_the_touches_alone(touched: Exploration) -> None:
    touches = touched.contacts
    first, second = (Scenario.from_config(TASK).agent.perception.prior for _ in range(2))
    first.given(touches[:1])
    assert first.given(touches).seen == second.given(touches).seen
    assert first.given(touches).guesses == second.given(touches).guesses


def test_a_view_of_an_object_that_was_lost_is_no_longer_used(
    seen: Scenario, touched: Exploration
) -> None:
    scenario, exploration = seen, touched
    last = exploration.observations[-1]
    belief = replace(PoseBelief.start(), trust="lost")
    lost = replace(
        exploration, observations=(*exploration.observations, replace(last, belief=belief))
    )
    assert scenario.after(exploration, None).agent.views is scenario.agent.views
    assert scenario.after(lost, None).agent.views is None
    assert scenario.after(lost, None).facts()["seen"] == 0


def test_recorded_views_are_repeatable_options_of_verbs_and_scenes(
    explored: Path, tmp_path: Path
) -> None:
    view = str(explored / VIEW)
    arguments = ["run", "box", "--view", view, "--view", view, "--hand-eye", "0.001", "0.01"]
    task = configure_touch(build_parser().parse_args(arguments))
    assert task.known.views == (view, view)
    assert task.robot.hand_eye == (0.001, 0.01)
    write_scene(task, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == task
    recorded = Scenario.from_config(Task.of("box", views=[view], prober="kinematic")).agent
    (kept,) = Scenario.from_config(TASK).agent.seen_by
    assert recorded.seen_by[0] == kept


def test_a_wrong_error_of_a_camera_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for wrong in ((0.002,), (-0.001, 0.0), (2.0, 0.0)):
        with pytest.raises(InvalidOptionError) as error:
            Task.of("box", hand_eye=wrong)
        assert error.value.option == "hand_eye"
    assert main(["explore", "box", "--view", "absent.npz", "--output", "absent"]) == 2
    assert "absent.npz" in capsys.readouterr().err


@pytest.mark.parametrize(("seed", "warns"), [(0, False), (1, True)])
def test_a_view_of_another_pose_is_told_before_the_start(
    seen: Scenario, seed: int, warns: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert seen.agent.views is not None
    path = tmp_path / "view.npz"
    save_view(seen.agent.views.views[0], path)  # of seed 0
    task = TASK.having(camera=False, views=(str(path),), seed=seed)
    say_unseen(Scenario.from_config(task), PRINTED)
    assert ("simulated one, which is at a random pose" in capsys.readouterr().out) == warns


def test_explore_says_what_was_seen_as_run_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["explore", "box", "--hand", "wsg50", "--prober", "kinematic", "--estimator", "gpis"]
    assert main([*command, "--camera", "--touches", "1", "--output", str(tmp_path)]) == 0
    assert "\nseen      by " in capsys.readouterr().out
