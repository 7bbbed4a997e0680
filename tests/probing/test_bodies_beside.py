"""A hand's way between known bodies beside the object, and the frame in which they stay."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import worlds
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import ObstacleModel, Probe, Workspace
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.probing.approach_planner import Approach, ApproachPlanner
from lis_grasp.probing.bodies_beside import BodiesBeside
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.hand import Hand
from lis_grasp.world import Body, Surroundings

SPACE = ObstacleModel(
    Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0), Contacts.empty(), None
)
LEVEL = Probe(np.array([-0.04, 0.0, 0.06]), np.array([1.0, 0.0, 0.0]), 0.03, 0.02)


@pytest.fixture(scope="module")
def hand() -> Hand:
    return Hand.load("wsg50")


def _approach(hand: Hand, beside: BodiesBeside) -> Approach:
    approach = ApproachPlanner(hand, beside=beside).plan(LEVEL, SPACE)
    assert approach is not None
    return approach


@pytest.mark.parametrize("world", [worlds.shelf, worlds.bin_, worlds.corner])
def test_a_free_hand_comes_from_above_all_bodies_without_a_collision(
    hand: Hand, world: object
) -> None:
    bodies = world()  # type: ignore[operator]
    approach = _approach(hand, BodiesBeside(hand, bodies))
    np.testing.assert_array_equal(approach.way[-1], approach.X_OH_outside)
    checker = HandCollisionChecker(hand, obstacles=bodies.mesh)
    q = approach.posture.joint_positions
    # A finer path than the planner's, which the thickness of links permits.
    for begin, end in pairwise(approach.way):
        path = np.repeat(begin[None], 41, axis=0)
        path[:, :3, 3] += np.linspace(0.0, 1.0, 41)[:, None] * (end - begin)[:3, 3]
        assert not checker.hit_obstacle(path[None], q[None]).any()
    lowest = checker.lowest(approach.way[0] @ checker.poses_in_hand(q))
    assert lowest > bodies.mesh.bounds[1, 2]


@pytest.mark.slow
def test_there_is_no_way_into_a_closed_box(hand: Hand) -> None:
    found = ApproachPlanner(hand, beside=BodiesBeside(hand, worlds.closed_box())).find(LEVEL, SPACE)
    assert isinstance(found, str)
    assert any(body.name in found.split() for body in worlds.closed_box())


def test_known_bodies_stay_when_the_frame_of_the_probes_moves(hand: Hand) -> None:
    beside = BodiesBeside(hand, worlds.corner())
    posture = next(iter(hand.probe_postures.values()))
    X_WE = np.eye(4)
    X_WE[:2, 3] = 0.05, -0.02
    poses = np.repeat(np.eye(4)[None], 60, axis=0)
    poses[:, 0, 3] = np.linspace(-0.2, 0.2, 60)
    poses[:, 2, 3] = 0.1
    before = [beside.hits(posture, pose[None]) for pose in poses]
    assert 0 < sum(before) < len(before)
    beside.place_frame(X_WE)
    assert [beside.hits(posture, (inverse_pose(X_WE) @ X)[None]) for X in poses] == before
    assert [beside.hits(posture, pose[None]) for pose in poses] != before


def test_a_motion_ends_before_a_known_body(hand: Hand) -> None:
    beside = BodiesBeside(hand, worlds.corner())
    approach = _approach(hand, beside)
    length = beside.free_length(approach.posture, approach.X_OH, LEVEL.direction, 0.3)
    assert 0.0 < length < 0.3
    end = approach.X_OH.copy()
    end[:3, 3] += length * LEVEL.direction
    assert not beside.hits(approach.posture, end[None])


def test_a_corner_that_passes_a_body_between_two_poses_hits_it(hand: Hand) -> None:
    # The hand's edge, turned by 45 degrees, overlaps a post of 2 mm for 2 + 2 * 2 mm of its way.
    posture = next(iter(hand.probe_postures.values()))
    q = posture.joint_positions
    X_WH = np.eye(4)
    X_WH[:3, :3] = Rotation.from_euler("xz", [180.0, 45.0], degrees=True).as_matrix()
    links = hand.forward_kinematics(X_WH, q)
    points = np.vstack(
        [apply_pose(links[g.link] @ g.X_LG, g.mesh.vertices) for g in hand.link_geometries]
    )
    edge = points[np.argmax(points[:, 1])]
    path = np.repeat(X_WH[None], 4, axis=0)
    path[:, 0, 3] = [-0.015, -0.005, 0.005, 0.015]
    for depth, is_hit in ((0.002, True), (-0.001, False)):
        middle = (float(edge[0]), float(edge[1]) - depth + 0.01, float(edge[2]))
        bodies = Surroundings((Body.box("post", (0.002, 0.02, 0.002), middle),))
        checker = HandCollisionChecker(hand, obstacles=bodies.mesh)
        assert not checker.hit_obstacle(path[None], q[None]).any()  # at none of the four poses
        assert checker.hit_obstacle(X_WH[None, None], q[None]).any() == is_hit
        assert BodiesBeside(hand, bodies).hits(posture, path) is is_hit
