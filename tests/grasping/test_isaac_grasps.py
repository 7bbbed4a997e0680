"""Grasps in the isaac_grasp format: the poses and joints that another program reads from it."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from made_grasps import jaw_grasp
from scipy.spatial.transform import Rotation

from lis_grasp import GraspSearch, Hand, shapes
from lis_grasp.cli.main import main
from lis_grasp.grasping.export import save_isaac_grasps


def test_another_program_finds_the_links_where_the_grasp_has_them(tmp_path: Path) -> None:
    hand = Hand.load("wsg50")
    grasps = [jaw_grasp(hand, np.array([0.01, 0.02, height]), 0.05) for height in (0.0, 0.03)]
    search = GraspSearch(tuple(grasps))
    save_isaac_grasps(tmp_path / "grasps.yaml", search, hand)
    content = yaml.safe_load((tmp_path / "grasps.yaml").read_text())
    assert (content["format"], content["format_version"]) == ("isaac_grasp", 1.0)
    assert content["gripper_frame"] == hand.base_link
    assert list(content["grasps"]) == [f"grasp_{i}" for i in range(len(search.grasps))]
    for grasp, entry in zip(search.grasps, content["grasps"].values(), strict=True):
        expected = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)[hand.base_link]
        np.testing.assert_allclose(entry["position"], expected[:3, 3], atol=1e-12)
        quaternion = [*entry["orientation"]["xyz"], entry["orientation"]["w"]]
        R = Rotation.from_quat(quaternion).as_matrix()
        np.testing.assert_allclose(R, expected[:3, :3], atol=1e-12)
        assert 0.0 <= entry["confidence"] <= 1.0
        assert entry["cspace_position"] == dict(
            zip(grasp.joint_names, grasp.joint_positions, strict=True)
        )
        assert set(entry["pregrasp_cspace_position"]) == set(hand.joint_names)


@pytest.mark.slow
def test_the_grasp_verb_writes_it_when_asked(tmp_path: Path) -> None:
    mesh = tmp_path / "box.ply"
    shapes.build("box").mesh.export(mesh)
    arguments = ["grasp", str(mesh), "--hand", "wsg50", "--grasps", "1", "--isaac"]
    assert main([*arguments, "--output", str(tmp_path)]) == 0
    content = yaml.safe_load((tmp_path / "grasps.isaac.yaml").read_text())
    (entry,) = content["grasps"].values()
    assert 0.0 < entry["confidence"] < 1.0
