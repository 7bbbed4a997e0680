"""Messages of ROS 2 without ROS: plain values as the messages of public definitions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra ros")

# Fields of the public message definitions (moveit_msgs 2.x).
_DEFINITIONS = {
    "moveit_msgs/msg/GripperTranslation": """
geometry_msgs/Vector3Stamped direction
float32 desired_distance
float32 min_distance
""",
    "moveit_msgs/msg/Grasp": """
string id
trajectory_msgs/JointTrajectory pre_grasp_posture
trajectory_msgs/JointTrajectory grasp_posture
geometry_msgs/PoseStamped grasp_pose
float64 grasp_quality
moveit_msgs/GripperTranslation pre_grasp_approach
moveit_msgs/GripperTranslation post_grasp_retreat
moveit_msgs/GripperTranslation post_place_retreat
float32 max_contact_force
string[] allowed_touch_objects
""",
}

STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
for _name, _text in _DEFINITIONS.items():
    STORE.register(typesys.get_types_from_msg(_text, _name))


def received(kind: str, content: dict[str, Any]) -> Any:
    """Return the message of plain values after it was sent; missing fields are zero or empty."""
    return STORE.deserialize_cdr(STORE.serialize_cdr(_message(kind, content), kind), kind)


def _message(kind: str, content: dict[str, Any]) -> Any:
    fields = dict(STORE.fielddefs[kind][1])
    assert set(content) <= set(fields), f"{kind} has no {set(content) - set(fields)}"
    return STORE.types[kind](**{n: _value(field, content.get(n)) for n, field in fields.items()})


def _value(field: Any, value: Any) -> Any:
    node, detail = field
    if node.name == "BASE":
        zero: Any = "" if detail[0] == "string" else 0
        value = zero if value is None else value
        assert isinstance(value, str if detail[0] == "string" else (int, float))
        return value
    if node.name == "NAME":
        return _message(detail, {} if value is None else value)
    (inner, name), _ = detail
    value = [] if value is None else value
    if inner.name == "NAME":
        return [_message(name, each) for each in value]
    return value if name[0] == "string" else np.array(value, dtype=name[0])
