"""Probes and grasps within the reach of an arm, and probes that keep off the estimate."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from analytic_surfaces import Analytic, cube_bounds, union
from analytic_surfaces import box as box_of
from stations import station_with

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.reach import JUMP, ArmPlace
from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import PassedWay, Probe
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.geometry import apply_pose
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.probing.approach_planner import (
    OUT_OF_ARM_REACH,
    Approach,
    ApproachPlanner,
    points_on_links,
)
from lis_grasp.probing.exposure import exposed_width
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.probing.keep_out import FREE, INSIDE, NEAR, KeepOut
from lis_grasp.results.summary import REJECTIONS
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray


@pytest.fixture(scope="module")
def station() -> Station:
    return station_with("allegro")


@pytest.fixture(scope="module")
def box() -> trimesh.Trimesh:
    return trimesh.creation.box([0.06, 0.08, 0.12]).apply_translation([0.0, 0.0, 0.06])


def _obstacles() -> ObstacleModel:
    space = Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0)
    nothing = Contacts(points=np.zeros((0, 3)), normals=np.zeros((0, 3)))
    return ObstacleModel(space, nothing, None)


@pytest.mark.by_default("side1", "side2")
@pytest.mark.parametrize("side", [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
def test_probes_of_every_side_are_within_the_arms_reach(station: Station, side: list) -> None:
    normal = np.array(side, float)
    target = [0.0, 0.0, 0.06] + normal * [0.03, 0.04, 0.06]
    probe = Probe(target, -normal, standoff=0.05, overshoot=0.02)
    approach = ApproachPlanner(station.hand, station).plan(probe, _obstacles())
    arm = approach.arm
    np.testing.assert_allclose(
        station.palm_poses(arm.approach[0]), approach.X_OH_outside, atol=2e-3
    )
    for start in (arm.approach[-1], arm.motion[0]):
        np.testing.assert_allclose(station.palm_poses(start), approach.X_OH, atol=2e-3)
    end = approach.X_OH.copy()
    end[:3, 3] += 0.07 * probe.direction
    np.testing.assert_allclose(station.palm_poses(arm.motion[-1]), end, atol=2e-3)
    path = np.vstack([arm.approach, arm.motion])
    assert station.arm.within_limits(path).all()
    assert np.abs(np.diff(path, axis=0)).max() <= JUMP
    checker = StationChecker(station, arm_only=True)
    assert checker.free(path, approach.posture.joint_positions).all()


@pytest.mark.slow
def test_a_probe_out_of_the_arms_reach_is_blocked_with_the_reason(
    station: Station, box: trimesh.Trimesh
) -> None:
    X_WA = np.eye(4)
    X_WA[0, 3] = -2.0
    far = station.moved(X_WA)
    probe = Probe([0.0, 0.0, 0.12], [0.0, 0.0, -1.0], standoff=0.05, overshoot=0.02)
    assert ApproachPlanner(far.hand, far).plan(probe, _obstacles()) is None
    assert GuardedMotion(far.hand, box, far).run(probe, _obstacles()) == OUT_OF_ARM_REACH
    assert not isinstance(GuardedMotion(far.hand, box).run(probe, _obstacles()), str)


@pytest.mark.slow
def test_an_arm_seeks_by_motions_on_which_fingertips_lead(station: Station) -> None:
    hand, region = station.hand, Region()
    space = ObstacleModel(region.grown(Contacts.empty()), Contacts.empty(), None)
    planners = {"free": ApproachPlanner(hand), "arm": ApproachPlanner(hand, station)}

    def exposed(name: str, probe: Probe) -> float | None:
        approach = planners[name].plan(probe, space)
        if approach is None:
            return None
        joints = [approach.posture.joint_positions]
        links = (hand.fingertip_links, {*hand.links} - hand.fingertip_links)
        inner, tips = (
            apply_pose(approach.X_OH, points_on_links(hand, joints, out)[0]) for out in links
        )
        return exposed_width(inner, tips, probe.direction, 0.0)

    level = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0])
    sweeps = [Probe([0.0, 0.0, 0.0045], way, 0.2, 0.2, purpose="search") for way in level]
    of_arm = {k: exposed("arm", probe) for k, probe in enumerate(sweeps)}
    reached = [k for k, width in of_arm.items() if width is not None]
    assert reached
    for k in reached:  # a free hand takes the least exposed approach
        assert of_arm[k] <= exposed("free", sweeps[k]) + 0.02 + 1e-9
    # What the policy wants is near the estimate: there the arm may take any approach.
    any_way = [exposed("arm", replace(probe, purpose="policy")) for probe in sweeps]
    assert max(width for width in any_way if width is not None) > 0.1


@pytest.mark.slow
def test_a_repeated_probe_has_the_pose_of_the_hand_that_touched(station: Station) -> None:
    planner, places = ApproachPlanner(station.hand, station), _obstacles()
    probe = Probe([0.0, 0.0, 0.12], [0.0, 0.0, -1.0], standoff=0.05, overshoot=0.02)
    first = planner.find(probe, places)
    X_OH = first.X_OH.copy()
    X_OH[:3, 3] += probe.standoff * probe.direction
    again = replace(probe, purpose="repeat", passed=PassedWay(X_OH, 0.005))
    turned = []
    for side in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        other = planner.find(Probe([0.0, 0.0, 0.06], side, 0.1, 0.0), places)
        start = ArmPlace(other.arm.motion[-1], other.posture.joint_positions)
        ways = [planner.find(one, places, start) for one in (again, probe)]
        np.testing.assert_allclose(ways[0].X_OH, first.X_OH, atol=1e-9)
        turned.append(np.linalg.norm(ways[1].X_OH - first.X_OH))
    assert max(turned) > 0.1  # from other places, other poses are nearer


@pytest.mark.slow
def test_grasps_within_reach_are_fewer_and_counted(station: Station, box: trimesh.Trimesh) -> None:
    hand = Hand.load("wsg50")
    X_WA = np.eye(4)
    X_WA[0, 3] = -0.85  # far enough that the far side is out of reach
    of_jaw = Station.make(station.arm, hand, X_WA, table=Table())
    search = ForceClosureSampler(hand, candidates=60, station=of_jaw).sample(
        box, rng=np.random.default_rng(0), support_height=0.0, count=5
    )
    reasons = {"out_of_arm_reach", "no_straight_arm_motion"}
    assert reasons & set(search.rejections)
    assert set(search.rejections) <= set(REJECTIONS)
    for grasp in search.grasps:
        assert of_jaw.solve_ik(grasp.X_OH[None]).reached.all()


_DEVIATION = 0.003  # [m]


# A post under a roof that juts out above its side at +y.
_ROOF = Analytic(
    union(
        box_of([0.03, 0.04, 0.06], center=[0.0, 0.0, 0.06]),
        box_of([0.05, 0.06, 0.04], center=[0.0, 0.06, 0.08]),
    ),
    cube_bounds(0.2),
    doubt=lambda p: np.full(p.shape[:-1], _DEVIATION),
)


def _under_roof(contacts: int) -> ObstacleModel:
    # Contacts of the top, too far from the probes to make the estimate an obstacle there.
    points = np.column_stack([np.linspace(-0.02, 0.02, contacts), np.zeros(contacts)])
    points = np.column_stack([points, np.full(contacts, 0.12)])
    known = Contacts(points=points, normals=np.tile([0.0, 0.0, 1.0], (contacts, 1)))
    space = Workspace(0.03, np.array([0.0, 0.03, 0.06]), 0.2, 0.0)
    return ObstacleModel(space, known, _ROOF)


def test_places_are_near_within_two_deviations() -> None:
    keep_out = KeepOut(_under_roof(6))
    cell = 0.2 / 24
    beside = np.array([0.03, 0.0, 0.03])  # on the post's side
    off = np.array([1.0, 0.0, 0.0])
    assert keep_out.nearness(beside - cell * off) == INSIDE
    assert keep_out.nearness(beside + 0.4 * cell * off) == NEAR
    assert keep_out.nearness(beside + (2.0 * _DEVIATION + 2.0 * cell) * off) == FREE
    assert keep_out.nearness(np.array([1.0, 0.0, 0.0])) == FREE  # beyond the grid
    assert keep_out.nearness(np.array([beside - cell * off, 10.0 * off])) == INSIDE
    assert not KeepOut(_under_roof(4)).is_known


@pytest.mark.slow
def test_a_probe_is_blocked_if_inner_links_would_pass_through_the_estimate(
    station: Station,
) -> None:
    planner = ApproachPlanner(station.hand, station)
    probe = Probe([0.0, 0.04, 0.02], [0.0, -1.0, 0.0], standoff=0.05, overshoot=0.02)
    # Four contacts are no estimate to go by: the hand would pass through the roof.
    approach = planner.plan(probe, _under_roof(4))
    assert (_ROOF.evaluate(_passed(station, approach, probe)) < 0.0).any()
    assert planner.plan(probe, _under_roof(6)) is None


def _passed(station: Station, approach: Approach, probe: Probe) -> FloatArray:
    """Return where the corners of all links but fingertips are on a probe up to its target."""
    hand = station.hand
    links = hand.forward_kinematics(approach.X_OH, approach.posture.joint_positions)
    corners = []
    for geometry in hand.link_geometries:
        if geometry.link not in hand.fingertip_links:
            X_OG = links[geometry.link] @ geometry.X_LG
            corners.append(geometry.mesh.vertices @ X_OG[:3, :3].T + X_OG[:3, 3])
    ahead = np.linspace(0.0, probe.standoff, 11)[:, None, None] * probe.direction
    return np.concatenate(corners) + ahead
