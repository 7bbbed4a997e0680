"""An arm's way in free space in Drake: it keeps its limits, and says what it touches."""

import numpy as np
import pytest
import trimesh
from stations import station_with

from lis_grasp.arms.trajectory import time_path
from lis_grasp.arms.use import ArmStoppedError, ArmUse, violations
from lis_grasp.simulation.drake.transit_scene import TransitScene

STATION = station_with("wsg50")
ARM, HAND = STATION.arm, STATION.hand
OPEN = next(iter(HAND.pregrasps.values()))
POST = trimesh.creation.box(extents=[0.04, 0.04, 0.2]).apply_translation([0.0, 0.0, 0.1])
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def use() -> ArmUse:
    return ArmUse()


@pytest.fixture(scope="module")
def scene(use: ArmUse) -> TransitScene:
    return TransitScene(STATION, POST, use)


def moved(joint: int, angle: float) -> np.ndarray:
    q = ARM.home.copy()
    q[joint] += angle
    return np.array([ARM.home, q])


def test_a_free_way_keeps_every_limit(scene: TransitScene, use: ArmUse) -> None:
    way = time_path(ARM, moved(0, 0.8))
    scene.run(way, OPEN, np.eye(4))
    assert use.steps == len(way.times) - 1
    assert use.contacts == {}
    assert 0.0 < use.effort < 1.0
    # The motion asks for half of the speeds, and the control follows it.
    assert use.speed == pytest.approx(ARM.speed_fraction, abs=0.02)


def test_a_way_into_the_object_ends_at_it(scene: TransitScene, use: ArmUse) -> None:
    use.contacts.clear()
    (X_WH,) = STATION.palm_poses(ARM.home[None])
    X_WO = np.eye(4)
    X_WO[:2, 3] = X_WH[:2, 3]
    X_WO[2, 3] = X_WH[2, 3] - 0.35  # the post's top is below the hand
    with pytest.raises(ArmStoppedError) as error:
        scene.run(time_path(ARM, moved(1, 0.9)), OPEN, X_WO)
    assert error.value.reason == "arm_collision"
    assert any("object" in pair for pair in use.contacts)
    assert violations([{"contacts": use.contacts, "effort": 0.1, "speed": 0.1}])


def test_a_fingertip_may_graze_the_object_beside_a_touch(scene: TransitScene, use: ArmUse) -> None:
    use.contacts.clear()
    posture = next(iter(HAND.probe_postures.values()))
    tip = HAND.forward_kinematics(STATION.palm_poses(ARM.home), posture.joint_positions)
    X_WO = np.eye(4)
    X_WO[:3, 3] = trimesh.transform_points(posture.center_L[None], tip[posture.link])[0]
    X_WO[2, 3] -= 0.2 + posture.radius - 0.0005  # the post's top is 0.5 mm inside of the tip
    way = time_path(ARM, moved(1, -0.05))
    scene.run(way, posture.joint_positions, X_WO, touch=0.0)
    assert use.contacts == {}
    with pytest.raises(ArmStoppedError):
        scene.run(way, posture.joint_positions, X_WO)
    assert list(use.contacts) == [f"{posture.link} with object"]


def test_a_way_into_the_table_is_a_violation(scene: TransitScene, use: ArmUse) -> None:
    use.contacts.clear()
    stretched = moved(1, 2.0)
    stretched[1, 3] += 0.5
    far = np.eye(4)
    far[:2, 3] = 0.4, 0.6
    with pytest.raises(ArmStoppedError):
        scene.run(time_path(ARM, stretched), OPEN, far)
    assert any("table" in pair for pair in use.contacts)
