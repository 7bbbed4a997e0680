"""A simulated recording: a spherical tip touches a box that moves, seen by a force sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.typing import FloatArray

RADIUS = 0.006
HALF = np.array([0.04, 0.03, 0.05])
STIFFNESS = 20_000.0  # [N/m]: a millimetre per 20 N
RATE = 200.0
SAMPLES = 240  # of each touch
START = 1_700_000_000.0


@dataclass(frozen=True)
class Recording:
    """Samples over time; X is a pose as x y z qx qy qz qw."""

    times: FloatArray  # (T,)
    forces: FloatArray  # (T, 3) in the tip frame, on the tip
    X_WT: FloatArray  # (T, 7)
    X_WO: FloatArray  # (T, 7)
    points: FloatArray  # (N, 3) true contacts in O, in time order
    normals: FloatArray  # (N, 3)


def record(*, moving: bool = True, touches: int = 6, seed: int = 0) -> Recording:
    """Touch the faces of the box one after the other, obliquely, and retreat."""
    rng = np.random.default_rng(seed)
    path, points, normals = [], [], []
    for number in range(touches):
        axis, sign = number % 3, 1.0 if number % 2 else -1.0
        normal = np.zeros(3)
        normal[axis] = sign
        point = rng.uniform(-0.8, 0.8, size=3) * HALF
        point[axis] = sign * HALF[axis]
        across = np.cross(normal, rng.normal(size=3))
        approach = -normal + 0.4 * across / np.linalg.norm(across)
        depths = np.linspace(-0.03, 0.0003, SAMPLES // 2)
        depths = np.concatenate([depths, depths[::-1]])
        path.append(point + RADIUS * normal + depths[:, None] * approach)
        points.append(point)
        normals.append(normal)
    centers = np.vstack(path)  # (T, 3) in O
    times = np.arange(len(centers)) / RATE
    closest = np.clip(centers, -HALF, HALF)
    outward = centers - closest
    distances = np.linalg.norm(outward, axis=1)
    forces = STIFFNESS * np.maximum(RADIUS - distances, 0.0)[:, None] * outward
    forces /= np.maximum(distances, 1e-9)[:, None]
    drift = times[:, None] * [0.002, -0.001, 0.0] if moving else np.zeros((len(times), 3))
    spin = 0.05 * times if moving else np.zeros(len(times))
    R_WO = Rotation.from_rotvec((0.3 + spin)[:, None] * [0.0, 0.0, 1.0])
    p_WO = np.array([0.5, -0.2, 0.1]) + drift
    R_WT = Rotation.from_euler("xyz", np.column_stack([np.pi + 0 * times, 0.2 * times, 0.5 + spin]))
    return Recording(
        times=START + times,
        forces=(R_WT.inv() * R_WO).apply(forces),
        X_WT=np.hstack([p_WO + R_WO.apply(centers), R_WT.as_quat()]),
        X_WO=np.hstack([p_WO, R_WO.as_quat()]),
        points=np.array(points),
        normals=np.array(normals),
    )


def write_csv(recording: Recording, path: Path) -> Path:
    names = "time,fx,fy,fz,x,y,z,qx,qy,qz,qw,ox,oy,oz,oqx,oqy,oqz,oqw"
    table = np.hstack([recording.times[:, None], recording.forces, recording.X_WT, recording.X_WO])
    rows = [",".join(repr(float(value)) for value in row) for row in table]
    path.write_text("\n".join([names, *rows]) + "\n", encoding="utf-8")
    return path


def write_bag(
    recording: Recording,
    path: Path,
    kind: str,
    *,
    with_tf: bool = False,
    joints: dict[str, FloatArray] | None = None,
    others: Mapping[str, dict[str, FloatArray]] | None = None,
    resolution: float = 1e-9,
) -> Path:
    """Write the recording as ros1 (.bag), sqlite3 or mcap (a folder); see `rosbags`.

    `others` are joints of other publishers, by topic; stamps are cut to a `resolution` [s].
    """
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}
        for topic, stamp, message in sorted(
            _messages(recording, store, ros1, with_tf, joints, others or {}, resolution), key=_when
        ):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, message.__msgtype__, typestore=store
                )
            serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
            writer.write(connections[topic], stamp, serialize(message, message.__msgtype__))
    return path


def _when(item: tuple[str, int, Any]) -> int:
    return item[1]


def _messages(
    recording: Recording,
    store: Any,
    ros1: bool,
    with_tf: bool,
    joints: dict[str, FloatArray] | None,
    others: Mapping[str, dict[str, FloatArray]],
    resolution: float,
) -> Iterator[tuple[str, int, Any]]:
    types = store.types

    def make(name: str, *values: Any) -> Any:
        return types[name](*values)

    def vector(name: str, numbers: FloatArray) -> Any:
        return make(f"geometry_msgs/msg/{name}", *(float(number) for number in numbers))

    def mount(nanoseconds: int) -> tuple[str, int, Any]:
        unturned = vector("Quaternion", np.array([0.0, 0.0, 0.0, 1.0]))
        transform = make("geometry_msgs/msg/Transform", vector("Vector3", np.zeros(3)), unturned)
        tip = header(nanoseconds, "tip")
        each = make("geometry_msgs/msg/TransformStamped", tip, "finger", transform)
        return "/tf_static", nanoseconds, make("tf2_msgs/msg/TFMessage", [each])

    def header(nanoseconds: int, frame: str) -> Any:
        step = round(1e9 * resolution)
        cut = nanoseconds // step * step
        stamp = make("builtin_interfaces/msg/Time", *divmod(cut, 1_000_000_000))
        return make("std_msgs/msg/Header", *((0,) if ros1 else ()), stamp, frame)

    if with_tf:  # published again, as after a restart
        yield from (mount(round(1e9 * recording.times[i])) for i in (0, len(recording.times) // 2))
    for i, time in enumerate(recording.times):
        now = round(1e9 * time)
        zero = vector("Vector3", np.zeros(3))
        wrench = make("geometry_msgs/msg/Wrench", vector("Vector3", recording.forces[i]), zero)
        stamped = make("geometry_msgs/msg/WrenchStamped", header(now, "tip"), wrench)
        yield "/wrench", now, stamped
        if i % 2 and i % SAMPLES != SAMPLES - 1:  # poses at half the rate, but before each jump
            continue
        for frame, poses in (("tip", recording.X_WT), ("object", recording.X_WO)):
            point, turn = poses[i, :3], vector("Quaternion", poses[i, 3:])
            transform = make("geometry_msgs/msg/Transform", vector("Vector3", point), turn)
            each = make(
                "geometry_msgs/msg/TransformStamped", header(now, "/world"), frame, transform
            )
            if with_tf:
                yield "/tf", now, make("tf2_msgs/msg/TFMessage", [each])
            elif frame == "object":
                yield "/object", now, each
            elif joints is not None:
                positions = np.array([values[i] for values in joints.values()])
                none = np.zeros(0)
                state = header(now, ""), list(joints), positions, none, none
                yield "/joint_states", now, make("sensor_msgs/msg/JointState", *state)
                for topic, table in others.items():
                    later = now + 1_000_000
                    positions = np.array([values[i] for values in table.values()])
                    state = header(later, ""), list(table), positions, none, none
                    yield topic, later, make("sensor_msgs/msg/JointState", *state)
            else:
                pose = make("geometry_msgs/msg/Pose", vector("Point", point), turn)
                yield (
                    "/tip_pose",
                    now,
                    make("geometry_msgs/msg/PoseStamped", header(now, "world"), pose),
                )
