"""The configured robot station, in the frame of the contacts, and the arm's motion to a lift."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lis_grasp.arms.base_search import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.exploration import Exploration
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray


def make_station(
    config: RunConfig, hand: Hand, height: float, *, X_EA: FloatArray | None = None
) -> Station | None:
    """Return the configured station on a table of a height [m]; None without an arm.

    `X_EA` (4, 4) is the pose of the arm's base in the frame of the contacts, as recorded; None for
    the configured one.
    """
    if config.arm is None:
        return None
    arm, table = Arm.load(config.arm), Table(height)
    if X_EA is not None:
        return Station.make(arm, hand, X_EA, table=table)
    if config.base is None:
        return choose_base(arm, hand, table=table)
    return Station.make(arm, hand, base_at(config.base, height), table=table)


def base_at(place: Sequence[float], height: float) -> FloatArray:
    """Return the pose (4, 4) of an arm's base at x, y and z above a table of a height [m]."""
    X_WA = np.eye(4)
    X_WA[:3, 3] = place + np.array([0.0, 0.0, height])
    return X_WA


def station_after(station: Station | None, exploration: Exploration) -> Station | None:
    """Return a station in the frame of the contacts, which moved with the believed object."""
    beliefs = [outcome.tracked for outcome in exploration.outcomes if outcome.tracked is not None]
    return moved_frame(station, beliefs[-1].X_WE) if beliefs else station


def moved_frame(station: Station | None, X_EF: FloatArray) -> Station | None:
    """Return a station in a frame F that has the pose X_EF (4, 4) in the present one."""
    return None if station is None else station.moved(np.linalg.inv(X_EF) @ station.X_WA)


def station_facts(station: Station | None) -> dict[str, Any]:
    """Return the base in the frame of the contacts and the mount, as plain values."""
    if station is None:
        return {}
    return {"X_EA": station.X_WA.tolist(), "X_FB": station.mount.X_FB.tolist()}
