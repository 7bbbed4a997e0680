"""The ROS 2 node of the how-to, run without ROS: its messages are those of their definitions."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ros_messages import received

from lis_grasp import Hand

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "moveit.md"
BALL = 0.03  # [m], the radius of the object


def _stand_ins(published: list[tuple[str, str, Any]]) -> dict[str, ModuleType]:
    """Return modules in place of ROS's, whose messages are dictionaries with a kind."""

    def kind(package: str, name: str) -> type:
        return type(name, (dict,), {"kind": f"{package}/msg/{name}"})

    class Node:
        def __init__(self, name: str) -> None:
            self.name = name

        def create_publisher(self, kind: Any, topic: str, depth: int) -> Any:
            def publish(message: Any) -> None:
                assert isinstance(message, kind)
                published.append((topic, kind.kind, received(kind.kind, dict(message))))

            return SimpleNamespace(publish=publish)

        def create_subscription(self, kind: Any, topic: str, call: Any, depth: int) -> None:
            assert (kind.kind, topic) == ("geometry_msgs/msg/PointStamped", "~/contact")

    geometry = {name: kind("geometry_msgs", name) for name in ("PointStamped", "PoseArray")}
    content: dict[str, dict[str, Any]] = {
        "geometry_msgs.msg": geometry,
        "moveit_msgs.msg": {"Grasp": kind("moveit_msgs", "Grasp")},
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rosidl_runtime_py.set_message": {"set_message_fields": dict.update},
    }
    names = [*content, "geometry_msgs", "moveit_msgs", "rosidl_runtime_py"]
    modules = {name: ModuleType(name) for name in names}
    for name, attributes in content.items():
        vars(modules[name]).update(attributes)
    return modules


@pytest.mark.slow
def test_the_node_publishes_touches_and_then_grasps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = re.search(r":caption: touch_node.py\n(.*?)^```$", PAGE.read_text(), re.M | re.S)
    assert text is not None
    (tmp_path / "touch_node.py").write_text(text[1])
    command = tmp_path / "lis-grasp"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m lis_grasp.cli.main "$@"\n')
    command.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.chdir(tmp_path)
    published: list[tuple[str, str, Any]] = []
    for name, module in _stand_ins(published).items():
        monkeypatch.setitem(sys.modules, name, module)
    node_class = runpy.run_path("touch_node.py")["TouchNode"]
    options = ["--hand", "wsg50", "--center", "0", "0", "0", "--size", "0.06", "--support", "none"]
    node = node_class(options)
    try:
        while published[-1][0] == "~/next_touch" and len(published) < 60:
            poses = published[-1][2].poses
            places = [np.array([p.position.x, p.position.y, p.position.z]) for p in poses]
            direction = (places[2] - places[1]) / np.linalg.norm(places[2] - places[1])
            touch = node.ask()
            np.testing.assert_allclose(direction, touch["direction"], atol=1e-9)
            # The tip meets the ball on its way, or a sensor slips to its nearest point.
            start = np.array(touch["start"])
            along = -start @ direction
            across = np.linalg.norm(start + along * direction)
            point = start + (along - np.sqrt(max(BALL**2 - across**2, 0.0))) * direction
            point *= BALL / np.linalg.norm(point)
            node.on_contact(
                SimpleNamespace(point=SimpleNamespace(**dict(zip("xyz", point, strict=True))))
            )
    finally:
        node.service.communicate()
    grasps = [message for topic, kind, message in published if topic == "~/grasp"]
    assert grasps
    assert {message.grasp_pose.header.frame_id for message in grasps} == {"object"}
    hand = Hand.load("wsg50")
    assert tuple(grasps[0].grasp_posture.joint_names) == hand.joint_names
