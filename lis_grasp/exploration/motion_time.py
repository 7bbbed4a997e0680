"""Time of a probe's motion: approach, guarded motion, retreat, and transfer to the next probe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.typing import FloatArray

PROBE_SPEED = 0.1
"""Speed of a guarded motion, which may touch at any time [m/s]."""

TRANSIT_SPEED = 0.25
"""Speed of approach, retreat, and the transfer from one probe to the next [m/s]."""


def seconds_to_touch(
    points: FloatArray, normals: FloatArray, space: Workspace, outcomes: Sequence[ProbeOutcome]
) -> FloatArray:
    """Return the time that touching each of several points next would take, shape (P,) [s].

    The hand moves on a ball around the object to where its approach begins, approaches against the
    normal to a step before the point, moves on guarded, and retreats the same way.

    Points and outward unit normals have shapes (P, 3) [m] and (P, 3), in O. The last of `outcomes`
    with a motion tells where the hand is.
    """
    starts = points + space.step * normals
    approach = space.approach_distance(starts, -normals)
    touching = approach / TRANSIT_SPEED + space.step / PROBE_SPEED
    retreat = (approach + space.step) / TRANSIT_SPEED
    moved = [outcome.probe for outcome in outcomes if outcome.duration > 0.0]
    if not moved:
        return touching + retreat
    last = moved[-1]
    outside = last.start - space.approach_distance(last.start, last.direction) * last.direction
    transfer = transfer_seconds(outside, starts + approach[:, None] * normals, space)
    return touching + retreat + transfer


def transfer_seconds(start: FloatArray, ends: FloatArray, space: Workspace) -> FloatArray:
    """Return the times from a point (3,) to others (P, 3) on a ball around the object, (P,) [s]."""
    first, second = start - space.center, ends - space.center
    lengths = np.linalg.norm(first) * np.linalg.norm(second, axis=1)
    angles = np.arccos(np.clip(second @ first / np.maximum(lengths, 1e-12), -1.0, 1.0))
    return np.asarray(space.radius * angles / TRANSIT_SPEED)
