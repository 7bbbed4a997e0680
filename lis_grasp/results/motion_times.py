"""Times of a robot's motions in a run: by kind, until the object was lifted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lis_grasp.exploration import Exploration
from lis_grasp.stages.regrasp import Attempt

_SHOWN = 0.05  # shorter motions are left out of the sentence [s]


def motion_times(exploration: Exploration, attempts: Sequence[Attempt]) -> dict[str, Any]:
    """Return times of motions [s] as plain values: touching and lifting by kind, and two sums.

    Every attempt counts, and touches after a failed one (`touching_again`). `until_lifted` ends
    with the last rise of the hand, without the shake, which is a test; None if nothing was lifted.
    """
    touching: dict[str, float] = {}
    for outcome in exploration.outcomes:
        untold = {"other": outcome.duration} if outcome.duration else {}
        _add(touching, outcome.seconds or untold)
    _add(touching, {"home": exploration.homeward})
    lifting: dict[str, float] = {}
    for attempt in attempts:
        if attempt.outcome is not None:
            _add(lifting, attempt.outcome.seconds)
    again = sum(attempt.lesson.seconds for attempt in attempts if attempt.lesson is not None)
    total = sum(touching.values()) + sum(lifting.values()) + again
    last = attempts[-1].outcome
    until = None
    if last is not None and last.lifted and "lift" in last.seconds:
        rise = list(last.seconds).index("lift")
        until = total - sum(list(last.seconds.values())[rise + 1 :])
    return {
        "touching": touching,
        "touching_again": again,
        "lifting": lifting,
        "until_lifted": until,
        "total": total,
    }


def times_line(times: Mapping[str, Any]) -> str:
    """Return the sentence about `motion_times`."""
    until, kinds = times["until_lifted"], {**times["touching"]}
    kinds["touching again"] = times["touching_again"]
    parts = ", ".join(f"{kind} {s:.0f}" for kind, s in kinds.items() if s > _SHOWN)
    lifting = sum(times["lifting"].values())
    total = f"{times['total']:.0f} s" if until is None else f"{until:.0f} s until it was lifted"
    return f"motion    {total} (touching: {parts or 0}; lifts, tests and shake: {lifting:.0f})"


def _add(seconds: dict[str, float], more: Mapping[str, float]) -> None:
    for kind, time in more.items():
        seconds[kind] = seconds.get(kind, 0.0) + time
