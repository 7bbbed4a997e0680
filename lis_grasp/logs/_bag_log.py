"""Logs that are ROS bags or MCAP files, read by the pure-Python package `rosbags`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidFileError, InvalidInputError, needed_package, note
from lis_grasp.logs._streams import (
    Content,
    FrameTree,
    JointSeries,
    RobotLog,
    TimedForces,
    TimedPoses,
    Topic,
)
from lis_grasp.logs.reading import CLOCKS, LogReading
from lis_grasp.typing import FloatArray

# Message types by what they contain, without package folders: geometry_msgs/msg/Wrench.
CONTENT: Mapping[str, Content] = {
    "geometry_msgs/Wrench": "force",
    "geometry_msgs/WrenchStamped": "force",
    "geometry_msgs/Vector3Stamped": "force",
    "std_msgs/Float32": "force",
    "std_msgs/Float64": "force",
    "geometry_msgs/Pose": "pose",
    "geometry_msgs/PoseStamped": "pose",
    "geometry_msgs/PoseWithCovarianceStamped": "pose",
    "geometry_msgs/Transform": "pose",
    "geometry_msgs/TransformStamped": "pose",
    "nav_msgs/Odometry": "pose",
    "sensor_msgs/CameraInfo": "camera",
    "sensor_msgs/Image": "image",
    "sensor_msgs/JointState": "joints",
    "tf/tfMessage": "transforms",
    "tf2_msgs/TFMessage": "transforms",
}


# What a message has as its time, in the order of `CLOCKS`.
_CLOCKS = ("stamp in the header", "time of recording")
_Times = tuple[float, float]  # of a message by each clock [s]


class BagLog(RobotLog):
    """Forces and poses of a bag. Times are from the headers, or else from the recording."""

    unit_advice = "messages of ROS are in metres: scale their positions where they are written"

    def __init__(self, path: Path, reading: LogReading = LogReading()) -> None:
        """Open a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.

        Raises `InvalidInputError` if the package `rosbags` is not installed, and `InvalidFileError`
        if the file is missing, damaged, or not of its format.
        """
        self._path, self._reading = path, reading
        self._series: dict[str, list[JointSeries]] | None = None
        with self._reader() as reader:
            counts: dict[tuple[str, str], int] = defaultdict(int)
            for connection in reader.connections:
                counts[connection.topic, _short(connection.msgtype)] += connection.msgcount
        self.topics = tuple(
            Topic(name, kind, count, CONTENT.get(kind, "other"))
            for (name, kind), count in sorted(counts.items())
        )

    def forces(self, topic: str) -> TimedForces:
        """Return the forces of a topic (Wrench, Vector3 or Float), in time order."""
        stamps, rows, frame = [], [], ""
        for stamp, message in self._messages(topic, "force"):
            value = getattr(message, "wrench", message)
            value = getattr(value, "force", getattr(value, "vector", value))
            rows.append([value.data] if hasattr(value, "data") else _xyz(value))
            stamps.append(stamp)
            frame = _frame(message) or frame
        if len({len(row) for row in rows}) > 1:
            raise InvalidFileError(
                f"{self._path}: the topic {topic} has forces with and without directions",
                path=self._path,
            )
        forces = np.array(rows, np.float64).reshape(len(rows), len(rows[0]) if rows else 1)
        times = self._distinct_times(topic, stamps, forces)
        order = np.argsort(times, kind="stable")
        return TimedForces(times[order], forces[order], frame)

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of a topic (Pose, Transform or Odometry)."""
        stamps, rows, parent, child = [], [], self.base, ""
        for stamp, message in self._messages(topic, "pose"):
            stamps.append(stamp)
            rows.append(_pose(message))
            parent, child = _frame(message) or parent, getattr(message, "child_frame_id", child)
        poses = np.reshape(rows, (-1, 7))
        times = self._distinct_times(topic, stamps, poses)
        return TimedPoses.collect(times, poses, parent=parent, child=child, name=topic)

    def _read_frames(self) -> FrameTree:
        """Return the transforms of all topics of transforms (/tf, /tf_static)."""
        samples: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
        fixed = set()
        for topic in self.topics:
            if topic.content == "transforms":
                for (_, recorded), message in self._messages(topic.name, "transforms"):
                    for transform in message.transforms:
                        pair = _frame(transform), transform.child_frame_id.lstrip("/")
                        sample = [*_times(transform, recorded), *_pose(transform)]
                        if topic.name.endswith("tf_static"):  # the last one is valid at all times
                            samples[pair] = [sample]
                            fixed.add(pair)
                        else:
                            samples[pair].append(sample)
        tables = {pair: np.array(rows, np.float64) for pair, rows in samples.items()}
        once = [" to ".join(p) for p, rows in tables.items() if len(rows) == 1 and p not in fixed]
        if once:
            note(f"{self._path}: transforms seen once are taken as fixed: {', '.join(once)}")
        known, unknown = {}, {}
        for pair, table in tables.items():
            name, poses = " to ".join(pair), table[:, 2:]
            try:
                times = self._distinct_times(name, table[:, :2], poses)
                known[pair] = TimedPoses.collect(times, poses, *pair, name)
            except InvalidInputError as error:
                unknown[pair] = str(error)
        return FrameTree(known, unknown, self._named("transforms"))

    def joints(self, names: tuple[str, ...]) -> dict[str, list[JointSeries]]:
        """Return the positions of the logged joints.

        A source is a topic with the names that its messages share, which one publisher sends.
        """
        series = self._all_joints()
        return {name: series[name] for name in names if name in series}

    def joint_names(self) -> tuple[str, ...]:
        """Return the names of all joints, sorted."""
        joints = self._all_joints().items()
        return tuple(sorted(n for n, found in joints if not all(s.is_left_out for s in found)))

    def first(self, topic: str, content: Content) -> tuple[float, str, Any]:
        """Return the first message of a topic, its time [s], and the frame of its header.

        Raises `InvalidFileError` if the topic has no message.
        """
        for stamp, message in self._messages(topic, content):
            return stamp[self._clock], _frame(message), message
        raise InvalidFileError.of(self._path, f"has no message of the topic {topic}")

    def _named(self, content: Content) -> tuple[str, ...]:
        return tuple(topic.name for topic in self.topics if topic.content == content)

    def _all_joints(self) -> dict[str, list[JointSeries]]:
        if self._series is not None:
            return self._series
        topics = self._named("joints")
        chosen = topics if self._reading.joint_states is None else self._reading.joint_states
        if unknown := {*chosen} - {*topics}:
            raise InvalidInputError(
                f"joint_states must be a topic of joint states, {', '.join(topics) or 'none'}; it"
                f" is {', '.join(sorted(unknown))}"
            )
        samples: dict[tuple[str, str, frozenset[str]], list[tuple[float, float]]]
        samples = defaultdict(list)
        for topic in topics:
            for stamp, message in self._messages(topic, "joints"):
                publisher = frozenset(message.name)
                for name, position in zip(message.name, message.position, strict=False):
                    samples[name, topic, publisher].append((stamp[self._clock], float(position)))
        self._series = defaultdict(list)
        for (name, topic, _), rows in samples.items():
            times, positions = np.array(rows).T
            self._series[name].append(JointSeries(topic, times, positions, topic not in chosen))
        return self._series

    @property
    def _clock(self) -> int:
        return CLOCKS.index(self._reading.clock)

    def _distinct_times(self, name: str, stamps: npt.ArrayLike, values: FloatArray) -> FloatArray:
        """Return the times (N,) of values (N, K) by the chosen clock, of `stamps` (N, 2).

        Raises `InvalidInputError` if most times belong to several values.
        """
        by_clock = np.reshape(np.asarray(stamps, np.float64), (-1, 2)).T
        own, other = by_clock[self._clock], by_clock[1 - self._clock]
        order = np.argsort(own, kind="stable")
        same = np.diff(own[order]) == 0.0
        count = int((same & np.any(np.diff(values[order], axis=0) != 0.0, axis=1)).sum())
        if len(own) < 2 or 2 * count <= len(own):
            return own
        advice = f"give `clock` {CLOCKS[1 - self._clock]}"
        if 2 * len(np.unique(other)) < len(other):
            advice = f"the {_CLOCKS[1 - self._clock]} repeats too: record with finer times"
        raise InvalidInputError(
            f"{count} of {len(own)} messages of {name} in {self._path} differ from another with"
            f" the same {_CLOCKS[self._clock]}: {advice}"
        )

    def _messages(self, topic: str, content: Content) -> Iterator[tuple[_Times, Any]]:
        """Yield the times [s] and message of each message of a topic."""
        with self._reader() as reader:
            connections = [
                connection
                for connection in reader.connections
                if connection.topic == topic and CONTENT.get(_short(connection.msgtype)) == content
            ]
            try:
                for connection, nanoseconds, raw in reader.messages(connections):
                    message = reader.deserialize(raw, connection.msgtype)
                    yield _times(message, 1e-9 * nanoseconds), message
            except Exception:  # noqa: BLE001 - as in `_reader`
                raise self._damaged() from None

    def _reader(self) -> Any:
        with needed_package("rosbags", "ros", option=str(self._path)):
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        store = get_typestore(Stores.ROS2_HUMBLE)
        try:
            reader = AnyReader([self._path], default_typestore=store)
            reader.open()
        # 292 of 450 bags with cut or changed bytes raised errors of nine classes: three of rosbags,
        # UnicodeDecodeError, AssertionError, KeyError, OverflowError, MemoryError, and apsw's.
        except Exception:  # noqa: BLE001
            raise self._damaged() from None
        return closing(reader)

    def _damaged(self) -> InvalidFileError:
        reason, cure = "it is damaged, or of another format", "record or download it again"
        if self._path.is_dir() and not (self._path / "metadata.yaml").is_file():
            reason, cure = (
                "it has no metadata.yaml",
                "`ros2 bag reindex` writes one for a ROS 2 bag",
            )
        elif self._path.is_file() and not self._path.stat().st_size:
            reason = "it is empty"
        elif self._path.suffix == ".mcap":
            cure = "if the recording was cut off, `mcap recover` reads what is there"
        needed = "cannot be read as a ROS bag or MCAP file of ROS messages"
        return InvalidFileError.of(self._path, f"{needed} ({reason}): {cure}")


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return "" if header is None else str(header.frame_id).lstrip("/")


def _times(message: Any, recorded: float) -> _Times:
    """Return the header's time [s], if it is set, and that of the recording."""
    header = getattr(message, "header", None)
    stamp = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
    return stamp or recorded, recorded


def _pose(message: Any) -> FloatArray:
    """Return x y z qx qy qz qw of any message with a pose."""
    for name in ("pose", "pose", "transform"):  # Odometry has pose.pose
        message = getattr(message, name, message)
    point = message.position if hasattr(message, "position") else message.translation
    turn = message.orientation if hasattr(message, "orientation") else message.rotation
    return np.array([*_xyz(point), turn.x, turn.y, turn.z, turn.w], dtype=np.float64)


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]
