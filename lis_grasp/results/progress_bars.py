"""Progress of stages as bars of tqdm, in a terminal or a notebook."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from lis_grasp.exceptions import require_packages

_COUNTED = "{desc} |{bar:20}| {n_fmt}/{total_fmt} {elapsed}{postfix}"


class Bars:
    """Progress as one bar for each stage.

    Raises `InvalidOptionError` if tqdm is not installed.

    Examples
    --------
    >>> bars = pipeline.Bars()  # run("box", progress=bars) shows them
    """

    def __init__(self) -> None:
        require_packages("tqdm", extra="notebooks", option="progress")

    def stage(self, title: str) -> _Bar:
        """Return the bar of a stage, which is shown during its context."""
        return _Bar(title)

    def say(self, text: str) -> None:
        """Print one line above the bars."""
        from tqdm.auto import tqdm

        tqdm.write(text)


class _Bar:
    def __init__(self, title: str) -> None:
        self.result = ""
        self._title = title

    def __enter__(self) -> _Bar:
        from tqdm.auto import tqdm

        self._bar: Any = tqdm(desc=self._title, bar_format="{desc} {elapsed}{postfix}")
        return self

    def count(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        self._bar.bar_format = _COUNTED
        self._bar.total, self._bar.n = total, done
        self._bar.refresh()

    def note(self, text: str) -> None:
        """Print an event above the bars."""
        self._bar.write(f"{self._title}: {text}")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.set_postfix_str(self.result if kind is None else "failed", refresh=True)
        self._bar.close()
