"""Exploration policies: choice of the next touch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.calibrating import calibrating_target
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.extent import extent_probe, since_first_contact
from lis_grasp.exploration.neighbours import Neighbours
from lis_grasp.exploration.observations import Landmark
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import (
    axis_probe,
    concavity_probe,
    is_flat,
    random_pass,
    surface_probe,
)
from lis_grasp.exploration.region import Region, search_probe
from lis_grasp.exploration.targets import Targets
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import AXES
from lis_grasp.plugins import Guarded, Registry, errors_of, misfit
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray


class Policy(Protocol):
    """Chooses the next probe from everything known; keeps no state of its own.

    The same knowledge and generator give the same probe.
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

        `contacts`, in O, are all so far. `surface` is estimated from them (None without contacts)
        before free space is removed. `outcomes` are those of every probe so far, in order. Draw
        random numbers from `rng`.
        """
        ...


@runtime_checkable
class AvoidingPolicy(Policy, Protocol):
    """A policy that chooses targets where known bodies beside the object leave room."""

    def avoiding(self, neighbours: Neighbours) -> AvoidingPolicy:
        """Return the policy between these bodies."""
        ...


TargetSelector = Callable[..., "int | None"]
"""Returns the index of the next target, or None to select none; called as `frontier`."""


def frontier(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select the target whose distance from the nearest contact is most like a step.

    Ottenhaus et al. 2016, section IV.B, give the step (50 mm on objects of 20 cm) and derive the
    next target from the contacts and the estimated surface; the rest is ours.
    """
    return _best(targets, -np.abs(targets.nearest - targets.step))


def farthest(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select the target farthest from any contact on its side.

    Farthest-first traversal: its gaps are at most twice those of the best placement of the touches
    (Gonzalez 1985).
    """
    return _best(targets, targets.nearest)


def most_uncertain(
    targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator
) -> int | None:
    """Select the target with the greatest standard deviation of the estimate.

    With a Gaussian process this is the usual active learning rule of tactile exploration (Yi et al.
    2016; Jamali et al. 2016).
    """
    eligible = np.flatnonzero(targets.eligible)
    if not len(eligible):
        return None
    return int(eligible[np.argmax(surface.uncertainty(targets.points[eligible]))])


def uniform(targets: Targets, surface: ImplicitSurface, *, rng: np.random.Generator) -> int | None:
    """Select a target uniformly at random."""
    eligible = np.flatnonzero(targets.eligible)
    return int(rng.choice(eligible)) if len(eligible) else None


def _best(targets: Targets, score: FloatArray) -> int | None:
    eligible = np.flatnonzero(targets.eligible)
    return int(eligible[np.argmax(score[eligible])]) if len(eligible) else None


@dataclass(frozen=True, slots=True, eq=False)
class TargetPolicy:
    """Touch a point of the estimated surface, selected by a `TargetSelector`.

    The first six probes go along the axes to the object's centre (five above a table), unless there
    are contacts before the first touch. Later ones approach the selected target against the
    estimated outward normal; after a miss obliquely, from beyond the edge that the missed probe
    must have crossed. A concavity that a tip passed through, but that the estimate bridges, is
    touched from within. After a view, surface that shows where the camera was comes first
    (`calibrating_target`). Earlier targets and free space are not targets. Without a target, a
    random line through the workspace is probed. This is the same for every selector, so that
    selectors can be compared.

    Parameters
    ----------
    space
        Prior knowledge of the object.
    select
        Selects the next target.
    guess
        Estimates a surface, from at least one contact, on which targets are searched first; None
        for the exploration's own estimate, as after a view. A Gaussian process closes untouched
        regions more cautiously than an estimate that extrapolates. Once all of this surface is
        within a step of a contact, the exploration's own estimate is searched too. On a flat object
        on a table it always is, because level motions show how far it extends.
    neighbours
        Known bodies beside the object: surface near them is no target. None without any.
    """

    space: Workspace
    select: TargetSelector = frontier
    guess: Callable[..., ImplicitSurface] | None = None
    neighbours: Neighbours | None = None

    def avoiding(self, neighbours: Neighbours) -> TargetPolicy:
        """Return the policy between these bodies."""
        return replace(self, neighbours=neighbours)

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe:
        """Return the next probe; see `Policy`. There always is one."""
        known = contacts if surface is None else DeferredEstimate.of(surface, contacts).contacts
        space = self.space.fitted_to(known)
        made = sum(len(outcome.contacts) for outcome in outcomes)
        if len(outcomes) < len(AXES) and len(contacts) <= made:
            opening = axis_probe(space, outcomes, rng)
            if opening is not None:
                return replace(opening, purpose="extent")
        if surface is None or not len(contacts):
            return random_pass(space, rng)
        own = searched = DeferredEstimate.of(surface, contacts)
        place = self._calibrating(space, own, contacts, outcomes)
        if place is not None:
            return surface_probe(*place, space, contacts, own, outcomes)
        guess = None if len(own.prior.seen) else self.guess
        if guess is not None:
            searched = own.derived("guess", None, lambda: DeferredEstimate(guess, known))
        sideways = concavity_probe(space, contacts, searched, outcomes, rng)
        if sideways is not None:
            return sideways
        best = self._target(space, searched, contacts, outcomes, rng)
        flat = is_flat(contacts, space)
        if guess is not None and (flat or best is None or best[2] <= space.step):
            other = self._target(space, own, contacts, outcomes, rng)
            if other is not None and (best is None or other[2] > best[2]):
                best, searched = other, own
        if best is None:
            return random_pass(space, rng)
        point, normal, _ = best
        return surface_probe(point, normal, space, contacts, searched, outcomes)

    def _calibrating(
        self,
        space: Workspace,
        own: DeferredEstimate,
        contacts: Contacts,
        outcomes: Sequence[ProbeOutcome],
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return a place of seen surface to touch first, and its normal; None if none is needed."""
        made = sum(len(outcome.contacts) for outcome in outcomes)
        if not len(own.prior.seen):
            return None
        targets = Targets.find(space, contacts, own, outcomes, self.neighbours)
        i = calibrating_target(targets, own.prior.seen, made)
        return None if i is None else (targets.points[i], targets.normals[i])

    def _target(
        self,
        space: Workspace,
        surface: ImplicitSurface,
        contacts: Contacts,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, float] | None:
        """Return the selected target, its normal, and its distance to the nearest contact [m]."""
        targets = Targets.find(space, contacts, surface, outcomes, self.neighbours)
        i = self.select(targets, surface, rng=rng)
        return None if i is None else (targets.points[i], targets.normals[i], targets.nearest[i])


@dataclass(frozen=True, slots=True)
class PolicyKind:
    """A policy that the command line names: how a target is selected, and on which surface."""

    select: TargetSelector
    uses_gaussian_process: bool = False  # search its surface for targets


POLICIES: Mapping[str, PolicyKind] = MappingProxyType(
    {
        "spread": PolicyKind(farthest, uses_gaussian_process=True),
        "frontier": PolicyKind(frontier),
        "uncertainty": PolicyKind(most_uncertain),
        "random": PolicyKind(uniform),
    }
)
"""Policies by name; ``frontier`` is the paper's."""

POLICY_NAMES = Registry("policy", POLICIES)
"""Exploration policies: the package's own kinds, or functions from `Workspace` to `Policy`."""


def find_policy(name: str, space: Workspace) -> Policy:
    """Return a plugged-in policy by its name for one workspace.

    Raises
    ------
    InvalidOptionError
        If there is none, or it is no policy.
    PluginError
        If it raises an error.
    """
    make = POLICY_NAMES.find(name)

    def call() -> Any:
        with errors_of(name, make):
            return make(space)

    policy = made_policy(make, name, call)
    return cast(Policy, Guarded(name, policy, {"next_probe": (Probe, type(None))}))


def made_policy(make: Any, name: str, call: Callable[[], Any]) -> Policy:
    """Return the policy that `call` makes by a function of workspaces.

    Raises `InvalidOptionError` if `make` is no such function, or makes no policy.
    """
    require_policy_maker(make, name)
    policy = call()
    if not callable(getattr(policy, "next_probe", None)):
        raise _no_policy(name, f"it makes a {type(policy).__name__}, which has none")
    return cast(Policy, policy)


def require_policy_maker(make: Any, name: str) -> None:
    """Raise `InvalidOptionError` if an object is no function of a workspace."""
    wrong = misfit(make) if callable(make) else f"it is of type {type(make).__name__}"
    if wrong:
        raise _no_policy(name, wrong)


def _no_policy(name: str, wrong: str) -> InvalidOptionError:
    return InvalidOptionError(
        f"policy '{name}' must make an object with next_probe from a Workspace; {wrong}",
        option="policy",
        value=name,
    )


@dataclass(frozen=True, slots=True, eq=False)
class RegionPolicy:
    """Find an object in a region, and explore it in the workspace shown by its contacts.

    Until the first contact, it searches (`search_probe`). Then it finds the height and the ends of
    the object (`extent_probe`). After that, a policy for the workspace of these contacts
    chooses.

    Parameters
    ----------
    region
        What is known before the first touch.
    make
        Makes the policy of a workspace.
    landmarks
        Contacts that were touched before the first probe, beyond which the extent is sought again;
        it is not sought where a camera has seen the object.
    neighbours
        Known bodies beside the object; None without any.
    """

    region: Region
    make: Callable[[Workspace], Policy]
    landmarks: Sequence[Landmark] = ()
    neighbours: Neighbours | None = None

    def avoiding(self, neighbours: Neighbours) -> RegionPolicy:
        """Return the policy between these bodies."""
        return replace(self, neighbours=neighbours)

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return the next probe, or None if the object is nowhere; see `Policy`."""
        if not len(contacts):
            probe = search_probe(self.region, outcomes, rng=rng, neighbours=self.neighbours)
            return None if probe is None else replace(probe, purpose="search")
        known = contacts if surface is None else DeferredEstimate.of(surface, contacts).contacts
        space = self.region.grown(known)
        if np.any(np.linalg.norm(contacts.points - space.center, axis=1) > space.radius):
            space = self.region.grown(contacts)
        landmarks = self._landmarks_among(contacts)
        since = outcomes if landmarks else since_first_contact(outcomes)
        touched = len(landmarks) + sum(len(outcome.contacts) for outcome in since)
        if len(contacts) <= touched:  # no contacts from a camera
            opening = extent_probe(space.fitted_to(contacts), contacts, since, landmarks)
            if opening is not None:
                return replace(opening, purpose="extent")
        policy = self.make(space)
        if self.neighbours is not None and isinstance(policy, AvoidingPolicy):
            policy = policy.avoiding(self.neighbours)
        return policy.next_probe(contacts, surface, outcomes=outcomes, rng=rng)

    def _landmarks_among(self, contacts: Contacts) -> Sequence[Landmark]:
        """Return the landmarks if contacts are on their map; none after a loss of the object."""
        points = {point.tobytes() for point in contacts.points}
        here = any(landmark.contacts.points[0].tobytes() in points for landmark in self.landmarks)
        return self.landmarks if here else ()
