"""The time line of a page: touch by touch, then one candidate grasp after the other, then the lift.

Everything on the page is a function of a moment on this line and of the layers switched on; the
page's script (assets/story.js) reads the chapters that are written here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

# A touch lasts this long on the line, but all of them together no longer than that [s].
_SECONDS_A_TOUCH, _SECONDS_OF_TOUCHES = 0.5, 20.0
# To look at what the touches came to, before a hand comes in [s].
_PAUSE = 1.0
_SECONDS_A_GRASP = 1.4


@dataclass(frozen=True, slots=True)
class Chapter:
    """A part of the time line.

    Parameters
    ----------
    name
        "touch", "grasp" or "lift".
    label
        Its name on the page, plain text.
    start, end
        Where it lies on the time line [s]; it shows what happens after `start`, up to `end`.
    facts
        What else the page needs to know of it, as JSON.
    """

    name: str
    label: str
    start: float
    end: float
    facts: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Story:
    """The chapters of a scene, in order and without gaps; none where nothing changes.

    Parameters
    ----------
    chapters
        Each begins where the one before it ends; the first one at 0.
    """

    chapters: tuple[Chapter, ...] = ()

    @classmethod
    def of(
        cls, *, contacts: int, surfaces: Sequence[int], grasps: int, lift_seconds: float
    ) -> Story:
        """Return the story of what there is to show.

        Parameters
        ----------
        contacts
            How many there are; a single one is no story.
        surfaces
            After how many contacts there is a new estimate to see, increasing.
        grasps
            Candidates to show; shown from the worst to the best, which is the one that lifts.
        lift_seconds
            Duration of the lift [s]; 0 for none.
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
            add("grasp", "Grasp", grasps * _SECONDS_A_GRASP, step=_SECONDS_A_GRASP, grasps=grasps)
        if lift_seconds > 0.0:
            add("lift", "Lift", lift_seconds)
        changes = contacts > 1 or grasps > 1 or lift_seconds > 0.0
        return cls(tuple(chapters) if changes else ())

    @property
    def duration(self) -> float:
        """Length of the time line [s]; 0 where nothing changes."""
        return self.chapters[-1].end if self.chapters else 0.0

    @property
    def rest(self) -> float:
        """The moment that says most in one picture [s]: all that is known, and the best grasp."""
        still = [chapter.end for chapter in self.chapters if chapter.name != "lift"]
        return still[-1] if still else 0.0

    def chapter(self, name: str) -> Chapter:
        """Return the chapter of a name, which must be there."""
        return next(chapter for chapter in self.chapters if chapter.name == name)

    def facts(self) -> dict[str, Any]:
        """Return what the page's script needs to know, as JSON."""
        return {
            "duration": self.duration,
            "rest": self.rest,
            "chapters": [
                {"name": c.name, "start": c.start, "end": c.end, **c.facts} for c in self.chapters
            ],
        }
