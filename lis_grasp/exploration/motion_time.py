"""How long a hand takes: in from outside of the object, to a touch, back, and round to the next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.typing import FloatArray

PROBE_SPEED = 0.1
"""Of a guarded motion, which may touch at any time [m/s]."""

TRANSIT_SPEED = 0.25
"""On the way in, back out the same way, and from one probe to the next [m/s]."""


def seconds_to_touch(
    points: FloatArray, normals: FloatArray, space: Workspace, outcomes: Sequence[ProbeOutcome]
) -> FloatArray:
    """Return the time that touching each of several points next would take, shape (P,) [s].

    The hand goes round the object, on a ball about it, to where its way in begins; in against the
    normal to a step before the point; on in a guarded motion; and back out the same way.

    Parameters
    ----------
    points, normals
        Shapes (P, 3) [m] and (P, 3), unit and outward, in O.
    space
        Where the object is.
    outcomes
        Every probe so far: the last that the hand moved for says where it is.
    """
    starts = points + space.step * normals
    way_in = space.way_in(starts, -normals)
    touching = way_in / TRANSIT_SPEED + space.step / PROBE_SPEED
    back = (way_in + space.step) / TRANSIT_SPEED
    place = _outside(outcomes, space)
    if place is None:
        return touching + back
    return touching + back + _round(place, starts + way_in[:, None] * normals, space)


def motion_seconds(outcomes: Sequence[ProbeOutcome], space: Workspace) -> FloatArray:
    """Return the time from the first motion to the end of each probe, shape (len(outcomes),) [s].

    The ways between the probes included, which the durations of the outcomes are not of.
    """
    total, totals = 0.0, []
    for number, outcome in enumerate(outcomes):
        if outcome.duration > 0.0:
            here = _outside(outcomes[: number + 1], space)
            before = _outside(outcomes[:number], space)
            if here is not None and before is not None:
                total += float(_round(before, here[None], space)[0])
        total += outcome.duration
        totals.append(total)
    return np.array(totals)


def _outside(outcomes: Sequence[ProbeOutcome], space: Workspace) -> FloatArray | None:
    """Return where the way in of the last motion began, shape (3,); None before the first."""
    for outcome in reversed(outcomes):
        if outcome.duration > 0.0:
            start, direction = outcome.probe.start, outcome.probe.direction
            return np.asarray(start - space.way_in(start, direction) * direction)
    return None


def _round(place: FloatArray, others: FloatArray, space: Workspace) -> FloatArray:
    """Return the times from a place to others, shape (P, 3), on a ball about the object, (P,)."""
    first, second = place - space.center, others - space.center
    lengths = np.linalg.norm(first) * np.linalg.norm(second, axis=1)
    angles = np.arccos(np.clip(second @ first / np.maximum(lengths, 1e-12), -1.0, 1.0))
    return np.asarray(space.radius * angles / TRANSIT_SPEED)
