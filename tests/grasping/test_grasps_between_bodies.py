"""Grasps keep hand and carried object off the bodies beside it, by an independent check."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import trimesh
from trimesh.collision import CollisionManager

from lis_grasp import shapes
from lis_grasp.grasping.grasps import LIFT, STANDOFF, Grasp, GraspSearch
from lis_grasp.grasping.lift_path import LiftPath
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.grasping.surface_uncertainty import PALM_ERROR
from lis_grasp.lifting.outcome import LiftOptions
from lis_grasp.lifting.planned_lifts import LIFT_HEIGHTS, choose_lift, lift_path, permitted_lifts
from lis_grasp.lifting.wrist_path import displaced, shake_about
from lis_grasp.results.summary import no_grasp_sentence
from lis_grasp.robots.hand import Hand
from lis_grasp.world import ALONE, Body, Surroundings

BOX = shapes.build("box").mesh  # 84 x 60 x 120 mm about the origin
TABLE = float(BOX.bounds[0, 2])
HAND = Hand.load("wsg50")
AWAY = trimesh.transformations.translation_matrix([0.0, 0.0, 9.0])
OPTIONS = LiftOptions()
LIFTS = permitted_lifts(OPTIONS)
CANDIDATES = 200


def wall(gap: float) -> Surroundings:
    """Return a wall, 150 mm high, at a gap from the box [m]."""
    x = float(BOX.bounds[1, 0]) + gap + 0.01
    return Surroundings((Body.box("wall", (0.02, 0.6, 0.15), (x, 0.0, TABLE + 0.075)),))


def board(gap: float) -> Surroundings:
    """Return a board at a gap above the box [m]."""
    z = float(BOX.bounds[1, 2]) + gap + 0.01
    return Surroundings((Body.box("board", (0.6, 0.6, 0.02), (0.0, 0.0, z)),))


def plan(surroundings: Surroundings, *, margin: float = 0.0, lifts=LIFTS) -> GraspSearch:
    sampler = ForceClosureSampler(
        HAND, candidates=CANDIDATES, surroundings=surroundings, lifts=lifts, margin=margin
    )
    return sampler.sample(BOX, support_height=TABLE, count=2)


class Oracle:
    """Trimesh's own collision managers of hand, box and bodies."""

    def __init__(self, surroundings: Surroundings) -> None:
        self.moved, self._bodies = CollisionManager(), CollisionManager()
        for k, geometry in enumerate(HAND.link_geometries):
            self.moved.add_object(str(k), geometry.mesh)  # of primitives, inscribed
        self.moved.add_object("box", BOX)
        for body in surroundings:
            self._bodies.add_object(body.name, body.mesh)

    def place(self, X_OH: np.ndarray, q: np.ndarray, X_EO: np.ndarray = AWAY) -> None:
        poses = HAND.forward_kinematics(X_OH, q)
        for k, geometry in enumerate(HAND.link_geometries):
            self.moved.set_transform(str(k), poses[geometry.link] @ geometry.X_LG)
        self.moved.set_transform("box", X_EO)

    def meets(self) -> bool:
        return bool(self.moved.in_collision_other(self._bodies))

    def distance(self) -> float:
        return float(self.moved.min_distance_other(self._bodies))


def lift_of(grasp: Grasp, surroundings: Surroundings) -> LiftOptions:
    return choose_lift(OPTIONS, HAND, grasp, BOX, surroundings, support_height=TABLE)


def stages(grasp: Grasp, options: LiftOptions) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield palm, joints and box on the approach, and in the lift with its shakes."""
    X_OH = np.array(grasp.X_OH)
    for back in np.linspace(0.0, STANDOFF, 6):
        X = X_OH.copy()
        X[:3, 3] -= back * grasp.approach_O
        yield X, grasp.pregrasp_positions, AWAY
    yield X_OH, grasp.joint_positions, AWAY
    X_BH, top = HAND.X_LH, np.array([0.0, 0.0, options.lift_height, 0.0, 0.0, 0.0])
    moves = [part * top for part in np.linspace(0.1, 1.0, 10)]
    for direction in options.shake_directions:
        path = shake_about(top, direction, 9.81, frequency=4.0, cycles=2)
        moves += [path(time)[0] for time in np.linspace(0.0, options.shake_time, 9)]
    for move in moves:
        X = displaced(X_OH @ np.linalg.inv(X_BH), move) @ X_BH
        yield X, grasp.joint_positions, X @ np.linalg.inv(X_OH)


@pytest.mark.by_default("wall")
@pytest.mark.parametrize("surroundings", [wall(0.005), board(0.08)], ids=["wall", "board"])
def test_neither_hand_nor_carried_object_meets_a_body(surroundings: Surroundings) -> None:
    search = plan(surroundings)
    assert search.grasps
    oracle = Oracle(surroundings)
    for grasp in search.grasps:
        for placed in stages(grasp, lift_of(grasp, surroundings)):
            oracle.place(*placed)
            assert not oracle.meets()


@pytest.mark.slow
def test_every_grasp_whose_carried_object_would_hit_a_board_is_rejected() -> None:
    above = board(0.08)
    straight = plan(above, lifts=(LiftPath.straight(LIFT),))
    assert not straight.grasps
    assert straight.hit_bodies == {"board": sum(straight.hit_bodies.values())}
    heights = {lift_of(grasp, above).lift_height for grasp in plan(above)}
    assert heights <= {height for height in LIFT_HEIGHTS if height < 0.08}
    assert heights


def test_a_board_5_mm_above_the_object_is_named_as_what_is_in_the_way() -> None:
    search = plan(board(0.005))
    assert not search.grasps
    assert search.hit_bodies.keys() == {"board"}
    assert "board" in no_grasp_sentence(search.rejections, search.hit_bodies)


def test_the_object_in_the_hand_is_rejected_for_a_reason_of_its_own() -> None:
    search = plan(wall(0.005), lifts=(lift_path(OPTIONS),))
    assert search.rejections["carried_hits_obstacle"] > 0
    assert not search.grasps
    assert search.hit_bodies.keys() == {"wall"}
    assert "wall" in no_grasp_sentence(search.rejections, search.hit_bodies)


@pytest.mark.by_default("0.0")
@pytest.mark.parametrize("margin", [0.0, 0.004])
def test_the_hand_keeps_off_bodies_by_its_error_and_the_margin(margin: float) -> None:
    beside = wall(0.02)
    oracle = Oracle(beside)
    search = plan(beside, margin=margin)
    assert search.grasps
    for grasp in search:
        for q in (grasp.joint_positions, grasp.pregrasp_positions):
            oracle.place(grasp.X_OH, q)
            assert oracle.distance() >= margin + PALM_ERROR


@pytest.mark.slow
def test_plans_without_bodies_do_not_depend_on_lifts() -> None:
    alone, usual = plan(ALONE), ForceClosureSampler(HAND, candidates=CANDIDATES)
    assert alone == usual.sample(BOX, support_height=TABLE, count=2)
    assert not alone.hit_bodies


def test_a_mesh_of_obstacles_is_a_body() -> None:
    beside = wall(0.02)
    sampler = ForceClosureSampler(HAND, candidates=200, obstacles=beside.mesh)
    assert [body.name for body in sampler.surroundings] == ["obstacles"]


def test_a_lift_ends_at_the_extremes_of_its_shakes() -> None:
    shaken = lift_path(OPTIONS).displacements[-12:, :3, 3] - [0.0, 0.0, LIFT]
    largest = shake_about(
        np.zeros(6), np.eye(6)[0], max(OPTIONS.shake_accelerations), frequency=4.0, cycles=2
    )
    ways = np.array([largest(time)[0][0] for time in np.linspace(0.0, 0.5, 4001)])
    # Sampled at 400 times: the curvature, 9.81 m/s^2, loses 0.5 a (dt / 2)^2 = 2 um at most.
    assert np.abs(shaken).max() == pytest.approx(np.abs(ways).max(), abs=2e-6)


@pytest.mark.slow
def test_a_search_remembers_the_bodies_in_its_way(tmp_path) -> None:
    search = plan(wall(0.005), lifts=(lift_path(OPTIONS),))
    search.save(tmp_path / "grasps.json")
    assert GraspSearch.load(tmp_path / "grasps.json") == search
