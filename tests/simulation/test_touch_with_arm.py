"""Touches with an arm in Drake: gentle, exact, within reach, and in a frame that moves."""

import numpy as np
import pytest
import trimesh

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.use import ArmUse
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.probe_motions import ARM_PROBE_SPEED
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.dynamic_prober import DynamicProber
from lis_grasp.simulation.drake.object_plant import FreeObject
from lis_grasp.world import Body, Surroundings

BOX = trimesh.creation.box(extents=[0.06, 0.06, 0.12])
HEIGHT = -0.06
SPACE = ObstacleModel(Workspace(0.03, np.zeros(3), 0.12, HEIGHT), Contacts.empty(), None)
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def station() -> Station:
    return choose_base(Arm.load("iiwa14"), Hand.load("allegro"), table=Table(HEIGHT))


def test_an_arm_touches_gently_and_where_the_surface_is(station: Station) -> None:
    use = ArmUse()
    prober = DynamicProber(station.hand, BOX, station=station, arm_use=use)
    for target, direction in (
        ([0.0, 0.0, 0.06], [0.0, 0.0, -1.0]),
        ([-0.03, 0.0, 0.02], [1.0, 0.0, 0.0]),
        ([0.03, 0.0, 0.02], [-1.0, 0.0, 0.0]),
    ):
        outcome = prober.probe(Probe(np.array(target), np.array(direction), 0.03, 0.02), SPACE)
        assert outcome.status == "touched", outcome.reason
        # The skin yields by 0.3 mm, and the fingers' springs more along their own joints.
        offset = outcome.contacts.points[0] - target
        assert abs(offset @ direction) < 1e-3
        np.testing.assert_allclose(outcome.contacts.normals[0], -np.array(direction), atol=0.05)
        assert outcome.duration > 0.02 / ARM_PROBE_SPEED
    assert 0.2 <= use.contact_force < 1.0  # the threshold is 0.2 N
    assert use.effort < 1.0
    assert use.speed < 1.0
    assert use.contacts == {}


def test_what_the_arm_does_not_reach_is_blocked(station: Station) -> None:
    far = station.moved(station.X_WA - 2.0 * np.outer(np.eye(4)[0], np.eye(4)[3]))
    prober = DynamicProber(station.hand, BOX, station=far)
    probe = Probe(np.array([0.0, 0.0, 0.06]), np.array([0.0, 0.0, -1.0]), 0.03, 0.02)
    outcome = prober.probe(probe, SPACE)
    assert outcome.status == "blocked"
    assert "arm" in outcome.reason


def test_probes_in_a_moved_frame_touch_the_same_place(station: Station) -> None:
    X_EF = trimesh.transformations.rotation_matrix(0.3, [0.0, 0.0, 1.0])
    X_EF[:2, 3] = 0.01, -0.02
    X_FE = np.linalg.inv(X_EF)
    prober = DynamicProber(station.hand, BOX, free=FreeObject(HEIGHT), station=station)
    target, direction = np.array([0.0, 0.0, 0.06]), np.array([0.0, 0.0, -1.0])
    first = prober.probe(Probe(target, direction, 0.03, 0.02), SPACE)
    prober.move_frame(X_EF)
    moved = X_FE[:3, :3] @ target + X_FE[:3, 3]
    second = prober.probe(Probe(moved, direction, 0.03, 0.02), SPACE)
    point = X_EF[:3, :3] @ second.contacts.points[0] + X_EF[:3, 3]
    # The top is flat: the same height; the same place within what the hand's roll changes.
    assert point[2] == pytest.approx(first.contacts.points[0, 2], abs=3e-4)
    np.testing.assert_allclose(point[:2], first.contacts.points[0, :2], atol=2e-3)
    np.testing.assert_allclose(X_EF @ prober.X_EO, np.eye(4), atol=2e-3)


def test_a_contact_with_another_body_is_recorded_by_its_name(station: Station) -> None:
    block = Body.box("block", (0.06, 0.06, 0.1), (0.14, 0.0, HEIGHT + 0.05))
    use = ArmUse()
    prober = DynamicProber(
        station.hand, BOX, station=station, arm_use=use, surroundings=Surroundings((block,))
    )
    top = np.array([0.14, 0.0, HEIGHT + 0.1])
    outcome = prober.probe(Probe(top, np.array([0.0, 0.0, -1.0]), 0.03, 0.02), SPACE)
    assert outcome.contacts.points[0, 2] == pytest.approx(top[2], abs=1e-3)
    assert use.contacts
    assert {pair.split(" with ")[1] for pair in use.contacts} == {"block"}
    assert max(use.forces.values()) < 1.02 * prober.disturbance.forces["block"] < 2.0
