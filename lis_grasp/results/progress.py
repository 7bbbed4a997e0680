"""Progress of stages: what a run reports while it works, and the time of each stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
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


@dataclass(slots=True)
class Stopwatch:
    """Wall time of each named stage [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the time of a block to `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start
