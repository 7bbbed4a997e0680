"""Efforts of a hand's joints: which are plausible, and usual ones."""

from __future__ import annotations

import math

# Largest effort of a hand's joint: N m of one that turns, N of one that slides.
_MOST = {"revolute": 100.0, "continuous": 100.0, "prismatic": 2000.0}
_USUAL = {"revolute": 1.0, "continuous": 1.0, "prismatic": 40.0}


def is_plausible_effort(kind: str, effort: float | None) -> bool:
    """Return whether an effort [N m or N] may be that of a hand's joint of this kind."""
    return effort is not None and math.isfinite(effort) and 0.0 < effort <= _MOST[kind]


def usual_effort(kind: str) -> float:
    """Return the effort [N m or N] of many hands' joints of this kind."""
    return _USUAL[kind]
