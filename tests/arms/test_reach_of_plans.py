"""Probes and grasps that are planned within the reach of an arm."""

import numpy as np
import pytest
import trimesh
from stations import station_with

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.reach import JUMP
from lis_grasp.arms.station import Station, Table
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.grasping.sampler import ForceClosureSampler
from lis_grasp.pipeline.reasons import REJECTIONS
from lis_grasp.probing.approach_planner import OUT_OF_ARM_REACH, ApproachPlanner
from lis_grasp.probing.guarded_motion import GuardedMotion
from lis_grasp.robots.hand import Hand


@pytest.fixture(scope="module")
def station() -> Station:
    return station_with("allegro")


@pytest.fixture(scope="module")
def box() -> trimesh.Trimesh:
    mesh = trimesh.creation.box([0.06, 0.08, 0.12])
    mesh.apply_translation([0.0, 0.0, 0.06])
    return mesh


def _obstacles() -> ObstacleModel:
    space = Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0)
    nothing = Contacts(points=np.zeros((0, 3)), normals=np.zeros((0, 3)))
    return ObstacleModel(space, nothing, None)


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
