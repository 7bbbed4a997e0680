"""Grasps as moveit_msgs/Grasp: the messages that ROS 2 makes of the file, without ROS."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from made_grasps import jaw_grasp
from ros_messages import STORE, received
from scipy.spatial.transform import Rotation

from lis_grasp import GraspSearch, Hand
from lis_grasp.geometry import make_pose
from lis_grasp.grasping.export import save_moveit_grasps


@pytest.mark.parametrize("X_FB", [None, make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.06])])
def test_ros_reads_each_grasp_with_the_parent_link_where_the_grasp_has_it(
    tmp_path: Path, X_FB: np.ndarray | None
) -> None:
    hand = Hand.load("wsg50")
    grasps = [jaw_grasp(hand, np.array([0.01, 0.02, height]), 0.05) for height in (0.0, 0.03)]
    path = tmp_path / "grasps.moveit.yaml"
    save_moveit_grasps(path, GraspSearch(tuple(grasps)), hand, name="mug", X_FB=X_FB)
    entries = yaml.safe_load(path.read_text())
    assert [entry["id"] for entry in entries] == ["grasp_0", "grasp_1"]
    for grasp, entry in zip(grasps, entries, strict=True):
        kind = "moveit_msgs/msg/Grasp"
        assert list(entry) == [name for name, _ in STORE.fielddefs[kind][1]]
        message = received(kind, entry)
        place, turn = message.grasp_pose.pose.position, message.grasp_pose.pose.orientation
        R = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        X_OF = make_pose(R, [place.x, place.y, place.z])
        X_OB = hand.forward_kinematics(grasp.X_OH, grasp.joint_positions)[hand.base_link]
        np.testing.assert_allclose(X_OF @ (np.eye(4) if X_FB is None else X_FB), X_OB, atol=1e-12)
        assert message.grasp_pose.header.frame_id == "mug"
        assert message.allowed_touch_objects == ["mug"]
        (point,) = message.grasp_posture.points
        assert tuple(message.grasp_posture.joint_names) == grasp.joint_names
        np.testing.assert_array_equal(point.positions, grasp.joint_positions)
        np.testing.assert_array_equal(
            message.pre_grasp_posture.points[0].positions, grasp.pregrasp_positions
        )
        ways = [message.pre_grasp_approach, message.post_place_retreat, message.post_grasp_retreat]
        vectors = [way.direction.vector for way in ways]
        expected = [grasp.approach_O, -grasp.approach_O, [0.0, 0.0, 1.0]]
        np.testing.assert_array_equal([[v.x, v.y, v.z] for v in vectors], expected)


def test_the_efforts_do_the_work_of_the_contact_forces(tmp_path: Path) -> None:
    # Virtual work: the efforts times a small motion of the joints are the forces times that of the
    # pads, which for a jaw's flat pads move as their centres do.
    hand = Hand.load("wsg50")
    grasp = jaw_grasp(hand, np.array([0.01, 0.02, 0.0]), 0.05)
    assert np.abs(grasp.contact_forces).max() > 0.0
    save_moveit_grasps(tmp_path / "g.yaml", GraspSearch((grasp,)), hand)
    (entry,) = yaml.safe_load((tmp_path / "g.yaml").read_text())
    efforts = np.array(entry["grasp_posture"]["points"][0]["effort"])
    centers = hand.pad_centers(grasp.X_OH, grasp.joint_positions)
    for joint, step in enumerate(1e-6 * np.eye(len(efforts))):
        moved = hand.pad_centers(grasp.X_OH, grasp.joint_positions + step) - centers
        pads = [hand.fingers.index(finger) for finger in grasp.contact_fingers]
        work = np.sum(grasp.contact_forces * moved[pads])
        assert efforts[joint] * 1e-6 == pytest.approx(work, rel=1e-6)
