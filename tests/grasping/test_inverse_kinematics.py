"""Inverse kinematics of a hand for contacts of its pads."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lis_grasp import Hand
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.inverse_kinematics import solve_ik

HAND = Hand.load("allegro")


def _reachable(rng: np.random.Generator, count: int) -> GraspBatch:
    """Return contacts that a known posture near a pregrasp touches, and an initial guess."""
    start = np.tile(HAND.pregrasps["medium"], (count, 1))
    X_start = np.tile(np.eye(4), (count, 1, 1))
    q = np.clip(start + rng.uniform(-0.15, 0.15, start.shape), HAND.lower, HAND.upper)
    X = X_start.copy()
    X[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, (count, 3))).as_matrix()
    X[:, :3, 3] = rng.uniform(-0.02, 0.02, (count, 3))
    normals = -HAND.pad_axes(X, q)
    radii = np.array([pad.radius for pad in HAND.pads])
    points = HAND.pad_centers(X, q) - radii[:, None] * normals
    used = np.ones(points.shape[:2], dtype=bool)
    return GraspBatch(points, normals, used, X_start, start)


def test_contacts_of_a_known_posture_are_reached() -> None:
    targets = _reachable(np.random.default_rng(0), 40)
    solved = solve_ik(HAND, targets)
    # The preference for the start leaves less than a fifth of the unit of position, 1 mm.
    assert np.quantile(solved.position_error, 0.9) < 2e-4
    assert np.quantile(solved.axis_error, 0.9) < 1e-3


def test_joints_stay_within_their_limits() -> None:
    targets = _reachable(np.random.default_rng(1), 20)
    far = replace(targets, points=targets.points + 0.2)
    solved = solve_ik(HAND, far, palm_fixed=True)
    assert np.all(solved.q >= HAND.lower - 1e-12)
    assert np.all(solved.q <= HAND.upper + 1e-12)
    assert np.all(solved.position_error > 0.01), "0.2 m away is out of the fingers' reach"


def test_a_fixed_palm_does_not_move() -> None:
    targets = _reachable(np.random.default_rng(2), 5)
    assert np.array_equal(solve_ik(HAND, targets, palm_fixed=True).X_OH, targets.X_OH)


def test_reported_errors_are_those_of_the_returned_posture() -> None:
    targets = _reachable(np.random.default_rng(3), 10)
    solved = solve_ik(HAND, targets)
    radii = np.array([pad.radius for pad in HAND.pads])
    off = HAND.pad_centers(solved.X_OH, solved.q) - (
        targets.points + radii[:, None] * targets.normals
    )
    np.testing.assert_allclose(
        solved.position_error, np.linalg.norm(off, axis=-1).max(axis=1), atol=1e-12
    )


def test_each_candidate_is_solved_on_its_own() -> None:
    targets = _reachable(np.random.default_rng(4), 6)
    together = solve_ik(HAND, targets)
    alone = solve_ik(HAND, targets.subset(np.array([2])))
    # The batch runs until all have converged: the one alone may stop a few steps earlier.
    assert alone.position_error[0] == pytest.approx(together.position_error[2], abs=1e-5)


def test_turning_the_world_turns_the_solution() -> None:
    targets = _reachable(np.random.default_rng(5), 4)
    R = Rotation.from_rotvec([0.4, -0.7, 1.2]).as_matrix()
    X_turned = make_pose(R) @ targets.X_OH
    points, normals = targets.points @ R.T, targets.normals @ R.T
    turned = replace(targets, points=points, normals=normals, X_OH=X_turned)
    here, there = solve_ik(HAND, targets), solve_ik(HAND, turned)
    np.testing.assert_allclose(there.q, here.q, atol=1e-5)


def test_contacts_are_turned_into_the_pads() -> None:
    # Contacts whose normals are tilted by 1.6 rad, out of pads with a half angle of 1.2 rad.
    targets = _reachable(np.random.default_rng(6), 20)
    tilt = Rotation.from_rotvec([0.0, 1.6, 0.0]).as_matrix()
    tilted = replace(targets, normals=targets.normals @ tilt.T)
    axes = HAND.pad_axes(targets.X_OH, targets.q)
    half_angles = np.array([pad.half_angle for pad in HAND.pads])

    def outside(axes: np.ndarray) -> np.ndarray:
        cosine = -(axes * tilted.normals).sum(axis=-1)
        return np.maximum(np.arccos(np.clip(cosine, -1.0, 1.0)) - half_angles, 0.0).max(axis=1)

    free = solve_ik(HAND, tilted)
    fixed = solve_ik(HAND, tilted, palm_fixed=True)
    for solved in (free, fixed):
        after = outside(HAND.pad_axes(solved.X_OH, solved.q))
        np.testing.assert_allclose(solved.axis_error, after, atol=1e-12)
    assert free.axis_error.mean() < 0.5 * outside(axes).mean()
    assert fixed.axis_error.max() > 0.0


def test_fingers_without_contact_stay_at_their_start() -> None:
    targets = _reachable(np.random.default_rng(7), 10)
    used = targets.used.copy()
    used[:, 2] = False
    solved = solve_ik(HAND, replace(targets, used=used))
    idle, busy = list(HAND.finger_joints("ring")), list(HAND.finger_joints("index"))
    moved = np.abs(solved.q - targets.q)
    assert moved[:, busy].max() > 0.05
    assert moved[:, idle].max() < 1e-4
