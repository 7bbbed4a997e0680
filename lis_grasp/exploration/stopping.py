"""Stop rules of an exploration: coverage, uncertainty, predicted success and time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Protocol, runtime_checkable

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_positive
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.targets import gaps
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.estimators import FEW_CONTACTS
from lis_grasp.typing import FloatArray

StopRule = Callable[[Contacts, ImplicitSurface, Sequence[ProbeOutcome]], "str | None"]
"""Returns the reason to stop, or None to continue, from contacts, estimate and outcomes."""

# Number of further contacts after which another grasp is planned.
_EVERY = 2
# Quantile of the surface that has to be certain: the rest is extrapolated out of the workspace.
_CERTAIN_QUANTILE = 0.95


@runtime_checkable
class StopRuleWithMemory(Protocol):
    """A stop rule that depends on earlier estimates too."""

    def __call__(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome], /
    ) -> str | None:
        """Return the reason to stop, or None to continue."""

    def noted(self, contacts: Contacts, surface: ImplicitSurface, /) -> StopRule:
        """Return the rule after another estimate; called once for each, before the check.

        The contacts are those that were touched, not seen.
        """


def stop_when_covered(fraction: float, space: Workspace | Region) -> StopRule:
    """Stop when a fraction, from 0 to 1, of the estimate is within a step of a contact.

    Surface that a table makes untouchable does not count, nor does it in `stop_when_certain`.

    Raises `InvalidOptionError` if the fraction is out of range.
    """
    if not 0.0 < fraction <= 1.0:
        raise InvalidOptionError.out_of_range("coverage", fraction, "above 0 and at most 1")

    def rule(
        contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        fitted = space.fitted_to(contacts)
        points, normals = _touchable_samples(fitted, surface)
        if not len(points):
            return None
        covered = float(np.mean(gaps(points, normals, contacts) <= fitted.step))
        if covered < fraction:
            return None
        return f"{100.0 * covered:.0f} % of the estimate is within a step of a contact"

    return rule


def stop_when_certain(deviation: float, space: Workspace | Region) -> StopRule:
    """Stop when 95 % of the estimate has at most a standard deviation along its normal [m].

    Raises `InvalidOptionError` if the deviation is not positive.
    """
    require_positive(uncertainty=deviation)

    def rule(
        contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        points, _ = _touchable_samples(space.fitted_to(contacts), surface)
        if not len(points):
            return None
        reached = float(np.quantile(surface.uncertainty(points), _CERTAIN_QUANTILE))
        if reached > deviation:
            return None
        return f"95 % of the estimate is certain to {1e3 * reached:.2g} mm"

    return rule


def stop_when_graspable(
    probability: float, predict: Callable[[Contacts], float], *, least: int = FEW_CONTACTS
) -> StopRule:
    """Stop when a grasp on the estimate is predicted to hold with a probability, from 0 to 1.

    `predict` plans a grasp on the estimate of contacts and returns its `closure_probability`. It is
    called from `least` touches on, for every second one. Two predictions in succession must reach
    the probability.

    Raises `InvalidOptionError` if the probability is out of range.
    """
    if not 0.0 < probability < 1.0:
        raise InvalidOptionError.out_of_range("success", probability, "above 0 and below 1")
    return _StopWhenGraspable(probability, predict, least - _EVERY, least - _EVERY)


def _nothing() -> float:
    return 0.0


@dataclass(frozen=True, slots=True)
class _StopWhenGraspable:
    probability: float
    predict: Callable[[Contacts], float]
    none_planned: int  # contacts before the first prediction may be made
    planned: int  # contacts at the last prediction
    is_new: bool = False  # whether there is a prediction for the last estimate
    # The last two predictions, made when they are used.
    before: Callable[[], float] = _nothing
    last: Callable[[], float] = _nothing

    def __call__(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        if not self.is_new or self.last() < self.probability or self.before() < self.probability:
            return None
        return f"with a probability of {self.last():.2f} the surface allows a grasp that holds"

    def noted(self, contacts: Contacts, surface: ImplicitSurface) -> _StopWhenGraspable:
        rule = self
        if len(contacts) < self.planned:  # the object was lost, and touching began again
            none = self.none_planned
            rule = _StopWhenGraspable(self.probability, self.predict, none, none)
        if len(contacts) < rule.planned + _EVERY:
            return replace(rule, is_new=False)
        last = cache(partial(self.predict, contacts))
        return replace(rule, planned=len(contacts), is_new=True, before=rule.last, last=last)


def _touchable_samples(space: Workspace, surface: ImplicitSurface) -> tuple[FloatArray, FloatArray]:
    """Return points and normals (P, 3) of an estimate, except at the table or facing it."""
    points, normals = space.sample(surface)
    chosen = space.touchable(points, normals)
    return points[chosen], normals[chosen]


def stop_after(seconds: float) -> StopRule:
    """Stop when the probes have taken this much of the robot's time [s].

    Raises `InvalidOptionError` if the time is not positive.
    """
    require_positive(max_seconds=seconds)

    def rule(
        contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        spent = sum(outcome.duration for outcome in outcomes)
        return f"{spent:.0f} s are spent" if spent >= seconds else None

    return rule
