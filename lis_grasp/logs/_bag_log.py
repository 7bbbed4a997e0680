"""Logs that are ROS bags or MCAP files, read by the pure-Python package `rosbags`."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidFileError, InvalidInputError, needed_package, note
from lis_grasp.logs._streams import (
    Content,
    FrameTree,
    JointSeries,
    TimedForces,
    TimedPoses,
    Topic,
)
from lis_grasp.logs.reading import Clock, LogReading
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
    "sensor_msgs/JointState": "joints",
    "tf/tfMessage": "transforms",
    "tf2_msgs/TFMessage": "transforms",
}


class BagLog:
    """Forces and poses of a bag. Times are from the headers, or else from the recording."""

    unused = ()
    reach = math.inf
    unit_advice = "messages of ROS are in metres: scale their positions where they are written"

    def __init__(self, path: Path, reading: LogReading = LogReading()) -> None:
        """Open a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.

        Raises `InvalidInputError` if the package `rosbags` is not installed, and `InvalidFileError`
        if the file is missing, damaged, or not of its format.
        """
        self._path, self._reading = path, reading
        self._frames: FrameTree | None = None
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
        times, rows, frame = [], [], ""
        for time, message in self._messages(topic, "force"):
            value = getattr(message, "wrench", message)
            value = getattr(value, "force", getattr(value, "vector", value))
            rows.append([value.data] if hasattr(value, "data") else _xyz(value))
            times.append(time)
            frame = _frame(message) or frame
        if len({len(row) for row in rows}) > 1:
            message = f"{self._path}: the topic {topic} has forces with and without directions"
            raise InvalidFileError(message, path=self._path)
        self._require_distinct(topic, times, rows)
        order = np.argsort(times, kind="stable")
        forces = np.array(rows, np.float64).reshape(len(rows), len(rows[0]) if rows else 1)
        return TimedForces(np.array(times)[order], forces[order], frame)

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of a topic (Pose, Transform or Odometry)."""
        times, rows, parent, child = [], [], "", ""
        for time, message in self._messages(topic, "pose"):
            times.append(time)
            rows.append(_pose(message))
            parent, child = _frame(message) or parent, getattr(message, "child_frame_id", child)
        self._require_distinct(topic, times, rows)
        return TimedPoses.collect(
            np.array(times), np.array(rows).reshape(-1, 7), parent=parent, child=child, name=topic
        )

    def frames(self) -> FrameTree:
        """Return the transforms of all topics of transforms (/tf, /tf_static), read once."""
        if self._frames is None:
            self._frames = self._read_frames()
        return self._frames

    def _read_frames(self) -> FrameTree:
        samples: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
        fixed = set()
        for topic in self.topics:
            if topic.content == "transforms":
                for time, message in self._messages(topic.name, "transforms"):
                    for transform in message.transforms:
                        pair = _ends(transform)
                        sample = [self._time(transform, time), *_pose(transform)]
                        if topic.name.endswith("tf_static"):  # the last one is valid at all times
                            samples[pair] = [sample]
                            fixed.add(pair)
                        else:
                            samples[pair].append(sample)
        tables = {pair: np.array(rows, np.float64) for pair, rows in samples.items()}
        once = [" to ".join(p) for p, rows in tables.items() if len(rows) == 1 and p not in fixed]
        if once:
            note(f"{self._path}: transforms seen once are taken as fixed: {', '.join(once)}")
        unknown = {}
        for pair, table in tables.items():
            if reason := self._repeated(" to ".join(pair), table[:, 0], table[:, 1:]):
                unknown[pair] = reason
        return FrameTree(
            {
                pair: TimedPoses.collect(table[:, 0], table[:, 1:], *pair, " to ".join(pair))
                for pair, table in tables.items()
                if pair not in unknown
            },
            unknown,
            tuple(topic.name for topic in self.topics if topic.content == "transforms"),
        )

    def joints(self, names: tuple[str, ...]) -> dict[str, list[JointSeries]]:
        """Return the positions of the logged joints.

        A source is a topic with the names that its messages share, which one publisher sends.
        """
        chosen = self._chosen_joints()
        series = {
            name: [s for s in self._all_joints().get(name, []) if s.source in chosen]
            for name in names
        }
        return {name: found for name, found in series.items() if found}

    def other_joints(self, names: tuple[str, ...]) -> dict[str, list[JointSeries]]:
        """Return the positions on topics of joint states that are not chosen."""
        chosen = self._chosen_joints()
        return {
            name: [s for s in self._all_joints().get(name, []) if s.source not in chosen]
            for name in names
        }

    def joint_names(self) -> tuple[str, ...]:
        """Return the names of all joints, sorted."""
        chosen = self._chosen_joints()
        joints = self._all_joints().items()
        return tuple(sorted(n for n, series in joints if any(s.source in chosen for s in series)))

    def other_readings(self) -> dict[str, BagLog]:
        """Return nothing: messages state their meaning."""
        return {}

    def _chosen_joints(self) -> set[str]:
        """Return the topics of joint states that are used."""
        topics = {topic.name for topic in self.topics if topic.content == "joints"}
        chosen = self._reading.joint_states
        if unknown := set(chosen or ()) - topics:
            raise InvalidInputError(
                f"joint_states must be a topic of joint states,"
                f" {', '.join(sorted(topics)) or 'none'}; it is {', '.join(sorted(unknown))}"
            )
        return topics if chosen is None else set(chosen)

    def _all_joints(self) -> dict[str, list[JointSeries]]:
        if self._series is not None:
            return self._series
        topics = [topic.name for topic in self.topics if topic.content == "joints"]
        samples: dict[tuple[str, str, frozenset[str]], list[tuple[float, float]]]
        samples = defaultdict(list)
        for topic in topics:
            for time, message in self._messages(topic, "joints"):
                publisher = frozenset(message.name)
                for name, position in zip(message.name, message.position, strict=False):
                    samples[name, topic, publisher].append((time, float(position)))
        self._series = defaultdict(list)
        for (name, topic, _), rows in samples.items():
            table = np.array(rows)
            self._series[name].append(JointSeries(topic, table[:, 0], table[:, 1]))
        return self._series

    def _time(self, message: Any, recorded: float) -> float:
        """Return the time of a message [s], by the chosen clock."""
        return (self._reading.clock == "header" and _stamp(message)) or recorded

    def _require_distinct(self, topic: str, times: list[float], rows: list[Any]) -> None:
        reason = self._repeated(topic, np.array(times), np.array(rows, np.float64))
        if reason:
            raise InvalidInputError(reason)

    def _repeated(self, name: str, times: FloatArray, values: FloatArray) -> str:
        """Return what is wrong if most times belong to several values; empty if nothing."""
        if len(times) < 2:
            return ""
        order = np.argsort(times, kind="stable")
        same = np.diff(times[order]) == 0.0
        count = int((same & np.any(np.diff(values[order], axis=0) != 0.0, axis=1)).sum())
        if 2 * count <= len(times):
            return ""
        clocks = {"header": "stamp in the header", "recording": "time of recording"}
        other: Clock = "recording" if self._reading.clock == "header" else "header"
        advice = f"give `clock` {other}"
        if self._is_repeated(name, other):
            advice = f"the {clocks[other]} repeats too: record with finer times"
        return (
            f"{count} of {len(times)} messages of {name} in {self._path} differ from another with"
            f" the same {clocks[self._reading.clock]}: {advice}"
        )

    def _is_repeated(self, name: str, clock: Clock) -> bool:
        """Return whether most times by a clock repeat, of a topic or of a transform."""
        log = copy(self)
        log._reading = replace(self._reading, clock=clock)
        content = {topic.name: topic.content for topic in self.topics}.get(name, "transforms")
        if content != "transforms":
            times = [time for time, _ in log._messages(name, content)]
        elif clock == "header":  # a transform has a stamp of its own
            return False
        else:
            times = [
                time
                for topic in self.topics
                if topic.content == "transforms"
                for time, message in log._messages(topic.name, "transforms")
                if any(" to ".join(_ends(each)) == name for each in message.transforms)
            ]
        return 2 * len(set(times)) < len(times)

    def _messages(self, topic: str, content: Content) -> Iterator[tuple[float, Any]]:
        """Yield the time [s] and message of each message of a topic."""
        with self._reader() as reader:
            connections = [
                connection
                for connection in reader.connections
                if connection.topic == topic and CONTENT.get(_short(connection.msgtype)) == content
            ]
            try:
                for connection, nanoseconds, raw in reader.messages(connections):
                    message = reader.deserialize(raw, connection.msgtype)
                    yield self._time(message, 1e-9 * nanoseconds), message
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
        message = f"{self._path} cannot be read as a ROS bag or MCAP file of ROS messages"
        return InvalidFileError(f"{message} ({reason}): {cure}", path=self._path)


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return "" if header is None else str(header.frame_id).lstrip("/")


def _ends(transform: Any) -> tuple[str, str]:
    """Return the parent and the child frame of a transform."""
    return _frame(transform), transform.child_frame_id.lstrip("/")


def _stamp(message: Any) -> float:
    """Return the header's time [s], or 0 where it is not set."""
    header = getattr(message, "header", None)
    return 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec


def _pose(message: Any) -> FloatArray:
    """Return x y z qx qy qz qw of any message with a pose."""
    for name in ("pose", "pose", "transform"):  # Odometry has pose.pose
        message = getattr(message, name, message)
    point = message.position if hasattr(message, "position") else message.translation
    turn = message.orientation if hasattr(message, "orientation") else message.rotation
    return np.array([*_xyz(point), turn.x, turn.y, turn.z, turn.w], dtype=np.float64)


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]
