"""Exploration loop (touch, estimate, choose the next touch) and the record of an exploration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import get_args

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import require_at_least
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.pose_tracking import PoseTracker, since_loss
from lis_grasp.exploration.probe import ProbeOutcome, Prober, ProbeStatus
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.stopping import StopRule, StopRuleWithMemory
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.records import short_repr
from lis_grasp.surfaces import ImplicitSurface, carved
from lis_grasp.surfaces.implicit_surface import DeferredSurface
from lis_grasp.typing import FloatArray, IndexArray

# Contacts closer than this are duplicates [m].
_SAME_CONTACT = 1e-3
# An exploration gives up after this many probes for each touch, and these on top.
_PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20


@dataclass(frozen=True, slots=True, eq=False)
class Exploration:
    """Result of an exploration."""

    contacts: Contacts  #: in O, without duplicates, with all free space
    outcomes: tuple[ProbeOutcome, ...]  #: of every probe, in order
    ended: str = ""  #: why it ended

    __repr__ = short_repr

    @classmethod
    def replay(cls, outcomes: Sequence[ProbeOutcome], *, touches: int | None = None) -> Exploration:
        """Rebuild an exploration from its recorded outcomes, up to `touches` contacts."""
        *_, contacts = Contacts.empty(), *_accumulated(outcomes, touches)
        return cls(contacts, tuple(outcomes), "replayed")

    def first(self, touches: int) -> Contacts:
        """Return the first contacts, and the free space known when the last of them was made."""
        contacts = Contacts.empty()
        for contacts in _accumulated(self.outcomes, touches):
            if len(contacts) >= touches:
                break
        return contacts

    @property
    def touches(self) -> tuple[ProbeOutcome, ...]:
        """The outcome that made each contact, in the contacts' order."""
        touches: list[ProbeOutcome] = []
        accumulated = _accumulated(self.outcomes, len(self.contacts))
        for outcome, contacts in zip(self.outcomes, accumulated, strict=True):
            touches = [] if outcome.lost else touches
            touches += [outcome] * (len(contacts) - len(touches))
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
        return (
            f"{_count(len(self.contacts), 'contact')} from {_count(len(self.outcomes), 'probe')}"
            f" ({', '.join(f'{counts[status]} {status}' for status in get_args(ProbeStatus))})"
        )


def explore(
    prober: Prober,
    policy: Policy,
    estimate: Callable[[Contacts], ImplicitSurface],
    *,
    touches: int,
    rng: np.random.Generator,
    space: Workspace | Region | None = None,
    prior: Contacts | None = None,
    sensor: TactileSensor | None = None,
    stop: Sequence[StopRule] = (),
    tracker: PoseTracker | None = None,
    recorded: Sequence[ProbeOutcome] = (),
    record: Callable[[ProbeOutcome], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    observe: Callable[[int, ImplicitSurface], None] | None = None,
) -> Exploration:
    """Explore an object by touch; the surface estimated so far guides every probe.

    The exploration ends after `touches` contacts, when a stop rule applies, when the policy has no
    probe left, or after ``4 touches + 20`` probes. Fewer contacts are a result, not an error.

    Every probe draws from a generator of its own, so a resumed exploration makes the same probes as
    an uninterrupted one, and ends where that ends.

    Parameters
    ----------
    prober
        Carries out probes.
    policy
        Chooses probes.
    estimate
        Estimates the surface from at least one contact; called at most once for the contacts so
        far, when the estimate is first used. What it raises, that use raises.
    touches
        Wanted number of contacts.
    rng
        For every draw of policy and sensor.
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
        None applied at a recorded probe; a `StopRuleWithMemory` is given the estimate there.
    tracker
        Tracks the pose of an object that touches move, repeats touches for it, and keeps contacts
        in the object's frame; None if nothing moves.
    recorded
        Outcomes of an interrupted exploration, to resume.
    record
        Called with every new outcome, before it is used.
    progress
        Called after every probe with the contacts made and those wanted.
    observe
        Called, whenever contacts were added, with their number and the surface estimated from them,
        without free space. The surface is estimated when it is first used.

    Raises
    ------
    InvalidOptionError
        If `touches` is below 1.
    """
    require_at_least(1, touches=touches)
    state = _ExplorationState(estimate, prior, sensor, touches)
    for outcome in recorded:
        for rule in stop:
            if isinstance(rule, StopRuleWithMemory) and state.surface is not None:
                rule.note(state.known, state.surface)
        rng.spawn(1)  # the generator of the recorded probe
        state.add(outcome)
    while True:
        contacts, known, surface = state.contacts, state.known, state.surface
        if observe is not None and state.is_new and surface is not None:
            observe(len(contacts), surface)
            state.is_new = False
        ended = _reason_to_end(state, touches, stop)
        if ended:
            return Exploration(contacts, tuple(state.outcomes), ended)
        draws = rng.spawn(1)[0]
        again = None if tracker is None else tracker.probe_again(state.outcomes)
        recent = since_loss(state.outcomes)
        probe = again or policy.next_probe(known, state.estimated, outcomes=recent, rng=draws)
        if probe is None:
            return Exploration(contacts, tuple(state.outcomes), "the policy has no probe left")
        obstacles = None if space is None else ObstacleModel(space.grown(known), known, surface)
        outcome = prober.probe(probe, obstacles)
        if sensor is not None:
            outcome = sensor.report(outcome, rng=draws)
        if tracker is not None:
            repeated = again is not None
            outcome = tracker.track(outcome, recent, known, state.estimated, repeated=repeated)
        if record is not None:
            record(outcome)
        state.add(outcome)
        if progress is not None:
            progress(len(state.contacts), touches)


class _ExplorationState:
    """Outcomes, contacts and estimate of an exploration that continues.

    Estimates are deferred; `is_new` says that the last has not been observed.
    """

    def __init__(
        self,
        estimate: Callable[[Contacts], ImplicitSurface],
        prior: Contacts | None,
        sensor: TactileSensor | None,
        touches: int,
    ) -> None:
        self._estimate, self._touches = estimate, touches
        self._before = Contacts.empty() if prior is None else prior
        self._margin = 0.0 if sensor is None else sensor.free_margin
        self._clock, self._estimated_from = 0.0, 0  # seconds, contacts
        self.outcomes: list[ProbeOutcome] = []
        self.contacts = Contacts.empty()
        self.estimated: ImplicitSurface | None = None
        self.is_new = False
        self._update()

    def add(self, outcome: ProbeOutcome) -> None:
        """Add the outcome of a probe."""
        self.outcomes.append(outcome)
        self.contacts = _with_outcome(self.contacts, outcome, self._clock, self._touches)
        self._clock += outcome.duration
        if outcome.lost:  # what was known before is not where the object is now
            self._before = Contacts.empty()
            self.estimated, self._estimated_from = None, 0
        self._update()

    def _update(self) -> None:
        self.known = known = self._before.append(self.contacts)
        if len(known) > self._estimated_from:
            self.estimated = DeferredSurface(partial(self._estimate, known))
            self._estimated_from, self.is_new = len(known), True
        # The estimate without the free space known by now.
        self.surface: ImplicitSurface | None = None
        if self.estimated is not None:
            cut = partial(carved, self.estimated, known, margin=self._margin)
            self.surface = DeferredSurface(cut)


def _reason_to_end(state: _ExplorationState, touches: int, stop: Sequence[StopRule]) -> str | None:
    if len(state.contacts) >= touches:
        return f"{_count(len(state.contacts), 'contact')} made"
    if len(state.outcomes) >= _PROBES_PER_TOUCH * touches + _SPARE_PROBES:
        return f"{_count(len(state.outcomes), 'probe')} made"
    if state.surface is not None:
        for rule in stop:
            reason = rule(state.known, state.surface, state.outcomes)
            if reason:
                return reason
    return None


def _accumulated(outcomes: Sequence[ProbeOutcome], touches: int | None) -> Iterator[Contacts]:
    """Yield the contacts after each outcome."""
    contacts, clock = Contacts.empty(), 0.0
    for outcome in outcomes:
        contacts = _with_outcome(contacts, outcome, clock, touches)
        clock += outcome.duration
        yield contacts


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
    new = outcome.contacts.subset(_new_contacts(contacts, outcome)[:room])
    # The outcome's free space counts; a prober may repeat it in its contacts.
    added = replace(
        new,
        free_points=outcome.free_points,
        free_radii=outcome.free_radii,
        times=None if new.times is None else new.times + clock,
    )
    return contacts.append(added)


def _new_contacts(known: Contacts, outcome: ProbeOutcome) -> IndexArray:
    """Return the rows of an outcome's contacts that are no duplicates of earlier ones."""
    points = known.points
    rows = []
    for i, point in enumerate(outcome.contacts.points):
        if np.all(np.linalg.norm(points - point, axis=1) > _SAME_CONTACT):
            rows.append(i)
            points = np.vstack([points, point])
    return np.array(rows, dtype=np.intp)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
