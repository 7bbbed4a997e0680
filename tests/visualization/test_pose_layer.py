"""The tracked and the true path of an object that touches move."""

from dataclasses import replace

import numpy as np

from lis_grasp.exploration import Probe, ProbeOutcome
from lis_grasp.exploration.planar_motion import PoseBelief, planar_pose
from lis_grasp.visualization._object_layers import motion_paths

CENTER = np.array([0.1, 0.05, 0.02])


def _outcomes(tracked: list[np.ndarray], true: list[np.ndarray]) -> list[ProbeOutcome]:
    """Return outcomes of an object at poses in W, tracked and true."""
    probe = Probe(np.zeros(3), np.array([0.0, 0.0, -1.0]), standoff=0.05, overshoot=0.01)
    return [
        ProbeOutcome(
            probe,
            "missed",
            simulated_pose=np.linalg.inv(X_WE) @ X_WO,
            tracked=replace(PoseBelief.start(), X_WE=X_WE),
        )
        for X_WE, X_WO in zip(tracked, true, strict=True)
    ]


def test_a_perfect_tracker_draws_the_true_path() -> None:
    poses = [planar_pose(np.array([0.01 * k, 0.0, 0.1 * k])) for k in range(4)]
    tracked, true = motion_paths(_outcomes(poses, poses), CENTER)
    np.testing.assert_allclose(tracked, true, atol=1e-12)
    np.testing.assert_allclose(true[-1], CENTER, atol=1e-12)
    # Distances are those between the true places of the point.
    places = np.array([(pose @ np.append(CENTER, 1.0))[:3] for pose in poses])
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(true, axis=0), axis=1),
        np.linalg.norm(np.diff(places, axis=0), axis=1),
    )


def test_a_tracker_that_notices_nothing_stays_while_the_object_moves() -> None:
    poses = [planar_pose(np.array([0.002 * k, 0.0, 0.0])) for k in range(4)]
    tracked, true = motion_paths(_outcomes([np.eye(4)] * 4, poses), CENTER)
    np.testing.assert_allclose(tracked, np.tile(CENTER, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(true[:, 0] - true[0, 0], [0.0, 0.002, 0.004, 0.006], atol=1e-12)


def test_a_fixed_object_has_no_path() -> None:
    tracked, true = motion_paths((), CENTER)
    assert tracked.shape == true.shape == (0, 3)
