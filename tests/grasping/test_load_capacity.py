"""Accelerations that a hand can give an object while it carries it."""

from itertools import product
from typing import cast

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lis_grasp import Hand
from lis_grasp.grasping.contact_wrenches import WrenchModel
from lis_grasp.grasping.hand_capacity import (
    EFFORT_FRACTION,
    largest_forces,
    largest_wrenches,
    spare_accelerations,
)
from lis_grasp.shapes.object_mass import GRAVITY
from lis_grasp.typing import FloatArray

HAND = Hand.load("allegro")


def _random_wrenches(rng: np.random.Generator, grasps: int) -> FloatArray:
    """Return the largest wrenches (B, 3, 4, 6) of three fingers around an object of 1 N weight."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0 + rng.normal(0.0, 0.2, (grasps, 3))
    normals = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
    points = 0.04 * normals + rng.normal(0.0, 0.01, (grasps, 3, 3))
    model = WrenchModel(0.8, origin=np.zeros(3), torque_metric=30.0 * np.eye(3), edges=4)
    return 3.0 * rng.uniform(0.5, 1.5, (grasps, 3, 1, 1)) * model.wrenches(points, normals)


def _spare(wrenches: FloatArray, mass: float) -> FloatArray:
    return spare_accelerations(wrenches, [mass], scale=3.0, tolerance=1e-6)[0]


def test_the_acceleration_is_the_distance_of_the_weight_from_a_hull_of_sums() -> None:
    mass = 0.1
    wrenches = _random_wrenches(np.random.default_rng(0), 6)
    for found, contacts in zip(_spare(wrenches, mass), wrenches, strict=True):
        # Every sum of one largest wrench, or none, of each contact.
        choices = [np.vstack([np.zeros(6), contact]) for contact in contacts]
        hull = ConvexHull(np.array([np.sum(sums, axis=0) for sums in product(*choices)]))
        weight = np.array([0.0, 0.0, mass * GRAVITY, 0.0, 0.0, 0.0])
        depth = -(hull.equations[:, :6] @ weight + hull.equations[:, 6]).max()
        assert found == pytest.approx(max(depth, 0.0) / mass, rel=1e-4, abs=1e-3)


def test_twice_the_forces_accelerate_twice_the_mass() -> None:
    wrenches = _random_wrenches(np.random.default_rng(1), 8)
    first = _spare(wrenches, 0.1)
    assert (first > 0.0).any()
    np.testing.assert_allclose(_spare(2.0 * wrenches, 0.2), first, rtol=1e-4, atol=1e-3)


def test_masses_are_independent_of_each_other() -> None:
    wrenches = _random_wrenches(np.random.default_rng(4), 5)
    together = spare_accelerations(wrenches, [0.05, 0.1, 0.3], scale=3.0, tolerance=1e-6)
    for mass, found in zip((0.05, 0.1, 0.3), together, strict=True):
        np.testing.assert_allclose(found, _spare(wrenches, mass), rtol=1e-4, atol=1e-3)


def test_a_weight_that_friction_cannot_carry_leaves_no_acceleration() -> None:
    wrenches = _random_wrenches(np.random.default_rng(2), 8)
    # Three fingers push with at most 4.5 N each, friction 0.8.
    too_heavy = 3 * 4.5 * 0.8 / GRAVITY
    np.testing.assert_array_equal(_spare(wrenches, 1.01 * too_heavy), 0.0)


def test_a_force_is_as_large_as_a_motor_or_the_finger_allows() -> None:
    q = HAND.lower + 0.4 * (HAND.upper - HAND.lower)
    X_OH = np.eye(4)
    used = np.ones((1, len(HAND.fingers)), dtype=bool)
    rng = np.random.default_rng(3)
    forces = rng.normal(size=(1, len(HAND.fingers), 20, 3))
    factors = largest_forces(HAND, X_OH[None], q[None], used, forces)
    jacobian = HAND.pad_jacobians(X_OH, q)[2][..., 6:]
    efforts = np.abs(np.einsum("fkx,fxj->fkj", factors[0, ..., None] * forces[0], jacobian))
    loads = (efforts / (EFFORT_FRACTION * HAND.effort_limits)).max(axis=-1)
    bounded = factors[0] >= HAND.max_contact_force - 1e-9
    assert 0 < bounded.sum() < bounded.size
    np.testing.assert_allclose(loads[~bounded], 1.0)
    assert loads[bounded].max() <= 1.0 + 1e-9


class _TwoFingersOnOneMotor:
    """A jaw whose fingers at x = 0.02 and -0.02 close by one joint, of 10 N."""

    effort_limits = np.array([10.0])
    max_contact_force = 40.0

    def pad_jacobians(self, X_OH: FloatArray, q: FloatArray) -> tuple[FloatArray, ...]:
        jacobian = np.zeros((len(q), 2, 3, 7))
        jacobian[:, :, 0, 6] = (-1.0, 1.0)
        return np.zeros(0), np.zeros(0), jacobian, np.zeros(0)


def test_fingers_on_one_motor_share_its_effort() -> None:
    jaw = cast(Hand, _TwoFingersOnOneMotor())
    inward = np.array([[[[-1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]]])
    factors = largest_forces(
        jaw, np.eye(4)[None], np.zeros((1, 1)), np.ones((1, 2), dtype=bool), inward
    )
    np.testing.assert_allclose(factors, EFFORT_FRACTION * 10.0 / 2)


def test_a_finger_without_contact_exerts_nothing_and_leaves_the_motor_to_the_others() -> None:
    jaw = cast(Hand, _TwoFingersOnOneMotor())
    inward = np.array([[[[-1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]]])
    used = np.array([[True, False]])
    factors = largest_forces(jaw, np.eye(4)[None], np.zeros((1, 1)), used, inward)
    np.testing.assert_allclose(factors[0, :, 0], [EFFORT_FRACTION * 10.0, 0.0])


def test_wrenches_are_as_large_as_the_forces() -> None:
    q = 0.5 * (HAND.lower + HAND.upper)
    centers, axes = HAND.pad_centers(np.eye(4), q)[None], HAND.pad_axes(np.eye(4), q)[None]
    used = np.ones((1, len(HAND.fingers)), dtype=bool)
    model = WrenchModel(0.5, origin=np.zeros(3), torque_metric=np.eye(3))
    at = np.eye(4)[None], q[None], used
    wrenches = largest_wrenches(HAND, model, *at, centers, -axes)
    forces, torques = wrenches[..., :3], wrenches[..., 3:]
    np.testing.assert_allclose(torques, np.cross(centers[:, :, None], forces))
    # The last one of each contact is the normal force.
    pushes = axes * largest_forces(HAND, *at, axes[:, :, None])
    np.testing.assert_allclose(forces[:, :, -1], pushes)
