"""Straight motions of the palm, tracked by an arm in joint space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.arms.station import Station
from lis_grasp.typing import BoolArray, FloatArray

STEP = 0.02
"""Largest distance between tracked poses of the palm [m]."""
JUMP = 0.35
"""Largest motion of a joint in one step [rad or m]; more is a jump to another branch."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """Joint positions that follow B straight motions."""

    q: FloatArray  # (B, S + 1, J): at the start, and after each of the S steps
    followed: BoolArray  # (B,): to the end, within limits and without a jump


def track(station: Station, q: FloatArray, X_WH: FloatArray, moved: FloatArray) -> Tracked:
    """Track straight motions of the palm without turning.

    Parameters
    ----------
    station
        The station.
    q
        Shape (B, J): joint positions at the start.
    X_WH
        Shape (B, 4, 4): the palm's poses there.
    moved
        Shape (3,) or (B, 3): translations in W [m].
    """
    moved = np.broadcast_to(moved, (len(q), 3))
    longest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    steps = max(int(np.ceil(longest / STEP)), 1)
    positions = np.repeat(np.asarray(q, np.float64)[:, None], steps + 1, axis=1)  # (B, S + 1, J)
    followed = np.ones(len(q), dtype=bool)
    for step in range(1, steps + 1):
        active = np.flatnonzero(followed)
        if not len(active):
            break
        target = X_WH[active].copy()
        target[:, :3, 3] += step / steps * moved[active]
        before = positions[active, step - 1]
        # Going on as before is near the next position.
        guess = before if step == 1 else 2.0 * before - positions[active, step - 2]
        found, solved = station.follow(station.arm.clipped(guess), target)
        positions[active, step:] = found[:, None]
        followed[active] = solved & (np.abs(found - before).max(axis=1) <= JUMP)
    return Tracked(positions, followed)
