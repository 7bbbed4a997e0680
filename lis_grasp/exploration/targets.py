"""Targets of the next touch: points of the estimated surface, and what is known around each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.motion_time import seconds_to_touch
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.probe_planning import SAME_DIRECTION
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface, carved
from lis_grasp.typing import BoolArray, FloatArray

# A target equals an earlier one within this fraction of its gap, if their directions agree.
_SAME_TARGET = 0.4
# There is no surface so near to the path of a tip that missed, in steps.
_FREE_RADIUS = 0.2
# Nor so deep in free space that any link passed, in steps: links end at the touch.
_IN_FREE_SPACE = 0.05
# Above a table, surface that faces down more than this (45 degrees) cannot be touched.
_FACES_DOWN = -float(np.sqrt(0.5))
# A contact does not count for surface that faces away from it, as on the far side of a thin wall.
_FACES_AWAY = -0.5


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Points of an estimate that may be touched next."""

    points: FloatArray  # (P, 3) [m]: samples of the estimate
    normals: FloatArray  # (P, 3), unit, outward
    nearest: FloatArray  # (P,) [m]: distance to the nearest contact on the point's side
    second: FloatArray  # (P,) [m]: distance to the second contact on the point's side
    free_distance: FloatArray  # (P,) [m]: distance to the path of a tip that missed
    eligible: BoolArray  # (P,): no earlier target, not in free space, and can be approached
    step: float  # wanted distance between touches [m]
    seconds: FloatArray  # (P,) [s]: time that touching the point next would take

    @classmethod
    def find(
        cls,
        space: Workspace,
        contacts: Contacts,
        surface: ImplicitSurface,
        outcomes: Sequence[ProbeOutcome],
        *,
        rng: np.random.Generator,
    ) -> Targets:
        """Return the targets of an estimate, given before free space is carved off."""
        points, normals = space.sample(surface, rng=rng)
        nearest, second = gaps(points, normals, contacts)
        free_distance = _distance_to_misses(points, outcomes)
        eligible = free_distance > _FREE_RADIUS * space.step
        eligible &= carved(surface, contacts).evaluate(points) < _IN_FREE_SPACE * space.step
        if space.support_height is not None:
            eligible &= points[:, 2] > space.support_height + _FREE_RADIUS * space.step
            eligible &= normals[:, 2] > _FACES_DOWN
        eligible &= ~_tried(points, normals, np.minimum(nearest, space.step), outcomes)
        seconds = seconds_to_touch(points, normals, space, outcomes)
        return cls(points, normals, nearest, second, free_distance, eligible, space.step, seconds)


def gaps(
    points: FloatArray, normals: FloatArray, contacts: Contacts
) -> tuple[FloatArray, FloatArray]:
    """Return each point's distance to the nearest and the second contact on its side, (P,) [m]."""
    distances = np.linalg.norm(points[:, None] - contacts.points, axis=-1)  # (P, N)
    distances[normals @ contacts.normals.T < _FACES_AWAY] = np.inf
    if len(contacts) == 1:
        return distances[:, 0], distances[:, 0]
    nearest = np.partition(distances, 1, axis=1)
    return nearest[:, 0], nearest[:, 1]


def _tried(
    points: FloatArray, normals: FloatArray, gap: FloatArray, outcomes: Sequence[ProbeOutcome]
) -> BoolArray:
    """Return which points, shape (P,), were a target before, from about the same side."""
    targets = np.array([outcome.probe.target for outcome in outcomes])  # (K, 3)
    directions = np.array([outcome.probe.direction for outcome in outcomes])
    near = np.linalg.norm(points[:, None] - targets, axis=-1) < _SAME_TARGET * gap[:, None]
    return np.asarray(np.any(near & (-normals @ directions.T > SAME_DIRECTION), axis=1))


def _distance_to_misses(points: FloatArray, outcomes: Sequence[ProbeOutcome]) -> FloatArray:
    """Return each point's distance to the path of a tip that missed, shape (P,) [m]."""
    distance = np.full(len(points), np.inf)
    for outcome in outcomes:
        if outcome.status == "missed":
            probe = outcome.probe
            along = (points - probe.target) @ probe.direction
            along = np.clip(along, -probe.standoff, probe.overshoot)
            path = probe.target + along[:, None] * probe.direction
            distance = np.minimum(distance, np.linalg.norm(points - path, axis=1))
    return distance
