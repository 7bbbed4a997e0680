"""Fuzzing cases: an input made from (kind, seed, index), and the checks of its result.

The verdict on a case is one of three. *Accepted*: the result passes its checks. *Refused*: a
`LisGraspError` of one readable sentence. *Failed*: anything else, that is another exception, a
warning, a result that fails a check, an error on valid input, a hang, or a dead process.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lis_grasp.exceptions import LisGraspError

# A longer message is a dump of data.
_LONGEST_MESSAGE = 1000


class WrongResultError(AssertionError):
    """A result that fails a check."""


def require(fine: bool, claim: str) -> None:
    """Fail the case unless `fine`."""
    if not fine:
        raise WrongResultError(claim)


@dataclass(frozen=True)
class Case:
    """One input and the check of its result.

    Parameters
    ----------
    text
        Describes the input.
    check
        Runs the package on the input and checks the result.
    sound
        Whether the input is valid, so that it must not be refused.
    limit
        Processor time that the case may take [s].
    """

    text: str
    check: Callable[[], None]
    sound: bool = False
    limit: float = 10.0


@dataclass(frozen=True)
class Kind:
    """A kind of cases.

    Parameters
    ----------
    groups
        Groups of cases, counted separately; index modulo their number chooses the group.
    make
        Makes a case from its group, index and random generator; files go to the folder.
    """

    groups: tuple[str, ...]
    make: Callable[[str, int, np.random.Generator, Path], Case]

    def group(self, index: int) -> str:
        return self.groups[index % len(self.groups)]


def case_of(name: str, kinds: Mapping[str, Kind], seed: int, index: int, folder: Path) -> Case:
    """Return a case, which depends only on its kind, seed and index."""
    rng = np.random.default_rng([seed, list(kinds).index(name), index])
    kind = kinds[name]
    with np.errstate(all="ignore"):
        return kind.make(kind.group(index), index, rng, folder)


def verdict_of(case: Case) -> tuple[str, str]:
    """Run a case; return "accepted", "refused CLASS" or "failed CLASS", and the message."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        verdict, message = _verdict(case)
    if caught and not verdict.startswith("failed"):
        first = caught[0]
        place = f"{Path(first.filename).name}:{first.lineno}"
        return f"failed {first.category.__name__}", f"{place}: {first.message} ({verdict})"
    return verdict, message


def _verdict(case: Case) -> tuple[str, str]:
    try:
        case.check()
    except LisGraspError as error:
        message = str(error)
        if case.sound:
            return "failed SoundInputRefused", f"{type(error).__name__}: {message}"
        if not message or "\n" in message or len(message) > _LONGEST_MESSAGE:
            return "failed UnreadableMessage", f"{len(message)} characters: {message[:200]!r}"
        return f"refused {type(error).__name__}", message
    # Any other exception is a finding.
    except Exception as error:  # noqa: BLE001
        return f"failed {type(error).__name__}", _where(error)
    return "accepted", ""


def _where(error: BaseException) -> str:
    """Return the error's message and the innermost line of the package in its traceback."""
    place, trace = "", error.__traceback__
    while trace is not None:
        file = Path(trace.tb_frame.f_code.co_filename)
        if "lis_grasp" in file.parts:
            place = f"{file.name}:{trace.tb_lineno}: "
        trace = trace.tb_next
    return place + " ".join(str(error).split())[:200]
