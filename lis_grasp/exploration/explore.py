"""The loop of touching, estimating and choosing again, and the record of how it went."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.probe import ProbeOutcome, Prober, ProbeStatus
from lis_grasp.surfaces import ImplicitSurface

# Two contacts closer than this are one contact felt twice [m].
_SAME_CONTACT = 1e-3
# Probes that an exploration may take, for each touch and on top, before it gives up.
_PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20


@dataclass(frozen=True, slots=True, eq=False)
class Exploration:
    """How an exploration went.

    Parameters
    ----------
    contacts
        What was felt, in O, without duplicates, and every place found free.
    outcomes
        Every probe and what came of it, in order.
    """

    contacts: Contacts
    outcomes: tuple[ProbeOutcome, ...]

    @property
    def touched(self) -> int:
        """Number of probes that felt something."""
        return self._count("touched")

    @property
    def missed(self) -> int:
        """Number of probes that went to their end and felt nothing."""
        return self._count("missed")

    @property
    def blocked(self) -> int:
        """Number of probes that could not be carried out."""
        return self._count("blocked")

    @property
    def duration(self) -> float:
        """Time that all probes took [s]."""
        return sum(outcome.duration for outcome in self.outcomes)

    def summary(self) -> str:
        """Return the counts in one line."""
        return (
            f"{_count(len(self.contacts), 'contact')} from {_count(len(self.outcomes), 'probe')}"
            f" ({self.touched} touched, {self.missed} missed, {self.blocked} blocked)"
        )

    def _count(self, status: ProbeStatus) -> int:
        return sum(outcome.status == status for outcome in self.outcomes)


def explore(
    prober: Prober,
    policy: Policy,
    estimate: Callable[[Contacts], ImplicitSurface],
    *,
    touches: int,
    rng: np.random.Generator,
    max_probes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Exploration:
    """Touch an object again and again, each time where the surface estimated so far suggests.

    Ends with `touches` contacts, or when the policy knows no further probe, or when `max_probes`
    are made: fewer contacts than asked for are a result, not an error.

    Parameters
    ----------
    prober
        Carries out probes.
    policy
        Chooses them.
    estimate
        Estimates the surface from at least one contact; done anew after every new contact.
    touches
        Contacts to make.
    rng
        Given to the policy.
    max_probes
        Probes to make at the most; None for a number that leaves room for misses.
    progress
        Called after every probe with the contacts made and those wanted.

    Raises
    ------
    InvalidOptionError
        If `touches` or `max_probes` is below 1.
    """
    if max_probes is None:
        max_probes = _PROBES_PER_TOUCH * touches + _SPARE_PROBES
    for name, value in (("touches", touches), ("max_probes", max_probes)):
        if value < 1:
            raise InvalidOptionError(f"{name} must be at least 1; it is {value}")
    contacts, surface = Contacts.empty(), None
    outcomes: list[ProbeOutcome] = []
    while len(contacts) < touches and len(outcomes) < max_probes:
        probe = policy.next_probe(contacts, surface, outcomes=outcomes, rng=rng)
        if probe is None:
            break
        outcome = prober.probe(probe)
        outcomes.append(outcome)
        new = _new_contacts(contacts, outcome)[: touches - len(contacts)]
        # What was free is told by the outcome; a prober may have it in its contacts as well.
        felt = replace(outcome.contacts.subset(new), free_points=outcome.free_points)
        contacts = contacts.append(felt)
        if len(new):
            surface = estimate(contacts)
        if progress is not None:
            progress(len(contacts), touches)
    return Exploration(contacts, tuple(outcomes))


def _new_contacts(known: Contacts, outcome: ProbeOutcome) -> npt.NDArray[np.intp]:
    """Return the rows of an outcome's contacts that coincide with no contact before them."""
    points = known.points
    rows = []
    for i, point in enumerate(outcome.contacts.points):
        if np.all(np.linalg.norm(points - point, axis=1) > _SAME_CONTACT):
            rows.append(i)
            points = np.vstack([points, point])
    return np.array(rows, dtype=np.intp)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
