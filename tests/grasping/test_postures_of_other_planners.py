"""`ForceClosureSampler.at`: the grasps that a hand makes in postures of another planner."""

import re
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp import ForceClosureSampler, Hand, shapes
from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.geometry import make_pose

JAW = Hand.load("wsg50")


def _sampler(hand: str, candidates: int = 200) -> ForceClosureSampler:
    return ForceClosureSampler(Hand.load(hand), friction=0.8, candidates=candidates)


def _downwards(center: tuple[float, float, float]) -> np.ndarray[Any, Any]:
    """Return the palm pose at which the jaws close along x about a point, the palm above it."""
    q = next(iter(JAW.pregrasps.values()))
    first, second = JAW.pad_centers(np.eye(4), q)
    closing = (second - first) / np.linalg.norm(second - first)
    of_palm = np.column_stack([closing, JAW.approach_H, np.cross(closing, JAW.approach_H)])
    wanted = np.column_stack([[1, 0, 0], [0, 0, -1], np.cross([1, 0, 0], [0, 0, -1])])
    R = wanted @ of_palm.T
    return make_pose(R, np.array(center) - R @ (0.5 * (first + second)))


@pytest.mark.parametrize(
    "hand", ["wsg50", "allegro", pytest.param("barrett", marks=pytest.mark.slow)]
)
def test_grasps_of_the_sampler_come_back_from_their_own_postures(hand: str) -> None:
    mesh = shapes.build("cylinder").mesh
    options: dict[str, Any] = {"support_height": float(mesh.bounds[0, 2])}
    sampler = _sampler(hand)
    planned = sampler.sample(mesh, count=3, **options)
    poses, joints = (
        [grasp.pose for grasp in planned],
        [grasp.joint_positions for grasp in planned],
    )
    back = sampler.at(mesh, poses, joints, **options)
    assert len(back) == len(planned) == 3
    for grasp in back:
        # The other choices of fingers may be better: never worse than the grasp that was planned.
        apart = [np.linalg.norm(grasp.pose[:3, 3] - other.pose[:3, 3]) for other in planned]
        other = planned[int(np.argmin(apart))]
        assert min(apart) < 0.002
        assert grasp.quality["success_probability"] > other.quality["success_probability"] - 0.02


def test_jaws_close_on_the_opposite_faces_of_a_cube() -> None:
    mesh = trimesh.creation.box(extents=[0.04, 0.05, 0.06])
    (grasp,) = ForceClosureSampler(JAW).at(mesh, _downwards((0.003, 0.0, 0.01)))
    order = np.argsort(grasp.contact_points[:, 0])
    np.testing.assert_allclose(grasp.contact_points[order, 0], [-0.02, 0.02], atol=1e-6)
    np.testing.assert_allclose(grasp.contact_normals[order], [[-1, 0, 0], [1, 0, 0]], atol=1e-9)
    # Off the middle by 3 mm: the palm goes to where both jaws touch, level and no farther.
    moved = grasp.pose[:3, 3] - _downwards((0.0, 0.0, 0.01))[:3, 3]
    assert np.abs(moved).max() < 0.0015


def test_grasps_turn_with_the_object() -> None:
    mesh = trimesh.creation.box(extents=[0.04, 0.05, 0.06])
    X = make_pose(Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix(), [0.3, -0.2, 0.1])
    turned = mesh.copy()
    turned.apply_transform(X)
    sampler, pose = ForceClosureSampler(JAW), _downwards((0.0, 0.0, 0.01))
    (here,), (there,) = sampler.at(mesh, pose), sampler.at(turned, X @ pose)
    np.testing.assert_allclose(X @ here.pose, there.pose, atol=1e-6)
    np.testing.assert_allclose(here.epsilon, there.epsilon, rtol=1e-4)


def test_what_a_posture_lacks_is_counted() -> None:
    mesh = trimesh.creation.box(extents=[0.04, 0.05, 0.4])
    poses = [_downwards((1.0, 0.0, 0.0)), _downwards((0.0, 0.0, -0.1))]
    found = ForceClosureSampler(JAW).at(mesh, poses)
    assert (len(found), found.candidates) == (0, 2)
    assert found.rejections["no_surface_for_a_finger"] == 1
    # Jaws are shorter than the 0.3 m from the point to the top: the palm is inside.
    assert found.rejections["grasp_hits_object"] >= 1
    wide = trimesh.creation.box(extents=[0.3, 0.3, 0.06])
    inside = ForceClosureSampler(JAW).at(wide, _downwards((0.0, 0.0, 0.01)))
    assert inside.rejections == {"no_surface_for_a_finger": 1}


@pytest.mark.parametrize(
    ("poses", "joints", "said"),
    [
        (np.eye(3), None, "finite poses (N, 4, 4)"),
        (np.full((4, 4), np.nan), None, "finite poses (N, 4, 4)"),
        (np.zeros((2, 4, 4)), np.zeros((2, 7)), "joint positions of 'wsg50' for each of 2 poses"),
    ],
)
def test_wrong_postures_are_refused(poses: Any, joints: Any, said: str) -> None:
    mesh = trimesh.creation.box(extents=[0.04, 0.05, 0.06])
    with pytest.raises(InvalidOptionError, match=re.escape(said)):
        ForceClosureSampler(JAW).at(mesh, poses, joints)


def test_open_meshes_are_refused() -> None:
    mesh = trimesh.creation.box(extents=[0.04, 0.05, 0.06])
    with pytest.raises(InvalidMeshError):
        ForceClosureSampler(JAW).at(mesh.submesh([[0, 1, 2]], append=True), np.eye(4))
