"""Readers of robots' logs: forces and poses over time, from ROS bags, MCAP and CSV files.

ROS 1 bags, ROS 2 bags and MCAP files are read by the pure-Python package `rosbags`, CSV tables by
`logs._streams`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from lis_grasp.exceptions import InvalidFileError, needed_package
from lis_grasp.io.content_kinds import named_by_content
from lis_grasp.logs._streams import Content, CsvLog, FrameTree, TimedForces, TimedPoses, Topic
from lis_grasp.typing import FloatArray

# Message types by what they contain, without package folders: geometry_msgs/msg/Wrench.
_CONTENT: dict[str, Content] = {
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


class RobotLog(Protocol):
    """Forces and poses of a log, by topic."""

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics."""
        ...

    def forces(self, topic: str) -> TimedForces:
        """Return the forces of a topic."""

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of a topic."""

    def frames(self) -> FrameTree:
        """Return the transforms between frames of all transform topics."""

    def joints(self, names: tuple[str, ...]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return times (T,) [s] and positions (T,) [rad or m] of those joints that are logged."""


class BagLog:
    """Forces and poses of a bag. Times are those of the headers, or else of the recording."""

    def __init__(self, path: Path) -> None:
        """Open a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.

        Raises `InvalidInputError` if the package `rosbags` is not installed, and `InvalidFileError`
        if the file is missing, damaged, or not of its format.
        """
        self._path = path
        self._frames: FrameTree | None = None
        with self._reader() as reader:
            counts: dict[tuple[str, str], int] = defaultdict(int)
            for connection in reader.connections:
                counts[connection.topic, _short(connection.msgtype)] += connection.msgcount
        self.topics = tuple(
            Topic(name, kind, count, _CONTENT.get(kind, "other"))
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
        for topic in self.topics:
            if topic.content == "transforms":
                for time, message in self._messages(topic.name, "transforms"):
                    for transform in message.transforms:
                        pair = _frame(transform), transform.child_frame_id.lstrip("/")
                        sample = [_stamp(transform) or time, *_pose(transform)]
                        if topic.name.endswith("tf_static"):  # the last one is valid at all times
                            samples[pair] = [sample]
                        else:
                            samples[pair].append(sample)
        tables = {pair: np.array(rows, np.float64) for pair, rows in samples.items()}
        return FrameTree(
            {
                pair: TimedPoses.collect(table[:, 0], table[:, 1:], *pair, " to ".join(pair))
                for pair, table in tables.items()
            }
        )

    def joints(self, names: tuple[str, ...]) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return times (T,) [s] and positions (T,) [rad or m] of those joints that are logged."""
        samples: dict[str, list[tuple[float, float]]] = defaultdict(list)
        for topic in (topic.name for topic in self.topics if topic.content == "joints"):
            for time, message in self._messages(topic, "joints"):
                for name, position in zip(message.name, message.position, strict=False):
                    if name in names:
                        samples[name].append((time, float(position)))
        tables = {name: np.array(rows) for name, rows in samples.items()}
        return {name: (table[:, 0], table[:, 1]) for name, table in tables.items()}

    def _messages(self, topic: str, content: Content) -> Iterator[tuple[float, Any]]:
        """Yield the time [s] and message of each message of a topic."""
        with self._reader() as reader:
            connections = [
                connection
                for connection in reader.connections
                if connection.topic == topic and _CONTENT.get(_short(connection.msgtype)) == content
            ]
            try:
                for connection, nanoseconds, raw in reader.messages(connections):
                    message = reader.deserialize(raw, connection.msgtype)
                    yield _stamp(message) or 1e-9 * nanoseconds, message
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
        # Of 450 bags with cut or changed bytes 292 raised errors of nine classes: three of rosbags,
        # UnicodeDecodeError, AssertionError, KeyError, OverflowError, MemoryError, apsw's.
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
        message = f"{self._path} cannot be read as a ROS bag or MCAP file of ROS messages"
        return InvalidFileError(f"{message} ({reason}): {cure}", path=self._path)


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def _frame(message: Any) -> str:
    header = getattr(message, "header", None)
    return "" if header is None else str(header.frame_id).lstrip("/")


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


def open_log(path: Path, *, posed: bool = True) -> RobotLog:
    """Open a robot's log: .bag (ROS 1), .mcap, .db3 or a folder (ROS 2), or .csv.

    A table may lack the tip's columns if it need not be `posed`.

    Raises
    ------
    InvalidInputError
        If a package is missing that reads the format.
    InvalidFileError
        If the file is missing, damaged, or of another format.
    """
    if not path.exists():
        raise InvalidFileError(f"cannot read {path}: no such file or folder", path=path)
    ending = path.suffix.lower()
    if ending == ".csv":
        return CsvLog(path, posed=posed)
    if path.is_dir() or ending in (".bag", ".mcap", ".db3"):
        with named_by_content(path):
            return BagLog(path)
    raise InvalidFileError(
        "logs end in .bag, .mcap, .db3 or .csv, or are folders of ROS 2, and tactile patches end in"
        f" .npz; {path} is none of these",
        path=path,
    )
