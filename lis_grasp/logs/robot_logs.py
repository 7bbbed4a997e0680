"""Robot logs: forces and poses over time, from ROS bags, MCAP and CSV files."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.logs.bag_logs import BagLog
from lis_grasp.logs.csv_logs import CsvLog
from lis_grasp.logs.log_streams import TimedForces, Topic
from lis_grasp.logs.timed_poses import FrameTree, TimedPoses


class RobotLog(Protocol):
    """Forces and poses of a log, by topic."""

    topics: tuple[Topic, ...]

    def forces(self, topic: str) -> TimedForces:
        """Return the forces of a topic."""

    def poses(self, topic: str) -> TimedPoses:
        """Return the poses of a topic."""

    def frames(self) -> FrameTree:
        """Return the transforms between frames of all transform topics."""


def open_log(path: Path) -> RobotLog:
    """Open a robot's log: .bag (ROS 1), .mcap, .db3 or a folder (ROS 2), or .csv.

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
        return CsvLog(path)
    if path.is_dir() or ending in (".bag", ".mcap", ".db3"):
        return BagLog(path)
    raise InvalidFileError(
        f"logs end in .bag, .mcap, .db3 or .csv, or are folders of ROS 2; {path} is none of these",
        path=path,
    )
