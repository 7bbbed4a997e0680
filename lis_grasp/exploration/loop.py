"""Exploration as a pure step, `advance` and `choose`, and the loop around it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import get_args

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.exploration.extent import free_beyond, open_ends
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.pose_tracking import PoseTracker
from lis_grasp.exploration.probe import (
    MovingProber,
    Probe,
    ProbeOutcome,
    Prober,
    ProbeStatus,
    since_loss,
)
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.stopping import StopRule, StopRuleWithMemory
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.workspace import Estimate, ObstacleModel, Workspace
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.implicit_surface import DeferredSurface
from lis_grasp.typing import BoolArray, FloatArray, IndexArray, Seed

# Contacts closer than this are duplicates [m].
_SAME_CONTACT = 1e-3
# An exploration gives up after this many probes for each touch, and these on top.
_PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20
# The surface is estimated anew when the touches have grown by this fraction, or by one.
_GROWTH = 1.0 / 16.0


@dataclass(frozen=True, slots=True, eq=False)
class ExplorationSetup:
    """Prior knowledge and methods of an exploration; nothing of it changes from probe to probe.

    Parameters
    ----------
    policy
        Chooses probes.
    estimate
        Estimates the surface from at least one contact, when the estimate is first used: after
        every contact, and beyond 31 touches only after a sixteenth more. What it raises, that use
        raises.
    touches
        Wanted number of contacts; None for any, until a stop rule or the policy ends.
    space
        Position and size of the object, or the region that contains it; the hand approaches from
        outside of what is known, and avoids it. None leaves the approach to the prober.
    prior
        Contacts known before the first touch, for example of a camera; None for none. The surface
        is estimated from them and the touches, and touches go where both are missing. They are no
        part of the result, and are dropped when the tracker loses the object.
    sensor
        Model of the tactile sensor; None for an ideal one.
    stop
        Rules that end the exploration early, checked after every probe once there is an estimate.
    find_strays
        Returns the rows of contacts that the others contradict. Those of earlier probes are
        dropped, and their places probed again, once; None to believe all.
    tracker
        Tracks the pose of an object that touches move, repeats touches for it, and keeps contacts
        in the object's frame; None if nothing moves.

    Raises
    ------
    InvalidOptionError
        If `touches` is below 1.
    """

    policy: Policy
    estimate: Callable[[Contacts], ImplicitSurface]
    touches: int | None
    space: Workspace | Region | None = None
    prior: Contacts | None = None
    sensor: TactileSensor | None = None
    stop: Sequence[StopRule] = ()
    find_strays: Callable[[Contacts], IndexArray] | None = None
    tracker: PoseTracker | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.touches is not None:
            require_at_least(1, touches=self.touches)


@dataclass(frozen=True, slots=True, eq=False)
class ExplorationState(Record):
    """Everything known after some probes. It never changes: `advance` makes the next one."""

    outcomes: tuple[ProbeOutcome, ...] = ()  #: of every probe so far, in order
    contacts: Contacts = field(default_factory=Contacts.empty)  #: made by touches, in O
    prior: Contacts = field(default_factory=Contacts.empty)  #: known before the first touch
    #: estimated from both, before free space is removed; None without contacts
    estimated: Estimate | None = None
    surface: ImplicitSurface | None = None  #: the estimate without the free space
    is_new: bool = False  #: whether the surface was estimated anew after the last outcome
    rules: tuple[StopRule, ...] = ()  #: stop rules, with their memory of earlier estimates
    #: poses (4, 4) of the object's new frames by the last outcome, each in the one before
    frames: tuple[FloatArray, ...] = ()
    duration: float = 0.0  #: of the probes [s]
    ended: str = ""  #: why the exploration ended; empty before
    known: Contacts = field(init=False)  #: prior contacts, then those of the touches

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "known", self.prior.append(self.contacts))

    @property
    def result(self) -> Exploration:
        """The exploration so far."""
        return Exploration(self.contacts, self.outcomes, self.ended)


@dataclass(frozen=True, slots=True, eq=False)
class NextProbe(Record):
    """The next probe of an exploration, and what the hand avoids on its approach."""

    probe: Probe
    obstacles: ObstacleModel | None  #: None if the approach is left to the prober


@dataclass(frozen=True, slots=True, eq=False)
class Exploration(Record):
    """Result of an exploration."""

    contacts: Contacts  #: in O, without duplicates, with all free space
    outcomes: tuple[ProbeOutcome, ...]  #: of every probe, in order
    ended: str = ""  #: why it ended

    __repr__ = short_repr

    @classmethod
    def replay(cls, outcomes: Sequence[ProbeOutcome], *, touches: int | None = None) -> Exploration:
        """Rebuild an exploration from its recorded outcomes, as if it had ended after `touches`.

        Nothing is known of the probes after the one that made the last of these contacts.
        """
        contacts, clock, used = Contacts.empty(), 0.0, 0
        for outcome in outcomes:
            used += 1
            contacts = _after(contacts, outcome, clock, touches)
            clock += outcome.duration
            if touches is not None and len(contacts) >= touches:
                break
        return cls(contacts, tuple(outcomes[:used]), "replayed")

    def first(self, touches: int) -> Contacts:
        """Return the first contacts, and the free space known when the last of them was made."""
        return self.replay(self.outcomes, touches=touches).contacts

    @property
    def touches(self) -> tuple[ProbeOutcome, ...]:
        """The outcome that made each contact, in the contacts' order."""
        touches: list[ProbeOutcome] = []
        contacts = Contacts.empty()
        for outcome in self.outcomes:
            contacts = _with_outcome(contacts, outcome, 0.0, len(self.contacts))
            touches = [] if outcome.lost else touches
            touches += [outcome] * (len(contacts) - len(touches))
            contacts, kept = _without_dropped(contacts, outcome)
            touches = [touch for touch, is_kept in zip(touches, kept, strict=True) if is_kept]
        return tuple(touches)

    @property
    def simulated_pose(self) -> FloatArray | None:
        """True pose of a free object at the end, (4, 4), for evaluation; None if it was fixed."""
        return self.outcomes[-1].simulated_pose if self.outcomes else None

    @property
    def duration(self) -> float:
        """Total time of the probes [s]."""
        return sum(outcome.duration for outcome in self.outcomes)

    def summary(self) -> str:
        """Return the counts in one line."""
        counts = Counter(outcome.status for outcome in self.outcomes)
        dropped = sum(len(outcome.dropped) for outcome in self.outcomes)
        return (
            f"{_count(len(self.contacts), 'contact')} from {_count(len(self.outcomes), 'probe')}"
            f" ({', '.join(f'{counts[status]} {status}' for status in get_args(ProbeStatus))})"
            + (f", {dropped} dropped that later ones contradict" if dropped else "")
        )


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
    has no probe left, or after ``4 touches + 20`` probes. Fewer contacts are a result, not an
    error.

    Every probe draws from a generator of its own, so a resumed exploration makes the same probes as
    an uninterrupted one, and ends where that ends.

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

    The last state is the one before it, with the reason for the end. What is beyond the ends of an
    object in a region is then free space of its contacts.
    """
    if setup.tracker is not None and not isinstance(prober, MovingProber):
        raise InvalidOptionError(
            "an object is tracked with a prober that has `move_frame`; this one has none",
            option="tracker",
        )
    rng, state = np.random.default_rng(rng), begin(setup, recorded)
    rng.spawn(len(state.outcomes))  # the generators of the recorded probes
    while True:
        yield state
        draws = rng.spawn(1)[0]
        chosen = choose(setup, state, rng=draws)
        if isinstance(chosen, str):
            yield _ended(setup, state, chosen)
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
    recent = since_loss(state.outcomes)
    outcome, frames = setup.tracker.track(
        outcome, recent, state.known, state.estimated, repeated=repeated
    )
    return replace(_without_strays(setup, state, outcome), frames=frames)


def choose(
    setup: ExplorationSetup, state: ExplorationState, *, rng: np.random.Generator
) -> NextProbe | str:
    """Return the next probe, or the reason for which the exploration ends.

    The n-th probe draws from the n-th generator that the exploration's own spawns.
    """
    ended = _reason_to_end(setup, state)
    if ended is not None:
        return ended
    probe = None if setup.tracker is None else setup.tracker.probe_again(state.outcomes)
    known, recent = state.known, since_loss(state.outcomes)
    probe = probe or setup.policy.next_probe(known, state.estimated, outcomes=recent, rng=rng)
    if probe is None:
        return "the policy has no probe left"
    if setup.space is None:
        return NextProbe(probe, None)
    return NextProbe(probe, ObstacleModel(setup.space.grown(known), known, state.surface))


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
    points = after.contacts.points[strays[strays < len(state.contacts)]]
    # A place that was probed again is believed.
    for before in state.outcomes:
        again = np.linalg.norm(points[:, None] - before.dropped, axis=2) < after.contacts.spacing
        points = points[~again.any(axis=1)]
    return _added(setup, state, replace(outcome, dropped=points)) if len(points) else after


def _added(
    setup: ExplorationSetup, state: ExplorationState, outcome: ProbeOutcome
) -> ExplorationState:
    """Return the state after an outcome, which a tracker has placed in the object's frame."""
    before = len(state.known)
    if len(outcome.dropped):
        state = replace(state, estimated=None)
    if outcome.lost:  # what was known before is not where the object is now
        state, before = replace(state, prior=Contacts.empty(), estimated=None), 0
    state = replace(
        state,
        outcomes=(*state.outcomes, outcome),
        contacts=_after(state.contacts, outcome, state.duration, setup.touches),
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


def _ended(setup: ExplorationSetup, state: ExplorationState, reason: str) -> ExplorationState:
    if not isinstance(setup.space, Region) or len(state.prior):
        return replace(state, ended=reason)
    space = setup.space.fitted_to(state.contacts)
    points, radii = free_beyond(space, state.contacts, since_loss(state.outcomes))
    free = replace(Contacts.empty(), free_points=points, free_radii=radii)
    return replace(state, ended=reason, contacts=state.contacts.append(free))


def sought_ends(setup: ExplorationSetup, state: ExplorationState) -> str:
    """Return in words which ends of an object in a region are still sought; empty if none.

    Stop rules wait for them.
    """
    if not isinstance(setup.space, Region) or len(state.prior):
        return ""
    space = setup.space.fitted_to(state.contacts)
    return open_ends(space, state.contacts, since_loss(state.outcomes))


def _reason_to_end(setup: ExplorationSetup, state: ExplorationState) -> str | None:
    sought = sought_ends(setup, state)
    if setup.touches is not None:
        if len(state.contacts) >= setup.touches:
            made = f"{_count(len(state.contacts), 'contact')} made"
            return f"{made}; not found: {sought}" if sought else made
        if len(state.outcomes) >= _PROBES_PER_TOUCH * setup.touches + _SPARE_PROBES:
            return f"{_count(len(state.outcomes), 'probe')} made"
    if state.surface is not None and not sought:
        for rule in state.rules:
            reason = rule(state.known, state.surface, state.outcomes)
            if reason:
                return reason
    return None


def _after(
    contacts: Contacts, outcome: ProbeOutcome, clock: float, touches: int | None
) -> Contacts:
    """Return the contacts after an outcome: `_with_outcome`, without those that it dropped."""
    return _without_dropped(_with_outcome(contacts, outcome, clock, touches), outcome)[0]


def _without_dropped(contacts: Contacts, outcome: ProbeOutcome) -> tuple[Contacts, BoolArray]:
    """Return the contacts that an outcome did not drop, and which these are, (N,)."""
    kept = np.ones(len(contacts), dtype=bool)
    for point in outcome.dropped:
        kept &= np.any(contacts.points != point, axis=1)
    return (contacts if kept.all() else contacts.subset(kept)), kept


def _with_outcome(
    contacts: Contacts, outcome: ProbeOutcome, clock: float, touches: int | None
) -> Contacts:
    """Return the contacts with those of an outcome that began `clock` [s] after the first.

    An outcome that shows that the object is lost ends the contacts before it.
    """
    if outcome.lost:
        contacts = Contacts.empty()
    room = None if touches is None else touches - len(contacts)
    if outcome.repeated:
        room = 0  # it measures the pose, and nothing new of the surface
    new = outcome.contacts.subset(new_contacts(contacts, outcome.contacts)[:room])
    # The outcome's free space counts; a prober may repeat it in its contacts.
    added = replace(
        new,
        free_points=outcome.free_points,
        free_radii=outcome.free_radii,
        times=None if new.times is None else new.times + clock,
    )
    return contacts.append(added)


def new_contacts(known: Contacts, contacts: Contacts) -> IndexArray:
    """Return the rows of contacts that are more than 1 mm from known ones, and from each other."""
    points = known.points
    rows = []
    for i, point in enumerate(contacts.points):
        if np.all(np.linalg.norm(points - point, axis=1) > _SAME_CONTACT):
            rows.append(i)
            points = np.vstack([points, point])
    return np.array(rows, dtype=np.intp)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
