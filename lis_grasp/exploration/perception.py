"""Tactile perception: how the outcomes of probes become the state of an exploration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.neighbours import Neighbours, attributed
from lis_grasp.exploration.observations import Landmark, Maps, ObjectMap, Observation
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.pose_tracking import PoseTracker
from lis_grasp.exploration.prior import Prior, as_prior
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.registration import are_on, find_displacement
from lis_grasp.exploration.states import ExplorationState
from lis_grasp.exploration.stopping import StopRuleWithMemory
from lis_grasp.exploration.strategy import ExplorationStrategy
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.geometry import inverse_pose
from lis_grasp.records import short_repr
from lis_grasp.surfaces import DeferredSurface, ImplicitSurface
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import underflows

# The surface is estimated anew when the touches have grown by this fraction, or by one.
_GROWTH = 1.0 / 16.0


@dataclass(frozen=True, slots=True, eq=False)
class TactilePerception:
    """How contacts become knowledge; it does not change from probe to probe.

    Parameters
    ----------
    estimate
        Estimates the surface from at least one contact, when the estimate is first used: after
        every contact up to 31 touches, then after a growth by a sixteenth. Its errors are raised
        at that use. With something seen, it takes ``prior``, too (`PriorKnowledge`).
    prior
        What is known beside the touches, or contacts, such as a point cloud; None for nothing. The
        surface is estimated from it and the touches, and touches go where both are missing. It is
        not part of the result, and waits while the tracker has lost the object.
    sensor
        Model of the tactile sensor; None for an ideal one.
    find_strays
        Returns the rows of contacts that the others contradict. Those of earlier probes are
        dropped, and their places probed again, once; None to believe all.
    tracker
        Tracks the pose of an object that touches move, touches landmarks again for it, and keeps
        contacts in the object's frame; None if nothing moves.
    beside
        Known bodies beside the object, in the frame of the first probe: their contacts are not the
        object's. None without any.
    """

    estimate: Callable[..., ImplicitSurface]
    prior: Prior | Contacts | None = None
    sensor: TactileSensor | None = None
    find_strays: Callable[[Contacts], IndexArray] | None = None
    tracker: PoseTracker | None = None
    beside: Neighbours | None = None

    __repr__ = short_repr


@underflows
def begin(
    perception: TactilePerception,
    strategy: ExplorationStrategy | None = None,
    recorded: Sequence[Observation] = (),
) -> ExplorationState:
    """Return the state before the first probe, or after recorded observations.

    It remembers the strategy's stop rules and wanted number of contacts; else neither.
    """
    return _begun(perception, strategy, (), PoseBelief.start(), recorded)


@underflows
def begin_again(
    perception: TactilePerception,
    strategy: ExplorationStrategy,
    landmarks: Sequence[Landmark],
    belief: PoseBelief,
) -> ExplorationState:
    """Return the state of an object that was touched before: contacts, and a belief of its pose.

    The contacts come from the landmarks, which the tracker may touch again, and from the prior.
    """
    return _begun(perception, strategy, landmarks, belief, ())


def _begun(
    perception: TactilePerception,
    strategy: ExplorationStrategy | None,
    landmarks: Sequence[Landmark],
    belief: PoseBelief,
    recorded: Sequence[Observation],
) -> ExplorationState:
    known = ObjectMap(as_prior(perception.prior), tuple(landmarks))
    state = ExplorationState(
        contacts=known.first_contacts(),
        maps=Maps(known),
        belief=None if perception.tracker is None else belief,
        beside=perception.beside,
        rules=() if strategy is None else tuple(strategy.stop),
        wanted=None if strategy is None else strategy.touches,
    )
    state = _estimated(perception, state, is_new=len(state.known) > 0)
    for observation in recorded:
        state = _added(perception, state, observation)
        if state.wanted is not None and state.made >= state.wanted:
            break
    return _with_landmark(perception, state)


@underflows
def advance(
    perception: TactilePerception,
    state: ExplorationState,
    outcome: ProbeOutcome,
    refused: Sequence[ProbeOutcome] = (),
) -> ExplorationState:
    """Return the state after the outcome of the probe that `choose` chose in a state.

    With `choose`, it is the step of an exploration. Both are pure functions: they change no
    argument except the generator of `choose`. `refused` are the probes that `choose` refused.
    """
    tracker, neighbours = perception.tracker, state.neighbours
    seen = Observation(outcome, refused=tuple(refused))
    if neighbours is not None:
        X_WE = np.eye(4) if state.belief is None else state.belief.X_WE
        outcome, beside = attributed(outcome, neighbours, X_WE)
        seen = replace(seen, outcome=outcome, beside=beside)
    if tracker is None or state.belief is None:
        return _without_strays(perception, state, seen)
    observation, frames = tracker.track(outcome, state)
    observation = replace(observation, beside=seen.beside, refused=seen.refused)
    after = _without_strays(perception, state, observation)
    if after.waiting is not None and len(observation.outcome.contacts) and not observation.is_lost:
        found = find_displacement(after.contacts, after.waiting)
        if found is not None:
            joined = tracker.joined(after.observations[-1], *found)
            joined = replace(joined, dropped=_moved_before(joined, after))
            after, frames = _without_strays(perception, state, joined), (*frames, found[0])
    return _with_landmark(perception, replace(after, frames=frames))


def _with_landmark(perception: TactilePerception, state: ExplorationState) -> ExplorationState:
    """Return the state with the probe of a landmark that is to be touched again, if there is."""
    if perception.tracker is None:
        return state
    again = perception.tracker.probe_again(state)
    return replace(state, again=again and replace(again, purpose="repeat"))


def _without_strays(
    perception: TactilePerception, state: ExplorationState, observation: Observation
) -> ExplorationState:
    """Return the state after an observation, without the strays among the contacts before it.

    Strays are sought when the surface is estimated anew.
    """
    after = _added(perception, state, observation)
    if perception.find_strays is None or observation.is_lost or not after.is_new:
        return after
    strays = perception.find_strays(after.contacts)
    new = len(observation.outcome.contacts)
    before = len(after.contacts) - new if observation.is_joined else len(state.contacts)
    points = after.contacts.points[strays[strays < before]]
    # A place that was probed again is believed.
    for earlier in state.observations if len(points) else ():
        again = np.linalg.norm(points[:, None] - earlier.dropped, axis=2) < after.contacts.spacing
        points = points[~again.any(axis=1)]
    if not len(points):
        return after
    dropped = np.vstack([observation.dropped, points])
    return _added(perception, state, replace(observation, dropped=dropped))


def _moved_before(joined: Observation, state: ExplorationState) -> FloatArray:
    """Return the points (D, 3) of contacts on the map before that were made after the motion.

    They follow the last repetition that agreed, and are on its estimate at the object's new pose.
    """
    gone, surface = [joined.dropped], state.waiting
    for entry in reversed(state.maps.waiting.entries):
        before, contacts = entry.observation, entry.observation.outcome.contacts
        if before.is_repeated and len(contacts):
            break
        if len(contacts) and before.belief and joined.belief and surface is not None:
            X_EF = inverse_pose(before.belief.X_WE) @ joined.belief.X_WE
            gone.append(contacts.points[are_on(contacts.in_frame(X_EF), surface)])
    return np.vstack(gone)


def _added(
    perception: TactilePerception, state: ExplorationState, observation: Observation
) -> ExplorationState:
    """Return the state after an observation, which a tracker has placed in the object's frame."""
    before, maps = len(state.contacts), state.maps.after(observation, state.observations)
    if len(observation.dropped):
        state = replace(state, estimated=None)
    contacts = maps.contacts_after(state.maps, state.contacts, state.wanted)
    if observation.is_lost or observation.is_joined:
        touches = maps.waiting.contacts(state.wanted)
        given = maps.waiting.prior.given(touches)
        waits = given.contacts.append(touches)
        waiting = None
        if len(waits):
            waiting = DeferredEstimate(perception.estimate, waits, prior=given)
        state, before = replace(state, estimated=None, waiting=waiting), 0
    state = replace(
        state,
        observations=(*state.observations, observation),
        contacts=contacts,
        maps=maps,
        belief=observation.belief or state.belief,
        beside=state.beside and state.beside.corrected(observation.beside),
        again=None,
        frames=(),
        duration=state.duration + observation.outcome.duration,
    )
    is_new = len(state.contacts) > before or len(observation.dropped) > 0
    return _estimated(perception, state, is_new=is_new)


def _estimated(
    perception: TactilePerception, state: ExplorationState, *, is_new: bool
) -> ExplorationState:
    """Return the state with the surface of its contacts, estimated at the first use."""
    known, estimated, surface, rules = state.known, state.estimated, None, state.rules
    if is_new and estimated is not None:
        made = len(estimated.contacts) - len(estimated.prior.contacts)
        is_new = len(state.contacts) >= made + max(1, int(_GROWTH * made))
    if is_new:
        margin = 0.0 if perception.sensor is None else perception.sensor.free_margin
        estimated = DeferredEstimate(perception.estimate, known, margin, state.given)
    if estimated is not None:
        surface = DeferredSurface(partial(estimated.without_free_space, known))
    if is_new and surface is not None:
        rules = tuple(
            rule.noted(state.touched, surface) if isinstance(rule, StopRuleWithMemory) else rule
            for rule in rules
        )
    return replace(state, estimated=estimated, surface=surface, is_new=is_new, rules=rules)
