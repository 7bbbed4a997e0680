"""The arm of a task: its base at the table, and the facts of both in headers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station
from lis_grasp.geometry import make_pose, require_pose
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.task.robot import Robot
from lis_grasp.typing import FloatArray
from lis_grasp.world import Table


def make_station(robot: Robot, hand: Hand, table: Table, X_EA: FloatArray | None) -> Station | None:
    """Return the station of a robot at a table; None without an arm."""
    if robot.arm is None:
        return None
    arm = Arm.load(robot.arm)
    if X_EA is not None:
        return Station.make(arm, hand, require_pose("X_EA", X_EA), table=table)
    if robot.base is None:
        return choose_base(arm, hand, table=table)
    return Station.make(arm, hand, base_at(robot.base, table.height), table=table)


def base_at(place: Sequence[float], height: float) -> FloatArray:
    """Return the pose (4, 4) of an arm's base at x, y and z above a table of a height [m]."""
    return make_pose(np.eye(3), place + np.array([0.0, 0.0, height]))


def station_facts(station: Station | None) -> dict[str, Any]:
    """Return the base in the frame of the contacts and the mount, as plain values."""
    if station is None:
        return {}
    return {"X_EA": station.X_WA.tolist(), "X_FB": station.mount.X_FB.tolist()}
