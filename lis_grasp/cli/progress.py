"""Progress messages on stderr: a line for each stage, and its steps while it runs."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import shlex
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from lis_grasp.exceptions import OutputError

if TYPE_CHECKING:
    from lis_grasp.grasping.grasps import GraspSearch
    from lis_grasp.results.progress import Progress
    from lis_grasp.robots.hand_check import Finding

_LOG = logging.getLogger("lis_grasp")
_SILENCE = 10.0  # [s]
# Pattern of a field in the library's messages, and fields whose options have other names.
_FIELD = re.compile(r"`([a-z]+(?:_[a-z]+)*)`")
_FLAGS = {"folder": "output"}
_CLEAR = "\r\x1b[K"  # to the start of the line, and clear it


class Stage:
    """Context manager that prints a stage's progress, and its `result` and time at the end.

    On a terminal one line shows the last step of the stage and the time so far. Elsewhere a line is
    printed every ten seconds, so that a slow stage is not silent. Steps are messages to the logger
    ``lis_grasp``, at the level INFO.
    """

    def __init__(self, title: str) -> None:
        self.result = "done"
        self._title, self._step = title, ""
        self._live = sys.stderr.isatty()
        self._start = 0.0
        self._ended, self._ticking = threading.Event(), threading.Thread(target=self._tick)
        self._handler = _StepHandler(self._show_step)
        self._level = logging.NOTSET

    def __enter__(self) -> Stage:
        self._start = time.perf_counter()
        self._level = _LOG.level
        _LOG.addHandler(self._handler)
        _LOG.setLevel(logging.INFO)
        self._ticking.daemon = True
        self._ticking.start()
        if self._live:
            self._draw()
        return self

    def count(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        self._show_step(f"{done}/{total}")

    def note(self, text: str) -> None:
        """Print an event on a line of its own."""
        complain(f"{_CLEAR if self._live else ''}{self._title}: {text}")

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._ended.set()
        self._ticking.join()
        _LOG.removeHandler(self._handler)
        _LOG.setLevel(self._level)
        broken = "interrupted" if kind is KeyboardInterrupt else "failed"
        outcome = self.result if kind is None else broken
        start = _CLEAR if self._live else ""
        complain(f"{start}{self._title}: {outcome} ({self._seconds:.1f} s)")

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._start

    def _show_step(self, step: str) -> None:
        self._step = step
        if self._live:
            self._draw()

    def _tick(self) -> None:
        while not self._ended.wait(1.0 if self._live else _SILENCE):
            self._draw()

    def _draw(self) -> None:
        passed = f" ({self._seconds:.0f} s)" if self._seconds >= 1.0 else ""
        line = f"{self._title} ... {self._step}{passed}"
        if self._live:
            width = shutil.get_terminal_size().columns - 1
            complain(f"{_CLEAR}{line[:width]}", end="")
        else:
            complain(line)


class _StepHandler(logging.Handler):
    """Handler that passes on the text of each message."""

    def __init__(self, show: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        """Show a step."""
        self._show(record.getMessage())


def with_flags(text: str) -> str:
    """Return a message of the library with the options of the command line for the fields."""
    return _FIELD.sub(lambda field: f"--{_FLAGS.get(field[1], field[1]).replace('_', '-')}", text)


def say(text: str) -> None:
    """Print a line of the result on stdout, with options for the fields that it names.

    Raises `BrokenPipeError` if its reader has ended, `OutputError` if it cannot be written.
    """
    try:
        print(with_flags(text), flush=True)
    except OSError as error:
        # What is still buffered would fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if isinstance(error, BrokenPipeError):  # the reader wants no more
            raise
        raise OutputError(f"cannot write to standard output: {error.strerror}") from None


def next_step(text: str, *paths: Path | str) -> str:
    """Return advice on what to do next: paths replace ``{}`` or ``{0}``, as a shell reads them."""
    return f"next: {text.format(*(shlex.quote(str(path)) for path in paths))}"


class _Printed:
    """Progress of a run: stages on stderr, lines on stdout."""

    def stage(self, title: str) -> Stage:
        """Print that a stage begins, its steps and its end."""
        return Stage(title)

    def say(self, text: str) -> None:
        """Print one line."""
        say(text)


PRINTED: Progress = _Printed()
"""Progress that is printed."""


def say_search(search: GraspSearch) -> None:
    """Print the best grasp, or why there is none."""
    if search.grasps:
        best = search.grasps[0]
        fingers = ", ".join(best.contact_fingers)
        say(
            f"best grasp: predicted success {best.quality['success_probability']:.2f},"
            f" epsilon {best.quality['epsilon']:.3f}, {best.family.replace('_', ' ')} with"
            f" {fingers}"
        )
        return
    from lis_grasp.results.summary import REJECTIONS

    say("no grasp found; rejected candidates by reason:")
    for reason, count in sorted(search.rejections.items(), key=lambda item: -item[1]):
        if count:
            say(f"  {count:6d}  {REJECTIONS.get(reason, reason)} ({reason})")


def say_findings(findings: Iterable[Finding]) -> None:
    """Print one line for each finding, on stdout."""
    for finding in findings:
        say(f"{'ok  ' if finding.fine else 'FIX '}  {finding.text}")


def complain(text: str, end: str = "\n") -> None:
    """Print on stderr as `say` does; go on if it cannot be written."""
    with contextlib.suppress(OSError):
        print(with_flags(text), end=end, file=sys.stderr, flush=True)


def open_streams() -> None:
    """Open the null device in place of closed standard streams, and make every letter printable.

    Otherwise the next file gets the number of a closed stream, and with it what libraries print. A
    letter that the encoding of an output lacks is replaced, as in an ASCII locale.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        if isinstance(stream := getattr(sys, name), io.TextIOWrapper):
            stream.reconfigure(errors="replace")
