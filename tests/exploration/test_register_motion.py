"""Registration of new contacts to the estimate of an object that moved on its table."""

import numpy as np
import pytest
import trimesh

from lis_grasp import Contacts
from lis_grasp.exploration.planar_motion import find_displacement, planar_pose, register_motion

BOX = trimesh.creation.box((0.08, 0.06, 0.1))


def _contacts_on(pose: np.ndarray, count: int = 40) -> Contacts:
    """Return contacts on the sides of the box at a pose (4, 4)."""
    rng = np.random.default_rng(0)
    points, faces = trimesh.sample.sample_surface(BOX, 400, seed=rng)
    sides = np.flatnonzero(np.abs(BOX.face_normals[faces][:, 2]) < 0.5)[:count]
    contacts = Contacts(points[sides], BOX.face_normals[faces][sides])
    return contacts.in_frame(np.linalg.inv(pose))


def test_contacts_all_around_tell_the_motion() -> None:
    motion = np.array([0.006, -0.004, 0.1])
    found = register_motion(_contacts_on(planar_pose(motion)), BOX)
    np.testing.assert_allclose(found, motion, atol=5e-4, rtol=0.02)


def test_contacts_on_the_estimate_tell_no_motion() -> None:
    np.testing.assert_allclose(register_motion(_contacts_on(np.eye(4)), BOX), 0.0, atol=1e-6)
    np.testing.assert_array_equal(register_motion(Contacts.empty(), BOX), np.zeros(3))


def test_one_contact_tells_the_motion_along_its_normal_only() -> None:
    pushed = Contacts(np.array([[0.045, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    x, y, yaw = register_motion(pushed, BOX)
    # 5 mm off, weighed against a standard deviation of 10 mm by one of 2 mm.
    assert x == pytest.approx(0.005 / (1.0 + (2.0 / 10.0) ** 2), rel=1e-3)
    assert y == pytest.approx(0.0, abs=1e-6)
    assert yaw == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("motion", [(0.2, -0.1, 0.4), (-0.05, 0.3, 2.5), (0.0, 0.02, -1.6)])
def test_an_object_somewhere_else_is_found_by_its_contacts(motion: tuple[float, ...]) -> None:
    pose = planar_pose(np.array(motion))
    contacts = _contacts_on(pose)
    found = find_displacement(contacts, BOX)
    assert found is not None
    # A box looks the same after half a turn: its corners are the same set.
    corners = {
        tuple(np.round(v, 3) + 0.0)
        for v in trimesh.transform_points(BOX.vertices, np.linalg.inv(pose) @ planar_pose(found))
    }
    assert corners == {tuple(np.round(v, 3) + 0.0) for v in BOX.vertices}


def test_contacts_of_another_object_are_not_found_on_the_estimate() -> None:
    larger = Contacts(1.2 * _contacts_on(np.eye(4)).points, _contacts_on(np.eye(4)).normals)
    assert find_displacement(larger, BOX) is None
