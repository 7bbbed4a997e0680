"""Time line of a scene page: touches, then candidate grasps from worst to best, then the lift.

The page (assets/story.js) shows a function of the time and of the visible layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

# Duration of one touch, and upper bound for all of them [s].
_SECONDS_A_TOUCH, _SECONDS_OF_TOUCHES = 0.5, 20.0
# Pause after the last touch [s].
_PAUSE = 1.0
_SECONDS_A_GRASP = 1.4


@dataclass(frozen=True, slots=True)
class Chapter:
    """Part of the time line; at its start [s] the page still shows the previous chapter."""

    name: str  # "touch", "grasp" or "lift"
    label: str  # on the page, plain text
    start: float
    end: float
    facts: dict[str, Any]  # further JSON values for the page


@dataclass(frozen=True, slots=True)
class Story:
    """Chapters of a scene in order, from time 0 and without gaps; none for a static scene."""

    chapters: tuple[Chapter, ...] = ()

    @classmethod
    def of(
        cls,
        *,
        contacts: int,
        surfaces: Sequence[int],
        grasps: int,
        planned: int | None = None,
        lift_seconds: float,
    ) -> Story:
        """Return the chapters of a scene with these numbers of contacts and grasps.

        A single contact has no chapter. `surfaces` are the numbers of contacts, increasing, at
        which the estimate changes. The best `grasps` of `planned` ones are shown; None if all are.
        `lift_seconds` is the duration of the lift [s]; 0 for none.
        """
        chapters: list[Chapter] = []

        def add(name: str, label: str, seconds: float, **facts: Any) -> None:
            start = chapters[-1].end if chapters else 0.0
            chapters.append(Chapter(name, label, start, round(start + seconds, 6), facts))

        if contacts > 1:
            step = round(min(_SECONDS_A_TOUCH, _SECONDS_OF_TOUCHES / contacts), 6)
            add("touch", "Touch", contacts * step + _PAUSE,
                step=step, contacts=contacts, surfaces=list(surfaces))  # fmt: skip
        if grasps > 0:
            add("grasp", "Grasp", grasps * _SECONDS_A_GRASP, step=_SECONDS_A_GRASP, grasps=grasps,
                planned=planned or grasps)  # fmt: skip
        if lift_seconds > 0.0:
            add("lift", "Lift", lift_seconds)
        changes = contacts > 1 or grasps > 1 or lift_seconds > 0.0
        return cls(tuple(chapters) if changes else ())

    @property
    def duration(self) -> float:
        """Length of the time line [s]; 0 for a static scene."""
        return self.chapters[-1].end if self.chapters else 0.0

    @property
    def rest(self) -> float:
        """Initial time of the page [s]: all contacts and the best grasp, before the lift."""
        still = [chapter.end for chapter in self.chapters if chapter.name != "lift"]
        return still[-1] if still else 0.0

    def facts(self) -> dict[str, Any]:
        """Return the time line as JSON for the page's script."""
        return {
            "duration": self.duration,
            "rest": self.rest,
            "chapters": [
                {"name": c.name, "start": c.start, "end": c.end, **c.facts} for c in self.chapters
            ],
        }
