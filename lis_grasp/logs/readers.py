"""Readers of robots' logs: forces and poses over time, from ROS bags, MCAP and CSV files.

ROS 1 bags, ROS 2 bags and MCAP files are read by `logs._bag_log`, CSV tables by `logs._csv_log`.
"""

from __future__ import annotations

from pathlib import Path

from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.io.content_kinds import named_by_content
from lis_grasp.logs._bag_log import BagLog
from lis_grasp.logs._csv_log import CsvLog
from lis_grasp.logs._streams import (
    FrameTree,
    JointSeries,
    RobotLog,
    TimedForces,
    TimedPoses,
    Topic,
)
from lis_grasp.logs.reading import LogReading

__all__ = [
    "FrameTree",
    "JointSeries",
    "RobotLog",
    "TimedForces",
    "TimedPoses",
    "Topic",
    "open_log",
]


BAG_ENDINGS = (".bag", ".mcap", ".db3")
"""Endings of bags that are files."""


def open_log(path: Path, *, posed: bool = True, reading: LogReading = LogReading()) -> RobotLog:
    """Open a robot's log: .bag (ROS 1), .mcap, .db3 or a folder (ROS 2), or .csv.

    A table may lack the tip's columns unless it must be `posed`. `reading` has what the log does
    not say about itself.

    Raises
    ------
    InvalidInputError
        If a package is missing that reads the format, or it has no use for an option given.
    InvalidFileError
        If the file is missing, damaged, or of another format.
    """
    if not path.exists():
        raise InvalidFileError(f"cannot read {path}: no such file or folder", path=path)
    ending = path.suffix.lower()
    _require_used(path, ending == ".csv", reading)
    if ending == ".csv":
        return CsvLog(path, posed=posed, reading=reading)
    if path.is_dir() or ending in BAG_ENDINGS:
        with named_by_content(path):
            return BagLog(path, reading)
    raise InvalidFileError(
        "logs end in .bag, .mcap, .db3 or .csv, or are folders of ROS 2, and tactile patches end in"
        f" .npz; {path} is none of these",
        path=path,
    )


def _require_used(path: Path, is_table: bool, reading: LogReading) -> None:
    """Raise `InvalidOptionError` for an option that tables, or else bags, have no use for."""
    usual = LogReading()
    for name in ("clock", "joint_states") if is_table else ("orientation",):
        value = getattr(reading, name)
        if value != getattr(usual, name):
            kinds = ("a table", "bags") if is_table else ("a bag", "tables")
            raise InvalidOptionError(
                f"`{name}` is for {kinds[1]}; {path} is {kinds[0]}: leave it out",
                option=name,
                value=value,
            )
