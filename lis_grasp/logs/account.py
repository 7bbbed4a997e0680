"""Account of a log: the topics and columns of the contacts, and unused ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from lis_grasp.exceptions import listed
from lis_grasp.logs.readers import RobotLog


@dataclass(frozen=True, slots=True)
class LogAccount:
    """The used and the unused parts of a log.

    Attributes
    ----------
    used
        The topics or frames of forces, tips and the object, each with its use.
    unused
        Topics and columns that no contact depends on.
    """

    used: tuple[str, ...]
    unused: tuple[str, ...]

    def __str__(self) -> str:
        """Return one line."""
        rest = f"; not used: {listed(self.unused)}"
        return f"used: {'; '.join(self.used)}{rest if self.unused else ''}"


def account_of(log: RobotLog, used: Iterable[tuple[str, str, str]]) -> LogAccount:
    """Return the account of a log.

    Parameters
    ----------
    log
        The log.
    used
        Role, topic or frame, and use of each stream.
    """
    streams = list(dict.fromkeys(used))
    kinds = {topic.name: topic.type for topic in log.topics}
    lines = []
    for role, name, taken in streams:
        kind = f" ({kinds[name]})" if name in kinds else " (a frame)"
        lines.append(f"{role} {name}{kind}{f', {taken}' if taken else ''}")
    names = {name for _, name, _ in streams}
    if not names <= kinds.keys():
        sources = log.frames().sources
        lines.append(f"frames of {', '.join(sources)}")
        names |= set(sources)
    unused = (*(topic.name for topic in log.topics), *log.unused)
    return LogAccount(tuple(lines), tuple(name for name in unused if name not in names))
