"""Exploration strategy: how the state of an exploration becomes the next probe, or its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.exceptions import counted, listed, require_at_least
from lis_grasp.exploration.extent import free_beyond, open_ends, unreached
from lis_grasp.exploration.neighbours import Neighbours, fitted
from lis_grasp.exploration.pace import pace_of
from lis_grasp.exploration.policy import AvoidingPolicy, Policy
from lis_grasp.exploration.probe import Pace, Probe, ProbeOutcome
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.states import ExplorationState, NextProbe
from lis_grasp.exploration.stopping import StopRule
from lis_grasp.exploration.targets import choose_slides
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.records import short_repr
from lis_grasp.underflow import underflows

# An exploration gives up after this many probes for each touch, plus this many.
PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20

Reaches = Callable[[Probe, ObstacleModel], str]
"""Returns why no finger reaches a probe; empty if one does."""

NO_ROOM = "a fingertip has no room at the target"

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
    strategy: ExplorationStrategy,
    state: ExplorationState,
    *,
    rng: np.random.Generator,
    reaches: Reaches | None = None,
) -> NextProbe | str:
    """Return the next probe, or the reason why the exploration ends.

    The n-th probe draws from the n-th generator spawned by the exploration's own. `reaches` tells
    why no finger reaches a probe between known bodies; without it all are tried.
    """
    if (ended := _reason_to_end(strategy, state)) is not None:
        return ended
    if state.neighbours is not None and strategy.space is not None and state.again is None:
        return _choose_between(strategy, state, state.neighbours, reaches, rng)
    known, recent = state.known, state.maps.present.attempts
    probe = state.again or strategy.policy.next_probe(
        known, state.estimated, outcomes=recent, rng=rng
    )
    if probe is None:
        return f"the policy has no probe left{_not_found(strategy, state)}"
    if strategy.space is None:
        return NextProbe(probe, None)
    return _planned(strategy, strategy.space, state, probe)


def _planned(
    strategy: ExplorationStrategy, where: Workspace | Region, state: ExplorationState, probe: Probe
) -> NextProbe:
    """Return a probe with its slides, and what its approach avoids."""
    known = state.known
    space = where.grown(known)
    is_tracked = state.belief is not None  # it may move
    slides = probe.slides[:0] if is_tracked else probe.slides
    if strategy.slide and not is_tracked and not len(slides):
        slides = choose_slides(probe, strategy.slide, space, known, state.estimated)
    pace: Pace = pace_of(probe.direction, state.maps.present.outcomes) if is_tracked else "gentle"
    probe = replace(probe, slides=slides, pace=pace)
    region = where.bounds if isinstance(where, Region) else None
    return NextProbe(probe, ObstacleModel(space, known, state.surface, region))


def _choose_between(
    strategy: ExplorationStrategy,
    state: ExplorationState,
    neighbours: Neighbours,
    reaches: Reaches | None,
    rng: np.random.Generator,
) -> NextProbe | str:
    """Return the next probe that a finger reaches between known bodies, or why there is none.

    The probe begins and ends before these. After `MOST_BLOCKED` refusals the next probe is carried
    out as it is; twice in a row, or before the first motion, they are the end.
    """
    assert strategy.space is not None
    radius, refused = strategy.space.tip_radius, list[ProbeOutcome]()
    before, policy = state.maps.present.attempts, strategy.policy
    if isinstance(policy, AvoidingPolicy):
        policy = policy.avoiding(neighbours)
    while True:
        outcomes = [*before, *refused]
        probe = policy.next_probe(state.known, state.estimated, outcomes=outcomes, rng=rng)
        if probe is None:
            return f"the policy has no probe left{_not_found(strategy, state)}"
        part = fitted(probe, neighbours, radius)
        chosen = _planned(strategy, strategy.space, state, part or probe)
        assert chosen.obstacles is not None
        if part is None:
            nearest = neighbours.nearest(probe.target[None] - radius * probe.direction)
            reason = f"{NO_ROOM}: {nearest} is in the way"
        else:
            reason = "" if reaches is None else reaches(chosen.probe, chosen.obstacles)
        if reason and len(refused) == MOST_BLOCKED and _reached_nothing(state):
            return f"{counted(MOST_BLOCKED, 'probe')} blocked: {reason}"
        if not reason or len(refused) == MOST_BLOCKED:
            return replace(chosen, refused=tuple(refused))
        refused.append(ProbeOutcome(probe, "blocked", reason=reason))


def _reached_nothing(state: ExplorationState) -> bool:
    """Return whether no probe was carried out, or none was reached before the last one either."""
    if all(outcome.status == "blocked" for outcome in state.outcomes):
        return True
    last = state.observations[-1]
    return last.outcome.status == "blocked" and len(last.refused) >= MOST_BLOCKED


def end(strategy: ExplorationStrategy, state: ExplorationState, reason: str) -> ExplorationState:
    """Return the state at the end: space beyond the ends of an object in a region is free.

    The reason names the sides that no finger reaches between known bodies.
    """
    refused = [o for e in state.maps.present.entries for o in e.observation.refused]
    if refused and strategy.space is not None:
        sides = unreached(state.contacts, refused, strategy.space.fitted_to(state.contacts))
        note = f"; no finger reaches {listed(sides)}" if sides else ""
        reason = reason.removesuffix(note) + note  # it may be a recorded one
    if not isinstance(strategy.space, Region) or len(state.prior):
        return replace(state, ended=reason)
    space = strategy.space.fitted_to(state.contacts)
    free = free_beyond(space, state.contacts, state.maps.present.attempts)
    return replace(state, ended=reason, contacts=state.contacts.append(free))


def sought_ends(strategy: ExplorationStrategy, state: ExplorationState) -> str:
    """Return in words which ends of an object in a region are still sought; empty if none.

    Stop rules wait for them.
    """
    if not isinstance(strategy.space, Region) or len(state.prior):
        return ""
    space = strategy.space.fitted_to(state.contacts)
    return open_ends(space, state.contacts, state.maps.present.attempts)


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
