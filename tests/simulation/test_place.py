"""Placing: plans on an estimate, reasons by data, and boxes that stand where they were planned."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import trimesh
from made_grasps import jaw_grasp
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import apply_pose, make_pose
from lis_grasp.grasping.surface_uncertainty import allowed_meshes
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.place_plan import PlacePlan, PlaceReason, errors_of_place, reason_of_place
from lis_grasp.lifting.placing import placed_wrist
from lis_grasp.lifting.planned_places import (
    Corner,
    PlaceSearch,
    Stand,
    stands_of,
    turned_about,
)
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.wrist_path import displaced
from lis_grasp.results.placed import PLACE_REASONS
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.lift import simulate_lift
from lis_grasp.stages.place import CORNER as PLACE_OF_CORNER
from lis_grasp.stages.place import corner_walls
from lis_grasp.task.scene_file import load_scene, write_scene
from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Body, Surroundings, Table

QUICK = LiftOptions(hold_time=0.01, lift_time=0.3, shake_accelerations=())
DEGREE = np.deg2rad(1.0)
CORNER = Corner(np.array([*PLACE_OF_CORNER, -0.05]), -np.eye(3)[:2], ("wall_x", "wall_y"))


@pytest.fixture(scope="module")
def wsg50() -> Hand:
    return Hand.load("wsg50")


def box() -> trimesh.Trimesh:
    return trimesh.creation.box((0.05, 0.07, 0.10))


def search(hand: Hand, mesh: trimesh.Trimesh, bodies: Surroundings = ALONE) -> PlaceSearch:
    grasp = jaw_grasp(hand, np.array([0.0, 0.0, 0.02]), 0.05)
    return PlaceSearch(
        hand, grasp, mesh, Table(-0.05, surroundings=bodies), lift_height=0.1, standoff=0.12
    )


def placing(hand: Hand, motion: np.ndarray) -> LiftSetup:
    grasp = jaw_grasp(hand, np.array([0.0, 0.0, 0.02]), 0.05)
    plan = PlacePlan(motion, carry=0.1, band=0.005)
    return LiftSetup(box(), hand, grasp, -0.05, options=QUICK, place=plan)


@pytest.mark.parametrize("yaw", [0.5 * np.pi, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_box_stands_where_its_place_was_planned(wsg50: Hand, yaw: float) -> None:
    motion = turned_about(np.zeros(3), yaw)
    motion[0, 3] += 0.1
    outcome = simulate_lift(placing(wsg50, motion))
    assert outcome.held
    assert outcome.place is not None
    assert outcome.place.reason == "placed"
    errors = errors_of_place(outcome.X_WO, motion, np.zeros(3))
    assert errors[0] < 0.002
    assert errors[1] < DEGREE
    assert errors == (outcome.place.moved, outcome.place.turned, outcome.place.leaning)
    assert outcome.place.felt is not None


@pytest.mark.slow
def test_mujoco_places_a_box_as_drake_does(wsg50: Hand) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")
    from lis_grasp.simulation.mujoco.lift import simulate_in_mujoco

    motion = turned_about(np.zeros(3), 0.5)
    motion[1, 3] += 0.1
    outcome = simulate_in_mujoco(placing(wsg50, motion))
    assert outcome.place is not None
    assert outcome.place.reason == "placed"
    assert errors_of_place(outcome.X_WO, motion, np.zeros(3))[0] < 0.002


@pytest.mark.slow
def test_a_wall_that_is_pushed_ends_placing(wsg50: Hand) -> None:
    motion = make_pose(np.eye(3), (0.2, 0.0, 0.0))
    wall = Surroundings((Body.box("wall", (0.02, 0.4, 0.3), (0.19, 0.0, 0.1)),))
    outcome = simulate_lift(replace(placing(wsg50, motion), surroundings=wall))
    assert outcome.held
    assert outcome.place is not None
    assert outcome.place.reason == "collided"
    assert outcome.forces["wall"] > 2.0


def test_the_errors_of_a_place_are_those_of_the_pose() -> None:
    planned = make_pose(Rotation.from_euler("z", 0.3).as_matrix(), (0.1, 0.2, 0.0))
    center = np.array([0.01, 0.0, 0.05])
    turn = turned_about(apply_pose(planned, center), 0.2)
    assert errors_of_place(turn @ planned, planned, center) == pytest.approx(
        (0.0, 0.2, 0.0), abs=1e-7
    )  # arccos at 1
    lean = make_pose(Rotation.from_euler("x", 0.4).as_matrix(), (0.0, 0.0, 0.003))
    moved, turned, leaning = errors_of_place(lean @ planned, planned, np.zeros(3))
    assert (turned, leaning) == pytest.approx((0.4, 0.4))
    expected = np.linalg.norm(apply_pose(lean, planned[:3, 3]) - planned[:3, 3])
    assert moved == pytest.approx(expected)


@pytest.mark.parametrize(
    ("errors", "reason"),
    [
        ((0.004, 4.0, 4.0), "placed"),
        ((0.006, 4.0, 4.0), "moved"),
        ((0.006, 6.0, 4.0), "turned"),
        ((0.0, 6.0, 6.0), "fallen"),
    ],
)
def test_the_largest_error_names_the_reason(
    errors: tuple[float, float, float], reason: PlaceReason
) -> None:
    moved, turned, leaning = errors
    assert reason_of_place(moved, turned * DEGREE, leaning * DEGREE) == reason


def test_every_reason_has_a_sentence() -> None:
    assert set(PLACE_REASONS) == set(get_args(PlaceReason))


def test_the_wrist_takes_the_object_to_the_place(wsg50: Hand) -> None:
    X_WB = placing(wsg50, np.eye(4)).X_WB
    here = np.array([0.001, -0.002, 0.003, 0.0, 0.0, 0.0])
    motion = make_pose(Rotation.from_euler("xyz", (0.2, -0.4, 1.1)).as_matrix(), (0.3, 0.1, 0.02))
    X_OB = displaced(X_WB, here)
    reached = displaced(X_WB, placed_wrist(X_WB, X_OB, motion))
    np.testing.assert_allclose(reached, motion @ X_OB, atol=1e-12)


def test_the_band_of_an_exact_mesh_is_nothing_and_of_a_ball_two_deviations(wsg50: Hand) -> None:
    assert search(wsg50, box()).band_toward(np.array([1.0, 0.0, 0.0])) == 0.0
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    ball.vertex_attributes["uncertainty"] = np.full(len(ball.vertices), 0.004)
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])):
        # The icosphere has vertices on its axes.
        assert search(wsg50, ball).band_toward(direction) == pytest.approx(0.008, rel=1e-3)


def test_an_exact_box_is_planned_flush_with_the_walls_but_for_the_fingers(wsg50: Hand) -> None:
    walls = corner_walls(-0.05)
    plan = search(wsg50, box(), walls).in_corner(CORNER, Stand.as_before())
    assert plan is not None
    there = apply_pose(plan.motion, box().vertices)
    for axis, name in enumerate(CORNER.names):
        assert CORNER.vertex[axis] - there[:, axis].max() == pytest.approx(plan.gaps[name])
    # No finger is between the box and one of the walls: the gap is two deviations of the palm.
    assert min(plan.gaps.values()) == pytest.approx(0.002)
    assert max(plan.gaps.values()) > 0.01


def test_a_place_keeps_off_known_bodies(wsg50: Hand) -> None:
    alone = search(wsg50, box()).on_table(Stand.as_before())
    assert alone is not None
    np.testing.assert_allclose(alone.motion, make_pose(np.eye(3), (0.1, 0.0, 0.0)), atol=1e-15)
    crate = Surroundings((Body.box("crate", (0.06, 0.3, 0.1), (0.12, 0.0, 0.0)),))
    beside = search(wsg50, box(), crate).on_table(Stand.as_before())
    assert beside is not None
    assert apply_pose(beside.motion, box().vertices)[:, 0].max() < 0.09


def test_a_scene_file_keeps_the_place(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("scene") / "box.yaml"
    task = Task.of("box", hand="wsg50", place="corner")
    write_scene(task, path)
    assert load_scene(path) == task
    assert load_scene(path).decide.place == "corner"


@pytest.mark.slow
def test_a_box_is_put_on_another_face_that_the_estimate_rests_on(wsg50: Hand) -> None:
    rng = np.random.default_rng(0)
    first, *others = stands_of(box(), -0.05, rng=rng)
    np.testing.assert_array_equal(first.turn, np.eye(4))
    assert all(stand.stands == 1.0 for stand in others)  # the mesh is exact
    grasped = search(wsg50, box())
    plans = [plan for stand in others if (plan := grasped.on_table(stand)) is not None]
    assert plans  # where neither the hand nor the wrist hits the table
    outcome = simulate_lift(placing(wsg50, plans[0].motion))
    assert outcome.place is not None
    assert outcome.place.reason == "placed"
    assert outcome.X_WO[2, 2] == pytest.approx(0.0, abs=0.01)


def test_surfaces_that_an_estimate_allows_deviate_as_it_says() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    ball.vertex_attributes["uncertainty"] = np.full(len(ball.vertices), 0.001)
    rng, count = np.random.default_rng(0), 200
    radii = np.array(
        [np.linalg.norm(m.vertices, axis=1) for m in allowed_meshes(ball, count, rng=rng)]
    )
    # Four standard deviations of the deviation of that many normal numbers.
    assert radii.std(axis=0).mean() == pytest.approx(0.001, rel=4.0 / np.sqrt(2.0 * count))
    assert abs(radii.mean(axis=0) - 0.03).mean() < 4.0 * 0.001 / np.sqrt(count)
