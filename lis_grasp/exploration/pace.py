"""Pace of touches of an object that may move: gentle until it resists one in their direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.exploration.probe import Pace, ProbeOutcome
from lis_grasp.typing import FloatArray

# Level directions of two pushes count as one if they are within 30 degrees, either way: a cylinder
# on its side resists along its axis, and rolls across it.
_SAME = float(np.cos(np.radians(30.0)))
# A push says what the object does in a level direction if as much of it is level.
_LEVEL = 0.5


def pace_of(direction: FloatArray, outcomes: Sequence[ProbeOutcome]) -> Pace:
    """Return the pace of a probe in a direction (3,) after the outcomes of earlier ones.

    It is quick where the object resisted and never yielded, tested where nothing is known, and
    gentle where it yielded. A steep probe shows nothing, and is quick if all touches were resisted.
    """
    level = float(np.hypot(*direction[:2]))
    is_steep = level < _LEVEL
    answers = {
        outcome.resisted
        for outcome in outcomes
        if outcome.resisted is not None
        and len(outcome.contacts)
        and (is_steep or _pushes_along(outcome, direction[:2] / level))
    }
    if not answers:
        return "gentle" if is_steep else "tested"
    return "quick" if answers == {True} else "gentle"


def _pushes_along(outcome: ProbeOutcome, along: FloatArray) -> bool:
    """Return whether a touch pushed the object along a level unit direction (2,), or back."""
    push = outcome.contacts.normals.mean(axis=0)[:2]
    level = float(np.linalg.norm(push))
    return level > _LEVEL and abs(float(push @ along)) > _SAME * level
