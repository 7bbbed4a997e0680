"""Progress messages on stderr, one line per stage."""

from __future__ import annotations

import sys
import time


class Stage:
    """Context manager that prints a stage's progress, and its `result` and time at the end.

    On a terminal the line counts the steps; elsewhere only the last line is printed.
    """

    def __init__(self, title: str) -> None:
        self.result = "done"
        self._title = title
        self._live = sys.stderr.isatty()
        self._start = 0.0

    def __enter__(self) -> Stage:
        self._start = time.perf_counter()
        if self._live:
            print(f"{self._title} ...", end="", file=sys.stderr, flush=True)
        return self

    def count(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        if self._live:
            print(f"\r{self._title} ... {done}/{total}", end="", file=sys.stderr, flush=True)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        outcome = self.result if kind is None else "failed"
        seconds = time.perf_counter() - self._start
        start = "\r" if self._live else ""
        print(f"{start}{self._title}: {outcome} ({seconds:.1f} s)", file=sys.stderr, flush=True)


def say(text: str) -> None:
    """Print a line of the result on stdout."""
    print(text, flush=True)
