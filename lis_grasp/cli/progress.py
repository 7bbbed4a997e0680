"""Progress messages on stderr, one line per stage."""

from __future__ import annotations

import contextlib
import os
import sys
import time

from lis_grasp.exceptions import OutputError


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
            complain(f"{self._title} ...", end="")
        return self

    def count(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        if self._live:
            complain(f"\r{self._title} ... {done}/{total}", end="")

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        outcome = self.result if kind is None else "failed"
        seconds = time.perf_counter() - self._start
        start = "\r" if self._live else ""
        complain(f"{start}{self._title}: {outcome} ({seconds:.1f} s)")


def say(text: str) -> None:
    """Print a line of the result on stdout; `OutputError` if it cannot be written."""
    try:
        print(text, flush=True)
    except OSError as error:
        # What is still buffered would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise OutputError(f"cannot write to standard output: {error.strerror}") from None


def complain(text: str, end: str = "\n") -> None:
    """Print on stderr; a message that cannot be written is no reason to stop."""
    with contextlib.suppress(OSError):
        print(text, end=end, file=sys.stderr, flush=True)


def open_missing_streams() -> None:
    """Open the null device in place of closed standard streams.

    Otherwise the next file gets the number of a closed stream, and with it what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
