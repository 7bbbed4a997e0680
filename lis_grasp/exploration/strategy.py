"""Exploration strategy: how the state of an exploration becomes the next probe, or its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.exceptions import counted, require_at_least
from lis_grasp.exploration.extent import free_beyond, open_ends
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.states import ExplorationState, NextProbe
from lis_grasp.exploration.stopping import StopRule
from lis_grasp.exploration.targets import choose_slides
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.records import short_repr
from lis_grasp.underflow import underflows

# An exploration gives up after this many probes for each touch, plus this many.
PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20

MOST_BLOCKED = 20
"""Probes that cannot be approached, before the search for one is given up."""


@dataclass(frozen=True, slots=True, eq=False)
class ExplorationStrategy:
    """How probes are chosen; it does not change from probe to probe.

    Parameters
    ----------
    policy
        Chooses probes.
    touches
        Wanted number of contacts, without ends of slides; None for any, until a stop rule or the
        policy ends.
    space
        Position and size of the object, or the region that contains it; the hand approaches from
        outside of what is known, and avoids it. None leaves the approach to the prober.
    stop
        Rules that end the exploration early, checked after every probe once there is an estimate.
    slide
        Length of slides after touches [m]; 0 for none. A tracked object allows none.

    Raises
    ------
    InvalidOptionError
        If `touches` is below 1, or `slide` below 0.
    """

    policy: Policy
    touches: int | None
    space: Workspace | Region | None = None
    stop: Sequence[StopRule] = ()
    slide: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.touches is not None:
            require_at_least(1, touches=self.touches)
        require_at_least(0, slide=self.slide)


@underflows
def choose(
    strategy: ExplorationStrategy, state: ExplorationState, *, rng: np.random.Generator
) -> NextProbe | str:
    """Return the next probe, or the reason why the exploration ends.

    The n-th probe draws from the n-th generator spawned by the exploration's own.
    """
    if (ended := _reason_to_end(strategy, state)) is not None:
        return ended
    known, recent = state.known, state.maps.present.outcomes
    probe = state.again or strategy.policy.next_probe(
        known, state.estimated, outcomes=recent, rng=rng
    )
    if probe is None:
        return f"the policy has no probe left{_not_found(strategy, state)}"
    if strategy.space is None:
        return NextProbe(probe, None)
    space = strategy.space.grown(known)
    is_tracked = state.belief is not None  # it may move
    slides = probe.slides[:0] if is_tracked else probe.slides
    if strategy.slide and not is_tracked and not len(slides):
        slides = choose_slides(probe, strategy.slide, space, known, state.estimated)
    probe = replace(probe, slides=slides)
    return NextProbe(probe, ObstacleModel(space, known, state.surface))


def end(strategy: ExplorationStrategy, state: ExplorationState, reason: str) -> ExplorationState:
    """Return the state at the end: space beyond the ends of an object in a region is free."""
    if not isinstance(strategy.space, Region) or len(state.prior):
        return replace(state, ended=reason)
    space = strategy.space.fitted_to(state.contacts)
    free = free_beyond(space, state.contacts, state.maps.present.outcomes)
    return replace(state, ended=reason, contacts=state.contacts.append(free))


def sought_ends(strategy: ExplorationStrategy, state: ExplorationState) -> str:
    """Return in words which ends of an object in a region are still sought; empty if none.

    Stop rules wait for them.
    """
    if not isinstance(strategy.space, Region) or len(state.prior):
        return ""
    space = strategy.space.fitted_to(state.contacts)
    return open_ends(space, state.contacts, state.maps.present.outcomes)


def _not_found(strategy: ExplorationStrategy, state: ExplorationState) -> str:
    sought = sought_ends(strategy, state)
    return f"; not found: {sought}" if sought else ""


def _reason_to_end(strategy: ExplorationStrategy, state: ExplorationState) -> str | None:
    probes = len(state.observations)
    if strategy.touches is not None:
        if (made := state.made) >= strategy.touches:
            slid = len(state.contacts) - made
            more = f" and {slid} at ends of slides" if slid else ""
            return f"{counted(made, 'contact')}{more} made{_not_found(strategy, state)}"
        if probes >= PROBES_PER_TOUCH * strategy.touches + _SPARE_PROBES:
            return f"{counted(probes, 'probe')} made{_not_found(strategy, state)}"
    if state.surface is not None and not sought_ends(strategy, state):
        for rule in state.rules:
            if reason := rule(state.known, state.surface, state.outcomes):
                return reason
    return None
