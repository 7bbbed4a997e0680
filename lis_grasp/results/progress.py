"""Progress of stages: what a run reports while it works, and a default that reports nothing."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class StageProgress(Protocol):
    """Progress of one stage, which ends with its context."""

    result: str
    """Result in words, for the end of the stage."""

    def count(self, done: int, total: int) -> None:
        """Report that `done` of `total` steps are done."""

    def note(self, text: str) -> None:
        """Report an event that changes the meaning of the counts."""


class Progress(Protocol):
    """Progress of a run. Steps of a stage are also messages to the logger ``lis_grasp``.

    Examples
    --------
    >>> with pipeline.SILENT.stage("Touching") as stage:
    ...     stage.count(1, 40)
    """

    def stage(self, title: str) -> AbstractContextManager[StageProgress]:
        """Report that a stage begins, and its end when the context ends."""

    def say(self, text: str) -> None:
        """Report one line: a finding, or a file that was removed."""


class _SilentStage:
    def __init__(self) -> None:
        self.result = ""

    def count(self, done: int, total: int) -> None:
        """Report nothing."""

    def note(self, text: str) -> None:
        """Report nothing."""


class _Silent:
    def stage(self, title: str) -> AbstractContextManager[StageProgress]:
        """Report nothing."""
        return nullcontext(_SilentStage())

    def say(self, text: str) -> None:
        """Report nothing."""


SILENT: Progress = _Silent()
"""Progress that reports nothing."""
