"""A ROS 2 bag of one depth view: an image, its camera, and the pose of the camera."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.views import DepthView

_TIME = 10**9


def write_camera_bag(path: Path, view: DepthView, encoding: str) -> Path:
    """Write Image, a colour Image, CameraInfo and /tf_static from `table` to `camera`."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def make(kind: str, *values: Any) -> Any:
        return store.types[kind](*values)

    def head(frame: str) -> Any:
        return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", 1, 0), frame)

    def image(encoding: str, values: np.ndarray) -> Any:
        rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
        padded = np.pad(rows, ((0, 0), (0, 3)))  # a step may be longer than its row
        size = values.shape[:2]
        step = padded.shape[1]
        return make(
            "sensor_msgs/msg/Image", head("camera"), *size, encoding, 0, step, padded.ravel()
        )

    known = np.nan_to_num(view.depth, nan=0.0, posinf=0.0)
    depths = {
        "16UC1": np.rint(1e3 * known).astype("<u2"),
        "32FC1": view.depth.astype("<f4"),
        "rgb8": np.zeros((*view.depth.shape, 3), np.uint8),
    }
    camera = view.intrinsics
    matrix = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    region = make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
    numbers = (np.zeros(5), np.array(matrix), np.eye(3).ravel(), np.zeros(12))
    size = view.depth.shape
    info = make(
        "sensor_msgs/msg/CameraInfo", head("camera"), *size, "plumb_bob", *numbers, 0, 0, region
    )
    turn = Rotation.from_matrix(view.X_WC[:3, :3]).as_quat()
    transform = make(
        "geometry_msgs/msg/Transform",
        make("geometry_msgs/msg/Vector3", *view.X_WC[:3, 3].tolist()),
        make("geometry_msgs/msg/Quaternion", *turn.tolist()),
    )
    stamped = make("geometry_msgs/msg/TransformStamped", head("table"), "camera", transform)
    messages = {
        "/camera/depth/image_rect_raw": image(encoding, depths[encoding]),
        "/camera/color/image_raw": image("rgb8", depths["rgb8"]),
        "/camera/depth/camera_info": info,
        "/camera/color/camera_info": info,
        "/tf_static": make("tf2_msgs/msg/TFMessage", [stamped]),
    }
    with rosbag2.Writer(path, version=8, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        for topic, message in messages.items():
            kind = message.__msgtype__
            connection = writer.add_connection(topic, kind, typestore=store)
            writer.write(connection, _TIME, store.serialize_cdr(message, kind))
    return path
