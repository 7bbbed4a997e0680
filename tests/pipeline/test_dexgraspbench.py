"""Files of DexGraspBench: postures, masses and the servos' forces, as MuJoCo reads them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from made_grasps import jaw_grasp

from lis_grasp.cli.main import main
from lis_grasp.exports.dexgraspbench import TabletopObject, save_for_dexgraspbench
from lis_grasp.grasping.export import squeeze_posture
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import HAND_NAMES

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: bootstrap.sh mujoco")

BOX = trimesh.creation.box((0.05, 0.05, 0.08))
TARGET = TabletopObject("box", [BOX], -0.04)


def pinch(hand: Hand) -> Grasp:
    """Return a posture in the middle of the joints' ranges, with a force of 1 N at each pad."""
    q = 0.6 * hand.lower + 0.4 * hand.upper
    X_OH = trimesh.transformations.euler_matrix(0.3, -0.5, 2.0)
    X_OH[:3, 3] = [0.1, 0.2, 0.3]
    axes = hand.pad_axes(X_OH, q)
    radii = np.array([pad.radius for pad in hand.pads])
    return Grasp(
        hand=hand.name,
        X_OH=X_OH,
        joint_names=hand.joint_names,
        joint_positions=q,
        pregrasp_positions=hand.lower,
        approach_O=[0.0, 0.0, -1.0],
        contact_points=hand.pad_centers(X_OH, q) + radii[:, None] * axes,
        contact_normals=-axes,
        contact_fingers=hand.fingers,
        contact_forces=axes,
        quality={"epsilon": 0.0},
        accepted="made by hand",
    )


@pytest.mark.parametrize("name", HAND_NAMES)
def test_the_hand_file_has_the_poses_of_the_postures(name: str, tmp_path: Path) -> None:
    hand = Hand.load(name)
    grasp = pinch(hand)
    folder = save_for_dexgraspbench(tmp_path, TARGET, hand, [grasp])
    (file,) = (folder / "graspdata").glob("**/*.npy")
    data = np.load(file, allow_pickle=True).item()
    config = yaml.safe_load((folder / "hand" / f"lis_{name}.yaml").read_text())
    model = mujoco.MjModel.from_xml_path(config["xml_path"])
    state = mujoco.MjData(model)
    for key, q in (("grasp_qpos", grasp.joint_positions), ("pregrasp_qpos", hand.lower)):
        base, state.qpos[:] = data[key][:7], data[key][7:]
        mujoco.mj_kinematics(model, state)
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, base[3:])
        expected = hand.forward_kinematics(grasp.X_OH, q)
        for link, body in zip(hand.links, config["valid_body_name"], strict=True):
            placed = R.reshape(3, 3) @ state.body(body).xpos + base[:3]
            assert placed == pytest.approx(expected[link][:3, 3] + [0, 0, 0.04], abs=1e-9)
    assert data["obj_pose"] == pytest.approx([0, 0, 0.04, 1, 0, 0, 0])


@pytest.mark.parametrize("name", ["allegro", "wsg50"])
def test_servos_in_the_squeeze_posture_exert_the_planned_forces(name: str, tmp_path: Path) -> None:
    hand = Hand.load(name)
    grasp = pinch(hand)
    folder = save_for_dexgraspbench(tmp_path, TARGET, hand, [grasp])
    model = mujoco.MjModel.from_xml_path(str(folder / "hand" / f"{name}.xml"))
    state = mujoco.MjData(model)
    (file,) = (folder / "graspdata").glob("**/*.npy")
    data = np.load(file, allow_pickle=True).item()
    state.qpos[:] = data["grasp_qpos"][7:]
    state.ctrl[:] = squeeze_posture(hand, grasp)
    mujoco.mj_forward(model, state)
    # Virtual work of the efforts equals that of the contact forces for any motion of the joints.
    step = 1e-7 * np.random.default_rng(0).standard_normal(len(grasp.joint_positions))
    points = []
    for q in (grasp.joint_positions - step, grasp.joint_positions + step):
        poses = hand.forward_kinematics(grasp.X_OH, q)
        zero = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)
        carried = [poses[pad.link] @ np.linalg.inv(zero[pad.link]) for pad in hand.pads]
        at = zip(carried, grasp.contact_points, strict=True)
        points.append([X[:3, :3] @ p + X[:3, 3] for X, p in at])
    work = ((np.array(points[1]) - points[0]) * grasp.contact_forces).sum()
    assert state.qfrc_actuator @ (2.0 * step) == pytest.approx(work, rel=1e-5)


def test_the_object_s_mass_is_that_of_its_pieces(tmp_path: Path) -> None:
    hand = Hand.load("wsg50")
    pieces = [BOX, BOX.copy().apply_translation((0.05, 0.0, 0.0))]
    folder = save_for_dexgraspbench(tmp_path, TabletopObject("pair", pieces, -0.04), hand, [])
    facts = json.loads((folder / "object" / "pair" / "info" / "simplified.json").read_text())
    assert facts["mass"] == pytest.approx(2.0 * BOX.volume)
    assert facts["gravity_center"] == pytest.approx([0.025, 0.0, 0.0])
    meshes = sorted((folder / "object" / "pair" / "urdf" / "meshes").glob("*.obj"))
    assert [trimesh.load(file).volume for file in meshes] == pytest.approx([BOX.volume] * 2)


@pytest.mark.slow
def test_the_command_writes_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / "part.ply"
    BOX.export(mesh)
    arguments = ["grasp", str(mesh), "--hand", "wsg50", "--grasps", "2", "--dexgraspbench"]
    assert main(arguments) == 0
    files = list((tmp_path / "dexgraspbench" / "graspdata" / "part").glob("*.npy"))
    assert len(files) == 2
    assert "hand=lis_wsg50" in capsys.readouterr().out
    tests = json.loads((tmp_path / "dexgraspbench" / "protocol.json").read_text())
    assert tests == [{"table_lift": True, "force_test": True}] * 2


def test_a_jaw_s_squeeze_moves_the_jaws_towards_each_other() -> None:
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.zeros(3), 0.05)
    # 10 N by servos of 5000 N/m.
    assert squeeze_posture(hand, grasp) == pytest.approx(grasp.joint_positions - 0.002)
