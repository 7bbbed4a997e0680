"""Every hand of the package on every arm of the package: it runs, or is refused at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import lis_grasp
from lis_grasp import shapes
from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.trajectory import TIME_STEP, JointTrajectory
from lis_grasp.exceptions import InvalidHandError, InvalidOptionError
from lis_grasp.lifting.outcome import ArmUse
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import ARM_NAMES, HAND_NAMES
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.simulation.drake.dynamic_prober import TransitScene

VENDORS = ("robotiq_2f85", "panda_hand", "leap", "inspire_hand", "barrett_bh280")
# The cup's pin touches low places only with the hand on its side, where no flange is above it.
EXPLORING = tuple(name for name in HAND_NAMES if name != "cup")
BOX = trimesh.creation.box([0.06, 0.08, 0.12])
_X_WA = np.eye(4)
_X_WA[:3, 3] = -0.55, 0.0, 0.2


@pytest.mark.parametrize("arm", ARM_NAMES)
@pytest.mark.parametrize("hand", HAND_NAMES)
def test_an_arm_carries_every_hand_at_rest(arm: str, hand: str) -> None:
    # Joints that follow others are locked with them: their couplings must not make steps singular.
    station = Station.make(Arm.load(arm), Hand.load(hand), _X_WA, table=Table())
    use = ArmUse()
    scene = TransitScene(station, BOX, use)
    posture = next(iter(station.hand.probe_postures.values())).joint_positions
    steps, home = 5, station.arm.home
    rest = np.zeros((steps, len(home)))
    times = TIME_STEP * np.arange(steps)
    way = JointTrajectory(station.arm.joint_names, times, rest + home, rest, rest)
    X_WO = np.eye(4)
    X_WO[:3, 3] = 0.0, 0.0, 0.06
    scene.run(way, posture, X_WO)
    assert use.steps == steps - 1
    assert use.contacts == {}
    assert use.effort < 1.0
    # At rest the springs yield by nothing: inverse dynamics carries the weight.
    moved = scene._arm.hand.X_WH(scene._scene.context) - station.palm_poses(home[None])[0]
    assert np.abs(moved).max() < 1e-4


@pytest.mark.parametrize("arm", ARM_NAMES)
@pytest.mark.parametrize("hand", HAND_NAMES)
def test_an_arm_in_mujoco_is_refused_before_the_start(arm: str, hand: str) -> None:
    with pytest.raises(InvalidOptionError) as refused:
        lis_grasp.run("box", hand, arm=arm, simulator="mujoco")
    assert refused.value.option == "arm"


@pytest.mark.slow
@pytest.mark.parametrize("prober", ["dynamic", "kinematic"])
@pytest.mark.parametrize("obj", ["box", "cylinder"])
@pytest.mark.parametrize("hand", EXPLORING)
@pytest.mark.parametrize("arm", ARM_NAMES)
def test_every_hand_on_every_arm_touches_and_lifts(
    arm: str, hand: str, obj: str, prober: str, tmp_path: Path
) -> None:
    run = lis_grasp.run(obj, hand, arm=arm, prober=prober, touches=8, folder=tmp_path)
    assert run.report is not None
    assert len(run.contacts) >= 8
    assert len(run.grasps)
    assert run.report["lift"]["reason"] not in ("diverged", "arm_collision", "torque_limit")
    if prober == "dynamic":
        # A link of the hand may meet the unknown object before a fingertip does; nothing else.
        for name in run.report["arm"]["touches"]["contacts"]:
            link, body = name.split(" with ")
            assert body == "object"
            assert link in Hand.load(hand).links


@pytest.mark.slow
@pytest.mark.parametrize(
    ("prober", "simulator", "obj"),
    [("dynamic", "drake", "box"), ("kinematic", "mujoco", "cylinder")],
)
@pytest.mark.parametrize("hand", [*HAND_NAMES, *VENDORS])
def test_hands_of_five_vendors_touch_and_lift_like_the_packages_own(
    hand: str, prober: str, simulator: str, obj: str, tmp_path: Path
) -> None:
    if simulator == "mujoco":
        pytest.importorskip("mujoco")
    try:
        Hand.load(hand)
    except InvalidHandError as error:  # its model is installed apart
        assert hand in VENDORS
        pytest.skip(str(error))
    robot = {"prober": prober, "simulator": simulator}
    run = lis_grasp.run(obj, hand, folder=tmp_path, known=True, touches=6, grasps=3, **robot)
    assert run.contacts is not None
    assert len(run.contacts) >= 6
    # Of exploration alone: tests before the lift move the object, and a lip feels roughly where.
    assert run.report is not None
    explored = run.contacts.points[: run.report["exploration"]["contacts"]]
    off, _ = distances_to_mesh(explored, shapes.find(obj).mesh)
    assert off.max() < 1e-4  # a tenth of a millimetre: the sensor is ideal
    assert run.lift is not None
    assert bool(run.grasps) == (run.lift["reason"] != "no_grasp")
    assert run.lift["reason"] != "diverged"
