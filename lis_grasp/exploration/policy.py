"""Exploration policies: the protocol, and policies that touch points of the estimated surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import target_selection
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_planning import (
    AXES,
    axis_probe,
    concavity_probe,
    random_pass,
    surface_probe,
)
from lis_grasp.exploration.target_selection import TargetSelector
from lis_grasp.exploration.targets import Targets
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray


class Policy(Protocol):
    """Chooses the next probe from everything known; keeps no state of its own.

    The same knowledge and generator give the same probe, so that an exploration can be repeated, or
    resumed from its log.
    """

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return the next probe, or None to end the exploration.

        Parameters
        ----------
        contacts
            All contacts so far, in O; may be empty.
        surface
            Estimated from these contacts, before free space is carved off: the walls that carving
            leaves must not be touched. None without contacts.
        outcomes
            Every probe so far and its outcome, in order.
        rng
            For every random draw.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TargetPolicy:
    """Touch a point of the estimated surface, selected by one of `target_selection`.

    The first six probes go along the axes to the object's centre. Later ones approach the selected
    target against the estimated outward normal; after a miss obliquely, from beyond the edge that
    the missed probe must have crossed. A concavity that the estimate bridges, although a tip passed
    through it, is touched from within. Earlier targets and free space are not targets. Without a
    target, a random line through the workspace is probed. All this is the same for every selector,
    so that selectors can be compared.

    Parameters
    ----------
    space
        Prior knowledge of the object.
    select
        Selects the next target.
    guess
        Estimates a surface, from at least one contact, on which targets are searched first; None
        for the exploration's own estimate. A Gaussian process closes untouched regions more
        cautiously than an estimate that extrapolates. Once all of this surface is within a step of
        a contact, the exploration's own estimate is searched too.
    """

    space: Workspace
    select: TargetSelector = target_selection.frontier
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
        if len(outcomes) < len(AXES):
            return axis_probe(space, outcomes, rng)
        if surface is None or not len(contacts):
            return random_pass(space, rng)
        searched = surface if self.guess is None else self.guess(contacts)
        sideways = concavity_probe(space, contacts, searched, outcomes, rng)
        if sideways is not None:
            return sideways
        best = self._target(searched, contacts, outcomes, rng)
        if self.guess is not None and (best is None or best.gap <= space.step):
            own = self._target(surface, contacts, outcomes, rng)
            if own is not None and (best is None or own.gap > best.gap):
                best, searched = own, surface
        if best is None:
            return random_pass(space, rng)
        return surface_probe(best.point, best.normal, space, contacts, searched, outcomes)

    def _target(
        self,
        surface: ImplicitSurface,
        contacts: Contacts,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> _Target | None:
        targets = Targets.find(self.space, contacts, surface, outcomes, rng=rng)
        i = self.select(targets, surface, rng=rng)
        if i is None:
            return None
        return _Target(targets.points[i], targets.normals[i], float(targets.nearest[i]))


class _Target(NamedTuple):
    point: FloatArray
    normal: FloatArray
    gap: float  # distance to the nearest contact [m]


@dataclass(frozen=True, slots=True)
class PolicyKind:
    """A policy that the command line names: how a target is selected, and on which surface."""

    select: TargetSelector
    uses_gaussian_process: bool = False  # targets are searched on its surface, not the estimate's


POLICIES: Mapping[str, PolicyKind] = MappingProxyType(
    {
        "spread": PolicyKind(target_selection.farthest, uses_gaussian_process=True),
        "swift": PolicyKind(target_selection.fastest, uses_gaussian_process=True),
        "frontier": PolicyKind(target_selection.frontier),
        "uncertainty": PolicyKind(target_selection.most_uncertain),
        "random": PolicyKind(target_selection.uniform),
    }
)
"""Policies by name; ``frontier`` is the paper's."""
