"""Stations: palm kinematics, collisions, home, placement of the base, efforts, reach of grasps."""

import pickle

import numpy as np
import pytest
import trimesh

from lis_grasp.arms.check import check_arm, gravity_efforts
from lis_grasp.arms.collision import ARM_CLEARANCE, StationChecker
from lis_grasp.arms.placement import HEADROOM, choose_base, home_of, reach_fraction
from lis_grasp.arms.reach import ReachFilter, track
from lis_grasp.arms.station import Station, Table
from lis_grasp.exceptions import InvalidArmError, InvalidOptionError
from lis_grasp.geometry import apply_pose
from lis_grasp.grasping.grasps import LIFT, STANDOFF
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.pose_ik import pose_error
from lis_grasp.world import Body, Surroundings


def _base(x: float, z: float = 0.0) -> np.ndarray:
    X_WA = np.eye(4)
    X_WA[:3, 3] = x, 0.0, z
    return X_WA


@pytest.fixture(scope="module")
def station() -> Station:
    return Station.make(Arm.load("iiwa14"), Hand.load("allegro"), _base(-0.55, 0.2), table=Table())


def _random(station: Station, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(station.arm.lower, station.arm.upper, size=(count, 7))


def test_ik_reaches_palm_poses(station: Station) -> None:
    X_WH = station.palm_poses(_random(station, 20, 2))
    found = station.solve_ik(X_WH)
    assert found.reached.mean() >= 0.9
    error = pose_error(station.palm_poses(found.q), X_WH[:, None])[found.solved]
    # The flange is within 0.1 mm and 1 mrad, the palm 0.1 m beyond it.
    assert np.linalg.norm(error[:, :3], axis=1).max() < 2e-4


def test_stations_can_be_sent_to_other_processes(station: Station) -> None:
    q = _random(station, 3, 5)
    sent = pickle.loads(pickle.dumps(station))  # noqa: S301
    np.testing.assert_array_equal(sent.palm_poses(q), station.palm_poses(q))
    X_WH = station.palm_poses(q)
    np.testing.assert_array_equal(sent.solve_ik(X_WH).q, station.solve_ik(X_WH).q)


def test_a_base_inside_the_table_is_refused(station: Station) -> None:
    with pytest.raises(InvalidOptionError):
        station.moved(_base(-0.55, -0.1))
    station.moved(_base(-0.8, -0.1))  # beside it
    with pytest.raises(InvalidOptionError):
        station.moved(np.diag([2.0, 1.0, 1.0, 1.0]))


@pytest.mark.slow
@pytest.mark.parametrize("margin", [pytest.param(0.0, marks=pytest.mark.slow), 0.02])
def test_collisions_are_those_of_all_bodies_one_by_one(station: Station, margin: float) -> None:
    """Compare with closed meshes and trimesh's own manager, which know nothing of balls."""
    box = trimesh.creation.box([0.3, 0.3, 0.3]).apply_translation([0.0, 0.0, 0.15])
    checker = StationChecker(station, box, margin=margin)
    hand, arm = station.hand, station.arm
    q_hand = next(iter(hand.pregrasps.values()))
    q = arm.home + np.random.default_rng(3).uniform(-0.9, 0.9, size=(40, 7))
    q = arm.clipped(q + [0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    free = checker.free(q, q_hand)
    assert 10 < free.sum() < 35
    fixed = arm.fixed_links
    manager = trimesh.collision.CollisionManager()
    manager.add_object("box", box)
    for posture, is_free in zip(q, free, strict=True):
        links = arm.forward_kinematics(station.X_WA, posture)
        links |= hand.forward_kinematics(station.palm_poses(posture), q_hand)
        low, touching = np.inf, False
        for g in (*arm.link_geometries, *hand.link_geometries):
            X = links[g.link] @ g.X_LG
            if g.link not in fixed:
                clearance = max(ARM_CLEARANCE, margin) if g.link in arm.links else 0.0003 + margin
                low = min(low, (g.mesh.vertices @ X[2, :3] + X[2, 3]).min() - clearance)
            touching |= manager.min_distance_single(g.mesh, X) <= margin
        hit = checker.first_hit(posture, q_hand)
        assert is_free == (hit is None)
        if is_free:
            assert low > 0.0
            assert not touching
        elif hit[0] == "object":
            assert touching
        elif hit[0] == "table":
            assert low < 0.0


def test_a_folded_arm_hits_itself(station: Station) -> None:
    q = np.array([1.23, -2.07, 0.62, 2.05, -1.27, -1.01, -1.76])
    hit = StationChecker(station).first_hit(q, next(iter(station.hand.pregrasps.values())))
    assert hit[0] == "self"


def test_home_is_high_and_free(station: Station) -> None:
    home = home_of(station)
    postures = list(station.hand.pregrasps.values())
    assert StationChecker(station).free(np.tile(home, (len(postures), 1)), np.array(postures)).all()
    assert station.palm_poses(home)[2, 3] > HEADROOM


def test_another_home_is_found_where_the_arms_own_is_too_low(station: Station) -> None:
    table = Table(height=0.25)  # beside the base, which is on the floor
    high_table = Station(station.arm, station.hand, _base(-0.85), station.mount, table)
    home = home_of(high_table)
    assert not np.array_equal(home, high_table.arm.home)
    assert high_table.palm_poses(home)[2, 3] > 0.25 + HEADROOM


def test_no_home_is_an_error_with_the_place_of_the_base(station: Station) -> None:
    with pytest.raises(InvalidArmError) as error:
        home_of(Station(station.arm, station.hand, _base(-3.0), station.mount, Table(height=0.5)))
    assert error.value.key == "home"


def test_straight_motions_are_straight(station: Station) -> None:
    q = station.arm.home
    X_WH = station.palm_poses(q)
    moved = np.array([0.03, -0.05, -0.1])
    tracked = track(station, q[None], X_WH[None], moved)
    assert tracked.followed.all()
    poses = station.palm_poses(tracked.q[0])
    part = np.linspace(0.0, 1.0, len(poses))[:, None]
    np.testing.assert_allclose(poses[:, :3, 3], X_WH[:3, 3] + part * moved, atol=2e-4)
    assert np.abs(pose_error(poses, X_WH)[:, 3:]).max() < 2e-3


def test_straight_motions_end_at_the_reach(station: Station) -> None:
    q = station.arm.home
    tracked = track(station, q[None], station.palm_poses(q)[None], np.array([1.0, 0.0, 0.0]))
    assert not tracked.followed.any()


def test_grasps_are_kept_or_rejected_with_a_reason(station: Station) -> None:
    box = trimesh.creation.box([0.06, 0.08, 0.12]).apply_translation([0.0, 0.0, 0.06])
    down = np.eye(4)
    down[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # the palm's +x, its approach, points down
    down[:3, 3] = 0.0, 0.0, 0.25
    far, under = down.copy(), down.copy()
    far[0, 3], under[1:3, 3] = 1.0, [0.25, -0.1]
    q_open = station.hand.pregrasps["wide"]
    grasps = np.array([down, far, under]), np.tile(q_open, (3, 1)), np.tile(q_open, (3, 1))
    reasons = ["out_of_arm_reach", "arm_hits_table"]
    kept, *others = ReachFilter(station, box).plan(*grasps)
    assert others == reasons
    assert station.reach_check(box)(*grasps) == [None, *reasons]
    np.testing.assert_allclose(station.palm_poses(kept.approach[-1]), down, atol=2e-3)
    np.testing.assert_allclose(kept.lift[0], kept.approach[-1])
    back = station.palm_poses(kept.standoff)[:3, 3] - down[:3, 3]
    np.testing.assert_allclose(back, [0.0, 0.0, STANDOFF], atol=2e-4)
    np.testing.assert_allclose(
        station.palm_poses(kept.lift[-1])[:3, 3] - down[:3, 3], [0.0, 0.0, LIFT], atol=2e-4
    )


def test_gravity_efforts_are_the_derivative_of_potential_energy(station: Station) -> None:
    hand, arm, load = station.hand, station.arm, 0.7
    posture = next(iter(hand.pregrasps.values()))

    def energy(q: np.ndarray) -> float:
        X_WH = station.palm_poses(q)
        links = arm.forward_kinematics(station.X_WA, q)
        in_hand = hand.forward_kinematics(X_WH, posture)
        total = load * hand.pad_centers(X_WH, posture).mean(axis=0)[2]
        for poses, inertials in ((links, arm.inertials), (in_hand, hand.inertials)):
            total += sum(
                i.mass * (poses[n][2, :3] @ i.center_L + poses[n][2, 3])
                for n, i in inertials.items()
            )
        return 9.81 * total

    q, step = _random(station, 1, 6)[0], 1e-5
    efforts = gravity_efforts(station, q[None], load=load)[0]
    slope = [(energy(q + step * e) - energy(q - step * e)) / (2 * step) for e in np.eye(7)]
    np.testing.assert_allclose(efforts, slope, atol=1e-5)


@pytest.mark.slow
def test_the_chosen_base_reaches_more_than_a_bad_one() -> None:
    arm, hand = Arm.load("iiwa14"), Hand.load("wsg50")
    chosen = choose_base(arm, hand)
    assert reach_fraction(chosen) > 0.5 > reach_fraction(chosen.moved(_base(-1.0)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "wsg50", "barrett"])
def test_the_shipped_arm_passes_every_check(name: str) -> None:
    findings = check_arm(Arm.load("iiwa14"), Hand.load(name))
    assert [finding.text for finding in findings if not finding.fine] == []
    assert len(findings) >= 5


@pytest.mark.parametrize(("arm_only", "part"), [(False, "palm"), (False, "elbow"), (True, "elbow")])
def test_an_arm_and_the_hand_that_it_carries_avoid_obstacles(
    station: Station, arm_only: bool, part: str
) -> None:
    home, arm = station.arm.home, station.arm
    q_hand = next(iter(station.hand.pregrasps.values()))
    place = station.palm_poses(home)[:3, 3]
    if part == "elbow":
        link = arm.link_geometries[len(arm.link_geometries) // 2].link
        place = arm.forward_kinematics(station.X_WA, home)[link][:3, 3]
    hits = []
    for height in (0.0, 5.0):
        post = trimesh.creation.box(extents=[0.03, 0.03, 0.5])
        post.apply_translation(place + [0.0, 0.0, height])
        table = Table(surroundings=Surroundings((Body.of_mesh("post", post),)))
        beside = Station(arm, station.hand, station.X_WA, station.mount, table)
        hits.append(StationChecker(beside, arm_only=arm_only).first_hit(home, q_hand))
    assert hits[0][0] == "obstacle"
    assert hits[1] is None


def test_the_arm_keeps_its_distance_from_obstacles(station: Station) -> None:
    home, arm = station.arm.home, station.arm
    q_hand = next(iter(station.hand.pregrasps.values()))
    links = arm.forward_kinematics(station.X_WA, home)
    moving = [g for g in arm.link_geometries if g.link not in arm.fixed_links]
    points = np.vstack([apply_pose(links[g.link] @ g.X_LG, g.mesh.vertices) for g in moving])
    place, found = points[np.argmax(points[:, 1])], set()
    for gap in np.arange(0.002, 0.05, 0.004):
        half = np.array([0.01, 0.2, 0.01])
        center = place + [0.0, half[1] + gap, 0.0]
        post = trimesh.creation.box(extents=2.0 * half).apply_translation(center)
        # Of the vertices: at least that of the links, which are 5 mm from a vertex at most.
        outside = np.maximum(np.abs(points - center) - half, 0.0)
        nearest = np.linalg.norm(outside, axis=1).min()
        table = Table(surroundings=Surroundings((Body.of_mesh("post", post),)))
        beside = Station(arm, station.hand, station.X_WA, station.mount, table)
        hit = StationChecker(beside, arm_only=True).first_hit(home, q_hand)
        found.add(hit is None)
        if hit is None:
            assert nearest >= ARM_CLEARANCE
        else:
            assert nearest < ARM_CLEARANCE + 0.005
    assert found == {True, False}
