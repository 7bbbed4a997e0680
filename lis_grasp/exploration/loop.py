"""Exploration as a pure step, `advance` and `choose`, and the loop around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, counted
from lis_grasp.exploration.extent import free_beyond, open_ends
from lis_grasp.exploration.probe import MovingProber, ProbeOutcome, Prober, maps_of, present_map
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.registration import are_on, find_displacement
from lis_grasp.exploration.states import (
    Exploration,
    ExplorationSetup,
    ExplorationState,
    NextProbe,
    contacts_after,
    contacts_of,
)
from lis_grasp.exploration.stopping import StopRuleWithMemory
from lis_grasp.exploration.targets import choose_slides
from lis_grasp.exploration.workspace import Estimate, ObstacleModel
from lis_grasp.geometry import inverse_pose
from lis_grasp.surfaces.implicit_surface import DeferredSurface
from lis_grasp.typing import FloatArray, Seed

# An exploration gives up after this many probes for each touch, and these on top.
_PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20
# The surface is estimated anew when the touches have grown by this fraction, or by one.
_GROWTH = 1.0 / 16.0


def explore(
    prober: Prober,
    setup: ExplorationSetup,
    *,
    rng: Seed = 0,
    recorded: Sequence[ProbeOutcome] = (),
    record: Callable[[ProbeOutcome], None] | None = None,
) -> Exploration:
    """Explore an object by touch; the surface estimated so far guides every probe.

    The exploration ends after `setup.touches` contacts, when a stop rule applies, when the policy
    has no probe left, or after ``4 touches + 20`` probes. A resumed exploration makes the same
    probes as an uninterrupted one.

    Parameters
    ----------
    prober
        Carries out probes; a `MovingProber` if the object is tracked.
    setup
        What is known beforehand, and how probes are chosen.
    rng
        Seed or generator, for every draw of policy and sensor.
    recorded
        Outcomes of an interrupted exploration, to resume.
    record
        Called with every new outcome, before the next estimate, which may take long.
    """
    steps = explore_steps(prober, setup, rng=rng, recorded=recorded)
    state = next(steps)
    for state in steps:
        if record is not None and not state.ended:
            record(state.outcomes[-1])
    return state.result


def explore_steps(
    prober: Prober,
    setup: ExplorationSetup,
    *,
    rng: Seed = 0,
    recorded: Sequence[ProbeOutcome] = (),
) -> Iterator[ExplorationState]:
    """Explore as `explore` does; yield the state before the first probe, after each, and the end.

    The last state is that of `end`.
    """
    if setup.tracker is not None and not isinstance(prober, MovingProber):
        raise InvalidOptionError(
            "an object is tracked with a prober that has 'move_frame'; this one has none",
            option="tracker",
        )
    rng, state = np.random.default_rng(rng), begin(setup, recorded)
    rng.spawn(len(state.outcomes))  # the generators of the recorded probes
    while True:
        yield state
        draws = rng.spawn(1)[0]
        chosen = choose(setup, state, rng=draws)
        if isinstance(chosen, str):
            yield end(setup, state, chosen)
            return
        outcome = prober.probe(chosen.probe, chosen.obstacles)
        if setup.sensor is not None:
            outcome = setup.sensor.report(outcome, rng=draws)
        state = advance(setup, state, outcome)
        if isinstance(prober, MovingProber):
            for X_EF in state.frames:
                prober.move_frame(X_EF)


def begin(setup: ExplorationSetup, recorded: Sequence[ProbeOutcome] = ()) -> ExplorationState:
    """Return the state before the first probe, or after recorded outcomes."""
    prior = Contacts.empty() if setup.prior is None else setup.prior
    start = ExplorationState(prior=prior, rules=tuple(setup.stop))
    state = _estimated(setup, start, is_new=len(prior) > 0)
    for outcome in Exploration.replay(recorded, touches=setup.touches).outcomes:
        state = _added(setup, state, outcome)
    return state


def advance(
    setup: ExplorationSetup, state: ExplorationState, outcome: ProbeOutcome
) -> ExplorationState:
    """Return the state after the outcome of the probe that `choose` chose in a state.

    With `choose`, it is the step of an exploration. Both are pure functions: nothing that is given
    changes, except the generator of `choose`, from which it draws.
    """
    if setup.tracker is None:
        return _without_strays(setup, state, outcome)
    repeated = setup.tracker.probe_again(state.outcomes) is not None
    recent = present_map(state.outcomes)
    outcome, frames = setup.tracker.track(
        outcome, recent, state.known, state.estimated, repeated=repeated
    )
    after = _without_strays(setup, state, outcome)
    if after.before is not None and len(outcome.contacts) and not outcome.lost:
        found = find_displacement(after.contacts, after.before)
        if found is not None:
            outcome = setup.tracker.joined(after.outcomes[-1], *found)
            gone = _moved_before(outcome, after.outcomes, after.before)
            outcome = replace(outcome, dropped=gone)
            after, frames = _without_strays(setup, state, outcome), (*frames, found[0])
    return replace(after, frames=frames)


def choose(
    setup: ExplorationSetup, state: ExplorationState, *, rng: np.random.Generator
) -> NextProbe | str:
    """Return the next probe, or the reason for which the exploration ends.

    The n-th probe draws from the n-th generator that the exploration's own spawns.
    """
    if (ended := _reason_to_end(setup, state)) is not None:
        return ended
    probe = None if setup.tracker is None else setup.tracker.probe_again(state.outcomes)
    known, recent = state.known, present_map(state.outcomes)
    probe = probe or setup.policy.next_probe(known, state.estimated, outcomes=recent, rng=rng)
    if probe is None:
        return f"the policy has no probe left{_not_found(setup, state)}"
    if setup.space is None:
        return NextProbe(probe, None)
    space = setup.space.grown(known)
    slides = probe.slides if setup.tracker is None else probe.slides[:0]  # it may move
    if setup.slide and setup.tracker is None and not len(slides):
        slides = choose_slides(probe, setup.slide, space, known, state.estimated)
    probe = replace(probe, slides=slides)
    return NextProbe(probe, ObstacleModel(space, known, state.surface))


def _without_strays(
    setup: ExplorationSetup, state: ExplorationState, outcome: ProbeOutcome
) -> ExplorationState:
    """Return the state after an outcome, without the strays among the contacts before it.

    They are looked for when the surface is estimated anew.
    """
    after = _added(setup, state, outcome)
    if setup.find_strays is None or outcome.lost or not after.is_new:
        return after
    strays = setup.find_strays(after.contacts)
    before = len(after.contacts) - len(outcome.contacts) if outcome.joined else len(state.contacts)
    points = after.contacts.points[strays[strays < before]]
    # A place that was probed again is believed.
    for earlier in state.outcomes if len(points) else ():
        again = np.linalg.norm(points[:, None] - earlier.dropped, axis=2) < after.contacts.spacing
        points = points[~again.any(axis=1)]
    dropped = np.vstack([outcome.dropped, points])
    return _added(setup, state, replace(outcome, dropped=dropped)) if len(points) else after


def _moved_before(
    joined: ProbeOutcome, outcomes: Sequence[ProbeOutcome], surface: Estimate
) -> FloatArray:
    """Return the points (D, 3) of contacts of the map before that were made after the motion.

    Since the last repetition that agreed, these are on its estimate where the object is now.
    """
    gone = [joined.dropped]
    for before in reversed(maps_of(outcomes)[0].values()):
        if before.repeated and len(before.contacts):
            break
        if len(before.contacts) and before.tracked and joined.tracked:
            X_EF = inverse_pose(before.tracked.X_WE) @ joined.tracked.X_WE
            there = are_on(before.contacts.in_frame(X_EF), surface)
            gone.append(before.contacts.points[there])
    return np.vstack(gone)


def _added(
    setup: ExplorationSetup, state: ExplorationState, outcome: ProbeOutcome
) -> ExplorationState:
    """Return the state after an outcome, which a tracker has placed in the object's frame."""
    before = len(state.known)
    if len(outcome.dropped):
        state = replace(state, estimated=None)
    outcomes = (*state.outcomes, outcome)
    if outcome.lost or outcome.joined:
        maps, prior = maps_of(outcomes), setup.prior or Contacts.empty()
        held, now = (prior if 0 in one else Contacts.empty() for one in maps)
        waits = held.append(contacts_of(maps[0], outcomes, setup.touches))
        earlier = Estimate(setup.estimate, waits) if len(waits) else None
        state, before = replace(state, prior=now, estimated=None, before=earlier), 0
    state = replace(
        state,
        outcomes=outcomes,
        contacts=contacts_after(state.contacts, outcomes, setup.touches),
        frames=(),
        duration=state.duration + outcome.duration,
    )
    is_new = len(state.known) > before or len(outcome.dropped) > 0
    return _estimated(setup, state, is_new=is_new)


def _estimated(
    setup: ExplorationSetup, state: ExplorationState, *, is_new: bool
) -> ExplorationState:
    """Return the state with the surface of its contacts, estimated at the first use."""
    known, estimated, surface, rules = state.known, state.estimated, None, state.rules
    if is_new and estimated is not None:
        made = len(estimated.contacts) - len(state.prior)
        is_new = len(state.contacts) >= made + max(1, int(_GROWTH * made))
    if is_new:
        margin = 0.0 if setup.sensor is None else setup.sensor.free_margin
        estimated = Estimate(setup.estimate, known, margin)
    if estimated is not None:
        surface = DeferredSurface(partial(estimated.without_free_space, known))
    if is_new and surface is not None:
        rules = tuple(
            rule.noted(known, surface) if isinstance(rule, StopRuleWithMemory) else rule
            for rule in rules
        )
    return replace(state, estimated=estimated, surface=surface, is_new=is_new, rules=rules)


def end(setup: ExplorationSetup, state: ExplorationState, reason: str) -> ExplorationState:
    """Return the state at the end: what is beyond ends in a region is free space."""
    if not isinstance(setup.space, Region) or len(state.prior):
        return replace(state, ended=reason)
    space = setup.space.fitted_to(state.contacts)
    free = free_beyond(space, state.contacts, present_map(state.outcomes))
    return replace(state, ended=reason, contacts=state.contacts.append(free))


def sought_ends(setup: ExplorationSetup, state: ExplorationState) -> str:
    """Return in words which ends of an object in a region are still sought; empty if none.

    Stop rules wait for them.
    """
    if not isinstance(setup.space, Region) or len(state.prior):
        return ""
    space = setup.space.fitted_to(state.contacts)
    return open_ends(space, state.contacts, present_map(state.outcomes))


def _not_found(setup: ExplorationSetup, state: ExplorationState) -> str:
    sought = sought_ends(setup, state)
    return f"; not found: {sought}" if sought else ""


def _reason_to_end(setup: ExplorationSetup, state: ExplorationState) -> str | None:
    if setup.touches is not None:
        if (made := state.result.made) >= setup.touches:
            slid = len(state.contacts) - made
            more = f" and {slid} at ends of slides" if slid else ""
            return f"{counted(made, 'contact')}{more} made{_not_found(setup, state)}"
        if len(state.outcomes) >= _PROBES_PER_TOUCH * setup.touches + _SPARE_PROBES:
            return f"{counted(len(state.outcomes), 'probe')} made{_not_found(setup, state)}"
    if state.surface is not None and not sought_ends(setup, state):
        for rule in state.rules:
            if reason := rule(state.known, state.surface, state.outcomes):
                return reason
    return None
