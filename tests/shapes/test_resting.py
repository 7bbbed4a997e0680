"""Resting poses: their directions and probabilities."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.shapes import resting_poses, roll_to_rest
from lis_grasp.shapes.resting import rest_from


def test_a_box_rests_on_its_six_faces_with_the_probabilities_of_their_solid_angles() -> None:
    half = np.array([0.02, 0.03, 0.05])
    poses = resting_poses(trimesh.creation.box(2.0 * half))
    assert len(poses) == 6
    for pose in poses:
        axis = int(np.argmax(np.abs(pose.rotation[2])))
        b, c = np.delete(half, axis)
        # Of a rectangle seen from above its middle.
        angle = 4.0 * np.arctan2(b * c, half[axis] * np.linalg.norm(half))
        assert pose.probability == pytest.approx(angle / (4.0 * np.pi), rel=1e-9)
        assert abs(pose.rotation[2, axis]) == pytest.approx(1.0)
    assert sum(pose.probability for pose in poses) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["mallet", "pentagon", "half_cylinder"])
def test_resting_poses_are_as_frequent_as_they_are_probable(name: str) -> None:
    mesh, rng = shapes.build(name).mesh, np.random.default_rng(0)
    poses = resting_poses(mesh)
    ups = np.array([pose.rotation[2] for pose in poses])
    count = 300
    ends = [int(np.argmax(ups @ roll_to_rest(mesh, rng=rng)[2])) for _ in range(count)]
    for number, pose in enumerate(poses):
        # Four standard deviations of a share of that many draws.
        spread = 4.0 * np.sqrt(pose.probability * (1.0 - pose.probability) / count)
        assert abs(ends.count(number) / count - pose.probability) < spread + 1e-9


def test_a_body_stays_on_a_face_and_rolls_off_an_edge() -> None:
    mesh = trimesh.creation.box((0.02, 0.04, 0.1))
    assert rest_from(mesh, np.array([0.0, 0.0, -1.0])).tolist() == [0.0, 0.0, -1.0]
    # The direction leaves the face z at 0.01 from its middle, that is at 0.2 of its height.
    leaning = np.array([-0.21, 0.0, -1.0]) / np.hypot(0.21, 1.0)
    assert np.round(rest_from(mesh, leaning), 9).tolist() == [-1.0, 0.0, 0.0]


def test_near_poses_are_one_if_merged() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    every, merged = resting_poses(ball), resting_poses(ball, merged=1.0)
    assert len(merged) < 20 < len(every)
    ups = np.array([pose.rotation[2] for pose in merged])
    assert (ups @ ups.T - 2.0 * np.eye(len(ups))).max() <= np.cos(1.0)
    assert sum(pose.probability for pose in merged) == pytest.approx(1.0)
