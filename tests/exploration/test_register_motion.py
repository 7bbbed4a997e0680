"""Registration of new contacts to the estimate of an object that moved on its table."""

import numpy as np
import pytest
import trimesh

from lis_grasp import Contacts
from lis_grasp.exploration.planar_motion import planar_pose, register_motions

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
    (found,) = register_motions([_contacts_on(planar_pose(motion))], BOX)
    np.testing.assert_allclose(found, motion, atol=5e-4, rtol=0.02)


def test_contacts_on_the_estimate_tell_no_motion() -> None:
    np.testing.assert_allclose(register_motions([_contacts_on(np.eye(4))], BOX), 0.0, atol=1e-6)
    np.testing.assert_array_equal(register_motions([Contacts.empty()], BOX), np.zeros((1, 3)))


def test_one_contact_tells_the_motion_along_its_normal_only() -> None:
    pushed = Contacts(np.array([[0.045, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    ((x, y, yaw),) = register_motions([pushed], BOX)
    # 5 mm off, weighed against a standard deviation of 10 mm by one of 2 mm.
    assert x == pytest.approx(0.005 / (1.0 + (2.0 / 10.0) ** 2), rel=1e-3)
    assert y == pytest.approx(0.0, abs=1e-6)
    assert yaw == pytest.approx(0.0, abs=1e-6)


def test_later_contacts_correct_earlier_displacements() -> None:
    # The object is 12 mm off its estimate along x and y, and still. The first contact shows x only,
    # the second y only. Both are at the middle of a face as displaced then, and show no turn.
    faces = ([0.04 + 0.012, 0.006, 0.0], [0.0115, 0.03 + 0.012, 0.0])
    normals = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    sets = [Contacts(np.array([p]), np.array([n])) for p, n in zip(faces, normals, strict=True)]
    first, second = register_motions(sets, BOX)
    s, e = 0.01**2, 0.002**2  # variances of each motion, and of a contact
    assert first[:2] == pytest.approx(0.012 * np.array([s / (s + e), s / (2 * s + e)]), rel=1e-3)
    assert second[:2] == pytest.approx(0.012 * np.array([s, 2 * s]) / [s + e, 2 * s + e], rel=1e-3)
    assert abs(register_motions(sets[:1], BOX)[0, 1]) < 1e-6


def test_contacts_keep_their_distances_in_another_frame() -> None:
    contacts = _contacts_on(np.eye(4))
    moved = contacts.in_frame(planar_pose(np.array([0.1, 0.2, 0.5])))
    np.testing.assert_allclose(
        np.linalg.norm(moved.points - moved.points[0], axis=1),
        np.linalg.norm(contacts.points - contacts.points[0], axis=1),
        atol=1e-12,
    )
    back = moved.in_frame(np.linalg.inv(planar_pose(np.array([0.1, 0.2, 0.5]))))
    np.testing.assert_allclose(back.points, contacts.points, atol=1e-12)
    np.testing.assert_allclose(back.normals, contacts.normals, atol=1e-12)
