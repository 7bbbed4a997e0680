"""The role of whatever chooses what to touch next, and the policies that aim at the estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import aiming, choices
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.targets import Targets
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray


class Policy(Protocol):
    """Chooses the next probe from everything known; keeps no state of its own.

    Equal knowledge and an equal generator give an equal probe, so that an exploration can be
    repeated, or taken up again from its log.
    """

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return the next probe, or None where no other is worth making.

        Parameters
        ----------
        contacts
            Felt so far, in O; may be empty.
        surface
            Estimated from these contacts, before free space is carved off: its walls are no places
            to touch. None as long as there are no contacts.
        outcomes
            Every probe so far and what came of it, in order.
        rng
            Decides between what is equally good.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TargetPolicy:
    """Touch next at a point of the estimated surface, chosen by one of `choices`.

    First come the six probes along the axes to the object's middle. Then the chosen target is
    approached against the estimated outward normal, and after a miss aslant, from beyond the edge
    that the missed probe must have crossed. A hollow that the estimate bridges, although a tip was
    in it, is touched from within. Targets probed before, and places that a tip passed through, are
    not tried again; where any link passed, there is no target. When the estimate offers nothing, a
    straight pass through the object's known box is drawn. All this is the same for every choice, so
    that choices can be compared.

    Parameters
    ----------
    space
        What is known of the object beforehand.
    choose
        Says which target is next.
    guess
        Estimates a surface that targets are sought on first, from at least one contact; None takes
        the exploration's own estimate. A Gaussian process closes what was not touched yet more
        cautiously than an estimate that is made of what was touched goes on. Once all of the guess
        is within a step of a contact, what the estimate in use has beyond that is put to the test.
    """

    space: Workspace
    choose: choices.Choice = choices.frontier
    guess: Callable[[Contacts], ImplicitSurface] | None = None

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe:
        """Return the next probe; see `Policy`. There always is one."""
        space = self.space
        if len(outcomes) < len(aiming.AXES):
            return aiming.opening(space, outcomes, rng)
        if surface is None or not len(contacts):
            return aiming.across(space, rng)
        sought = surface if self.guess is None else self.guess(contacts)
        sideways = aiming.from_within(space, contacts, sought, outcomes, rng)
        if sideways is not None:
            return sideways
        best = self._best(sought, contacts, outcomes, rng)
        if self.guess is not None and (best is None or best.gap <= space.step):
            own = self._best(surface, contacts, outcomes, rng)
            if own is not None and (best is None or own.gap > best.gap):
                best, sought = own, surface
        if best is None:
            return aiming.across(space, rng)
        return aiming.onto(best.point, best.normal, space, contacts, sought, outcomes)

    def _best(
        self,
        surface: ImplicitSurface,
        contacts: Contacts,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> _Target | None:
        targets = Targets.find(self.space, contacts, surface, outcomes, rng=rng)
        chosen = self.choose(targets, surface, rng=rng)
        if chosen is None:
            return None
        gap = float(targets.nearest[chosen])
        return _Target(targets.points[chosen], targets.normals[chosen], gap)


class _Target(NamedTuple):
    point: FloatArray
    normal: FloatArray
    gap: float  # to the nearest contact [m]


@dataclass(frozen=True, slots=True)
class PolicyKind:
    """A policy that the command line knows.

    Parameters
    ----------
    choose
        Says which target is next.
    guesses
        Whether targets are sought on a Gaussian process' surface, not on the estimate in use.
    """

    choose: choices.Choice
    guesses: bool = False


POLICIES: Mapping[str, PolicyKind] = MappingProxyType(
    {
        "spread": PolicyKind(choices.spread, guesses=True),
        "swift": PolicyKind(choices.swift, guesses=True),
        "frontier": PolicyKind(choices.frontier),
        "uncertainty": PolicyKind(choices.most_uncertain),
        "random": PolicyKind(choices.anywhere),
    }
)
"""Policies by name: ours, by touches and by time; the paper's; the greatest uncertainty; chance."""
