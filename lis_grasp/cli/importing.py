"""Imports of a command: without garbage collection, and finished before an interrupt."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType, ModuleType

_AGAIN = 0.02  # [s] after which an interrupt during an import is raised again
_IMPORT = "<frozen importlib"  # begins the file name of importing code

# Objects created between garbage collections, by generation. Arrays, which use most of the memory,
# are not in cycles; Python's own threshold of 700 costs a twentieth of a run.
_GARBAGE_THRESHOLDS = (50_000, 20, 20)


def import_uncollected(load: Callable[[], ModuleType]) -> ModuleType:
    """Import a module without garbage collection, and collect rarely from then on.

    Objects that modules create stay alive.
    """
    gc.disable()
    try:
        return load()
    finally:
        _collect_rarely()
        gc.enable()


@cache  # once per process: frozen garbage stays for ever
def _collect_rarely() -> None:
    gc.freeze()
    gc.set_threshold(*_GARBAGE_THRESHOLDS)


@contextmanager
def interrupts_after_imports() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C, but not during an import, which is finished first.

    Libraries swallow an interrupt in their optional imports, or stay half imported and fail later.
    A handler that is not Python's own is left alone.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _is_importing(frame):
        main = threading.main_thread().ident
        timer = threading.Timer(_AGAIN, signal.pthread_kill, (main, number))
        timer.daemon = True
        timer.start()
        return
    signal.default_int_handler(number, frame)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(_IMPORT):
            return True
        frame = frame.f_back
    return False
