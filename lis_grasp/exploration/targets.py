"""Places of the estimated surface that may be touched next, and what is known round each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.aiming import SAME_DIRECTION
from lis_grasp.exploration.motion_time import seconds_to_touch
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface, carved
from lis_grasp.typing import BoolArray, FloatArray

# A target is the same as an earlier one within this share of its gap, if their directions agree.
_SAME_TARGET = 0.4
# Where a tip passed and felt nothing there is no surface, within this share of a step.
_PASSED = 0.2
# Nor is there where any link passed, but for the last of its way to a touch; in steps.
_IN_FREE_SPACE = 0.05
# A surface that looks down more than this is not touched above a table (45 degrees).
_FROM_BELOW = -float(np.sqrt(0.5))
# A contact says nothing of a surface that faces away from it, as the far side of a thin wall does.
_FACES_AWAY = -0.5


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Points of an estimate that may be touched next.

    Parameters
    ----------
    points, normals
        Shapes (P, 3) [m] and (P, 3), unit and outward: of the estimate, all over the workspace.
    nearest, second
        Shape (P,) [m]: distance to the nearest and to the second contact on the point's side.
    emptiness
        Shape (P,) [m]: distance to where a tip passed and felt nothing.
    new
        Shape (P,): whether the point may be aimed at: no earlier target, no place found empty, nor
        in free space.
    step
        Distance between touches that is aimed at [m].
    seconds
        Shape (P,) [s]: what touching the point next would take.
    """

    points: FloatArray
    normals: FloatArray
    nearest: FloatArray
    second: FloatArray
    emptiness: FloatArray
    new: BoolArray
    step: float
    seconds: FloatArray

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
        """Return the targets that an estimate offers, as it is before free space is carved off."""
        points, normals = space.sample(surface, rng=rng)
        nearest, second = gaps(points, normals, contacts)
        emptiness = _distance_to_passed(points, outcomes)
        new = emptiness > _PASSED * space.step
        new &= carved(surface, contacts).evaluate(points) < _IN_FREE_SPACE * space.step
        if space.support_height is not None:  # nothing comes in from below a table
            new &= points[:, 2] > space.support_height + _PASSED * space.step
            new &= normals[:, 2] > _FROM_BELOW
        new &= ~_tried(points, normals, np.minimum(nearest, space.step), outcomes)
        seconds = seconds_to_touch(points, normals, space, outcomes)
        return cls(points, normals, nearest, second, emptiness, new, space.step, seconds)


def gaps(
    points: FloatArray, normals: FloatArray, contacts: Contacts
) -> tuple[FloatArray, FloatArray]:
    """Return each point's distance to the nearest and the second contact on its side, (P,) [m]."""
    apart = np.linalg.norm(points[:, None] - contacts.points, axis=-1)  # (P, N)
    apart[normals @ contacts.normals.T < _FACES_AWAY] = np.inf
    if len(contacts) == 1:
        return apart[:, 0], apart[:, 0]
    nearest = np.partition(apart, 1, axis=1)
    return nearest[:, 0], nearest[:, 1]


def _tried(
    points: FloatArray, normals: FloatArray, reach: FloatArray, outcomes: Sequence[ProbeOutcome]
) -> BoolArray:
    """Tell which points, shape (P,), were a target before, from about the same side."""
    targets = np.array([outcome.probe.target for outcome in outcomes])  # (K, 3)
    directions = np.array([outcome.probe.direction for outcome in outcomes])
    near = np.linalg.norm(points[:, None] - targets, axis=-1) < _SAME_TARGET * reach[:, None]
    return np.asarray(np.any(near & (-normals @ directions.T > SAME_DIRECTION), axis=1))


def _distance_to_passed(points: FloatArray, outcomes: Sequence[ProbeOutcome]) -> FloatArray:
    """Return each point's distance to where a tip passed and felt nothing, shape (P,) [m]."""
    distance = np.full(len(points), np.inf)
    for outcome in outcomes:
        if outcome.status == "missed":
            probe = outcome.probe
            along = (points - probe.target) @ probe.direction
            along = np.clip(along, -probe.standoff, probe.overshoot)
            passed = probe.target + along[:, None] * probe.direction
            distance = np.minimum(distance, np.linalg.norm(points - passed, axis=1))
    return distance
