"""Joint paths of an arm to a probe and back: continuous, straight, and at the speeds asked for."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from stations import station_with

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.probe_motions import (
    ARM_APPROACH_SPEED,
    ARM_PROBE_SPEED,
    GENTLE_SPEED,
    PROBE_SPEED,
)
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.probing.course import Course, path_back, path_out
from lis_grasp.probing.guarded_motion import GuardedMotion

STEP, BEFORE = 0.01, 0.002
STATION = station_with("wsg50")
BOX = trimesh.creation.box(extents=[0.06, 0.06, 0.12]).apply_translation([0.0, 0.0, 0.06])
SPACE = ObstacleModel(
    Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0), Contacts.empty(), None
)


@pytest.fixture(scope="module", params=[0.02, 0.0001], ids=["touches", "misses"])
def course(request: pytest.FixtureRequest) -> Course:
    probe = Probe(np.array([0.0, 0.0, 0.12]), np.array([0.0, 0.0, -1.0]), 0.03, 0.02)
    if request.param < 0.001:
        probe = Probe(np.array([0.0, 0.0, 0.13]), np.array([0.0, 0.0, -1.0]), 0.03, 0.005)
    found = GuardedMotion(STATION.hand, BOX, STATION).run(probe, SPACE)
    assert isinstance(found, Course)
    return found


def test_the_path_goes_from_home_to_the_contact_without_a_jump(course: Course) -> None:
    path = path_out(STATION.arm, course, BEFORE, STEP)
    np.testing.assert_array_equal(path.positions[0], course.way.motion.positions[0])
    palm = STATION.palm_poses(path.positions[-1])
    early = BEFORE if course.touched is not None else 0.0
    expected = course.X_OH_end[:3, 3] - early * course.last.direction
    np.testing.assert_allclose(palm[:3, 3], expected, atol=1e-4)
    np.testing.assert_allclose(np.diff(path.times), STEP, atol=1e-9)
    # Positions and speeds belong together, but for half a step where the acceleration changes sign.
    middle = (path.positions[2:] - path.positions[:-2]) / (2.0 * STEP)
    largest = 0.5 * STEP * np.abs(path.accelerations).max()
    assert np.abs(middle - path.velocities[1:-1]).max() < largest
    assert (np.abs(path.velocities) <= STATION.arm.velocity_limits).all()


def test_the_palm_comes_to_a_contact_at_the_probes_speed(course: Course) -> None:
    path = path_out(STATION.arm, course, BEFORE, STEP)
    _, J = STATION.jacobians(path.positions)
    speeds = np.linalg.norm((J[:, :3] @ path.velocities[..., None])[..., 0], axis=1)
    expected = 0.0 if course.touched is None else ARM_PROBE_SPEED  # down, to a table
    assert speeds[-1] == pytest.approx(expected, rel=0.03, abs=1e-9)


@pytest.mark.parametrize("free", [0.0, 0.015, 0.2])
def test_the_palm_is_fast_where_it_is_free_and_slows_down_before_the_rest(
    course: Course, free: float
) -> None:
    leg = replace(course.last, free=free)
    course = replace(course, legs=(leg,), touched=None)
    path = path_out(STATION.arm, course, 0.0, 0.001)
    X_WH, J = STATION.jacobians(path.positions)
    speeds = np.linalg.norm((J[:, :3] @ path.velocities[..., None])[..., 0], axis=1)
    count = len(course.way.motion.times)
    travelled = (X_WH[count:, :3, 3] - leg.X_OH[:3, 3]) @ leg.direction
    guarded = speeds[count:][travelled > free + 1e-3]
    assert guarded.max(initial=0.0) <= leg.speed * 1.02
    if free >= leg.length:
        assert leg.speed < speeds[count:].max() < ARM_APPROACH_SPEED * 1.02
    seconds = course.seconds
    legs = path.duration - course.way.motion.duration
    assert legs == pytest.approx(seconds["free"] + seconds["guarded"], rel=0.02)
    back = path_back(STATION.arm, course, 0.0, 0.001)
    assert back.duration == pytest.approx(seconds["retreat"], rel=0.02)


@pytest.mark.parametrize(
    ("station", "slow", "fast"),
    [(None, GENTLE_SPEED, PROBE_SPEED), (STATION, ARM_PROBE_SPEED, ARM_APPROACH_SPEED)],
)
def test_a_search_is_as_fast_as_its_way_down_is_slow(
    station: Station | None, slow: float, fast: float
) -> None:
    motion = GuardedMotion(STATION.hand, BOX, station, probe_speed=slow)
    course = motion.run(Probe([-0.03, 0.0, 0.02], [1.0, 0.0, 0.0], 0.05, 0.02), SPACE)
    assert isinstance(course, Course)
    for leg in course.legs:
        down = abs(leg.direction[2])
        assert leg.speed == pytest.approx(fast if down == 0.0 else min(fast, slow / down))


def test_a_hand_is_gentle_from_the_first_contact_on() -> None:
    motion = GuardedMotion(STATION.hand, BOX, probe_speed=GENTLE_SPEED)
    known = replace(SPACE, contacts=Contacts([[0.0, 0.0, 0.05]], [[0.0, 0.0, 1.0]]))
    course = motion.run(Probe([-0.03, 0.0, 0.02], [1.0, 0.0, 0.0], 0.05, 0.02), known)
    assert isinstance(course, Course)
    assert {leg.speed for leg in course.legs} == {GENTLE_SPEED}


def test_a_stretched_arm_is_slower(course: Course) -> None:
    arm = replace(STATION.arm, velocity_limits=0.05 * STATION.arm.velocity_limits)
    for path in (path_out, path_back):
        fast, slow = path(STATION.arm, course, BEFORE, STEP), path(arm, course, BEFORE, STEP)
        count = len(course.way.motion.times)  # the transit is planned before
        legs = slow.velocities[count:] if path is path_out else slow.velocities
        # The fastest moment is between two points of the faster motion.
        assert np.abs(legs / arm.velocity_limits).max() <= arm.speed_fraction * 1.05
        assert slow.duration > fast.duration
        np.testing.assert_allclose(slow.positions[-1], fast.positions[-1], atol=1e-12)


def test_the_way_back_ends_where_the_transit_did(course: Course) -> None:
    out = path_out(STATION.arm, course, BEFORE, STEP)
    back = path_back(STATION.arm, course, BEFORE, STEP)
    np.testing.assert_allclose(back.positions[0], out.positions[-1], atol=1e-9)
    np.testing.assert_allclose(back.positions[-1], course.way.motion.positions[-1], atol=1e-9)
    assert np.abs(back.velocities[[0, -1]]).max() < 1e-9


def test_the_next_transit_begins_where_the_last_probe_did() -> None:
    motion = GuardedMotion(STATION.hand, BOX, STATION)
    probes = [
        Probe(np.array([x, 0.0, 0.12]), np.array([0.0, 0.0, -1.0]), 0.03, 0.02)
        for x in (-0.02, 0.02)
    ]
    first, second = (motion.run(probe, SPACE) for probe in probes)
    assert isinstance(first, Course)
    assert isinstance(second, Course)
    start = second.way.motion.positions[0]
    np.testing.assert_array_equal(start, first.legs[0].q_arm[0])
    alone = GuardedMotion(STATION.hand, BOX, STATION).run(probes[1], SPACE)
    assert isinstance(alone, Course)
    assert second.duration < alone.duration


@pytest.mark.slow
def test_a_hand_that_changes_its_posture_on_the_way_keeps_off_the_table() -> None:
    # In its next posture from the beginning, a low finger pressed on the table with 27 N.
    station = station_with("allegro")
    motion, hand, before = GuardedMotion(station.hand, BOX, station), station.hand, None
    around, changes = np.deg2rad([0.0, 60.0, 120.0, 180.0]), 0
    sides = np.column_stack([np.cos(around), np.sin(around), np.zeros(4)])
    probes = [Probe(0.03 * side + [0.0, 0.0, 0.02], -side, 0.05, 0.02) for side in sides]
    down = Probe(np.array([0.0, 0.0, 0.12]), np.array([0.0, 0.0, -1.0]), 0.03, 0.02)
    for probe in (probes[0], down, *probes[1:], down):
        course = motion.run(probe, SPACE)
        if isinstance(course, str):
            continue
        way, after = course.way, course.joint_positions
        np.testing.assert_allclose(way.q_hand[-1], after, atol=1e-12)
        if before is not None:
            np.testing.assert_array_equal(way.q_hand[0], before)
            changes += not np.array_equal(before, after)
            heights = [
                trimesh.transform_points(g.mesh.vertices, links[g.link] @ g.X_LG)[:, 2].min()
                for palm, q in zip(
                    station.palm_poses(way.motion.positions[::5]), way.q_hand[::5], strict=True
                )
                for links in [hand.forward_kinematics(palm, q)]
                for g in hand.link_geometries
            ]
            assert min(heights) > (0.009 if way.motion.duration < 4.0 else 0.0)
        before = after
    assert changes > 0


def test_an_arm_keeps_the_hand_off_the_table() -> None:
    hand = STATION.hand
    probe = Probe(np.array([0.06, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), 0.03, 0.02)
    far = BOX.copy().apply_translation([0.0, 0.3, 0.0])
    course = GuardedMotion(hand, far, STATION).run(probe, SPACE)
    assert course.at_table
    links = hand.forward_kinematics(course.X_OH_end, course.joint_positions)
    lowest = min(
        trimesh.transform_points(g.mesh.vertices, links[g.link] @ g.X_LG)[:, 2].min()
        for g in hand.link_geometries
    )
    assert lowest == pytest.approx(0.003, abs=5e-4)  # meshes of balls are facetted
