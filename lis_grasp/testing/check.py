"""A check: one claim that a plug-in must meet, and what a failure says."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lis_grasp.exceptions import EstimationError, FailedCheckError, LisGraspError
from lis_grasp.plugins import errors_of

# Letters of failed claims' sentences in a message, beyond which other claims are only named.
_LETTERS = 600


@dataclass(frozen=True, slots=True)
class Claim:
    """What every plug-in of a kind must meet, and how its breach is found and cured."""

    name: str
    required: str
    """The end of "NAME must ..."."""
    cure: str
    """What to do if the claim is not met."""
    breach: Callable[[Any], str]
    """Returns what was found of a subject; empty if the claim is met."""


@dataclass(frozen=True, slots=True)
class Check:
    """One claim about one plug-in; a call raises `FailedCheckError` if it is not met.

    `str` of a check is its name, for the ids of pytest's parameters.

    Examples
    --------
    >>> for check in estimator_checks("lis")[:3]:
    ...     check()
    """

    claim: Claim
    subject: Any
    plugin: str
    """Name of what is checked."""

    def __str__(self) -> str:
        return self.claim.name

    def __call__(self) -> None:
        """Raise `FailedCheckError` with what was required, what came, and what to do."""
        try:
            # Threads change the order of sums.
            with threadpool_limits(1), errors_of(self.plugin, self.subject.made_by):
                found = self.claim.breach(self.subject)
        except LisGraspError as error:
            found = str(error)
        if found:
            claim = self.claim
            sentence = f"{self.plugin} must {claim.required}; {found}: {claim.cure}"
            raise FailedCheckError(
                f"{claim.name}: {sentence}", failures={claim.name: sentence}
            ) from None


class Claims:
    """The claims of one kind of plug-in, in the order in which they were added."""

    def __init__(self) -> None:
        self._claims: list[Claim] = []

    def add(self, required: str, cure: str) -> Callable[[Callable[[Any], str]], Callable[..., str]]:
        """Return the decorator that adds a function of a subject as a claim of its own name."""

        def added(breach: Callable[[Any], str]) -> Callable[[Any], str]:
            name = breach.__name__.removeprefix("_")
            self._claims.append(Claim(name, required, cure, breach))
            return breach

        return added

    def of(self, subject: Any, plugin: str) -> tuple[Check, ...]:
        """Return the checks of a subject."""
        return tuple(Check(claim, subject, plugin) for claim in self._claims)


@dataclass(frozen=True, slots=True, repr=False)
class HeldClaims:
    """The claims that were checked of a plug-in and hold; its `repr` counts them.

    Examples
    --------
    >>> check_policy("random")
    22 of 22 claims hold
    """

    plugin: str  #: name of what was checked
    claims: tuple[str, ...]  #: names of the checks, in their order

    def __repr__(self) -> str:
        return f"{len(self)} of {len(self)} claims hold"

    def __len__(self) -> int:
        return len(self.claims)

    def __iter__(self) -> Iterator[str]:
        return iter(self.claims)


def require_all(checks: Sequence[Check]) -> HeldClaims:
    """Carry out all checks of one plug-in; raise one `FailedCheckError` with every failure."""
    failures: dict[str, str] = {}
    for check in checks:
        try:
            check()
        except FailedCheckError as error:
            failures |= error.failures
    if failures:
        raise FailedCheckError(_summary(failures, len(checks)), failures=failures)
    return HeldClaims(checks[0].plugin, tuple(str(check) for check in checks))


def _summary(failures: Mapping[str, str], count: int) -> str:
    sentences = [f"{name}: {text}" for name, text in failures.items()]
    fit = max(int(np.count_nonzero(np.cumsum([len(text) for text in sentences]) <= _LETTERS)), 1)
    others = f"; also {', '.join(list(failures)[fit:])}" if len(failures) > fit else ""
    return f"{len(failures)} of {count} checks failed; {'; '.join(sentences[:fit])}{others}"


def plugin_name(plugin: object) -> str:
    """Return the name of what is checked, for messages."""
    return plugin if isinstance(plugin, str) else getattr(plugin, "__name__", type(plugin).__name__)


def draws_globally(work: Callable[[], object]) -> bool:
    """Return whether a call changes the global generators of NumPy or of Python."""
    before = pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002
    work()
    return before != pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002


def refused(work: Callable[[], object]) -> bool:
    """Return whether a call raises an error; an `EstimationError` is one, too."""
    try:
        work()
    except (EstimationError, Exception):  # noqa: BLE001 - a plug-in may raise anything
        return True
    return False
