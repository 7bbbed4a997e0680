"""The filter of hand poses rejects only poses that collide by FCL, and most of those."""

from itertools import product

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import Hand, shapes
from lis_grasp.robots.collision import HandCollisionChecker
from lis_grasp.robots.pose_filter import HandPoseFilter


def _poses(count: int, spread: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    X = np.tile(np.eye(4), (count, 1, 1))
    X[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    X[:, :3, 3] = rng.normal(scale=spread, size=(count, 3))
    return X


SHAPE_OF_HAND = {"allegro": "box", "wsg50": "torus", "barrett": "hollow_cylinder"}


@pytest.mark.parametrize(
    ("hand_name", "name"),
    [
        pytest.param(hand, name, marks=[] if name == SHAPE_OF_HAND[hand] else [pytest.mark.slow])
        for hand, name in product(SHAPE_OF_HAND, SHAPE_OF_HAND.values())
    ],
)
def test_rejected_poses_collide_and_most_colliding_poses_are_rejected(
    hand_name: str, name: str
) -> None:
    hand, mesh = Hand.load(hand_name), shapes.build(name).mesh
    poses, checker = HandPoseFilter(hand, mesh), HandCollisionChecker(hand, mesh)
    rng = np.random.default_rng(1)
    X = _poses(150, 0.08, 2)
    q = rng.uniform(hand.lower, hand.upper, size=(len(X), len(hand.lower)))
    rejected = poses.collides(X, q)
    true = np.array(checker.first_collisions(X[:, None], q)) == "object"
    assert not (rejected & ~true).any()
    assert rejected.sum() > 0.5 * true.sum()
    np.testing.assert_array_equal(
        poses.collides(X, q[0]), poses.collides(X, np.tile(q[0], (150, 1)))
    )


def test_the_grid_of_a_tiny_object_is_as_coarse_as_the_hand() -> None:
    hand, bead = Hand.load("allegro"), trimesh.creation.icosphere(radius=0.001)
    poses = HandPoseFilter(hand, bead)
    assert poses._distances.size < 1e6
    center = hand.pad_centers(np.eye(4), q := next(iter(hand.pregrasps.values())))[0]
    X = np.tile(np.eye(4), (2, 1, 1))
    X[0, :3, 3] = -center  # the bead is in the middle of a fingertip
    X[1, :3, 3] = [0.0, 0.0, 1.0]
    assert poses.collides(X, q).tolist() == [True, False]


def test_pads_may_touch_with_that_option() -> None:
    hand = Hand.load("wsg50")
    center = hand.pad_centers(np.eye(4), hand.lower + 0.02).mean(axis=0)
    ball = trimesh.creation.icosphere(radius=0.03).apply_translation(center)
    poses = HandPoseFilter(hand, ball)
    q = hand.lower + 0.005  # the pads reach deep into the ball, the palm is far
    assert poses.collides(np.eye(4)[None], q)[0]
    assert not poses.collides(np.eye(4)[None], q, pads_may_touch=True)[0]


def test_links_wholly_inside_or_in_a_sealed_cavity_are_rejected() -> None:
    hand = Hand.load("allegro")
    q = next(iter(hand.pregrasps.values()))
    solid = trimesh.creation.box((1.0, 1.0, 1.0))
    hollow = trimesh.util.concatenate([solid, _inside_out(trimesh.creation.box((0.9, 0.9, 0.9)))])
    assert HandPoseFilter(hand, solid).collides(np.eye(4)[None], q)[0]
    # A sealed cavity counts as inside: no hand can be there.
    assert HandPoseFilter(hand, hollow).collides(np.eye(4)[None], q)[0]
    away = np.eye(4)
    away[0, 3] = 2.0
    assert not HandPoseFilter(hand, solid).collides(away[None], q)[0]


def _inside_out(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.invert()
    return mesh
