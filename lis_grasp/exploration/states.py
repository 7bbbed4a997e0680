"""Records of an exploration: its setup, its states, the next probe and the result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import counted, require_at_least
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.pose_tracking import PoseTracker
from lis_grasp.exploration.probe import (
    Probe,
    ProbeOutcome,
    ProbeStatus,
    are_touches,
    maps_of,
    present_map,
    touches_made,
)
from lis_grasp.exploration.region import Region
from lis_grasp.exploration.stopping import StopRule
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.workspace import Estimate, ObstacleModel, Workspace
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray, IndexArray

# Contacts closer than this are duplicates, and points the same [m].
_SAME_CONTACT, _SAME_POINT = 1e-3, 1e-9


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
        Wanted number of contacts, without ends of slides; None for any, until a stop rule or the
        policy ends.
    space
        Position and size of the object, or the region that contains it; the hand approaches from
        outside of what is known, and avoids it. None leaves the approach to the prober.
    prior
        Contacts known before the first touch, for example of a camera; None for none. The surface
        is estimated from them and the touches, and touches go where both are missing. They are no
        part of the result, and wait while the tracker has lost the object.
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
    slide
        Length of slides after touches [m]; 0, and with a tracker, for none.

    Raises
    ------
    InvalidOptionError
        If `touches` is below 1, or `slide` below 0.
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
    slide: float = 0.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.touches is not None:
            require_at_least(1, touches=self.touches)
        require_at_least(0, slide=self.slide)


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
    before: Estimate | None = None  #: the map before a loss, while later contacts are another
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

        The probes after the last of these contacts are left out.
        """
        contacts, used = Contacts.empty(), 0
        for used in range(1, len(outcomes) + 1):
            contacts = contacts_after(contacts, outcomes[:used], touches)
            if touches is not None and touches_made(contacts, outcomes[:used]) >= touches:
                break
        return cls(contacts, tuple(outcomes[:used]), "replayed")

    def first(self, touches: int) -> Contacts:
        """Return the first contacts, and the free space known when the last of them was made."""
        return self.replay(self.outcomes, touches=touches).contacts

    @property
    def touches(self) -> tuple[ProbeOutcome, ...]:
        """The outcome that made each contact, in the contacts' order."""
        outcomes = reversed(present_map(self.outcomes))
        makers = {
            point.tobytes(): outcome for outcome in outcomes for point in outcome.contacts.points
        }
        return tuple(makers[p.tobytes()] for p in self.contacts.points if p.tobytes() in makers)

    @property
    def made(self) -> int:
        """How many of the contacts are touches, and no ends of slides."""
        return touches_made(self.contacts, self.outcomes)

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
        slid = len(self.contacts) - self.made
        return (
            f"{counted(len(self.contacts), 'contact')} from {counted(len(self.outcomes), 'probe')}"
            f" ({', '.join(f'{counts[status]} {status}' for status in get_args(ProbeStatus))})"
            + (f", {slid} of them at the ends of slides" if slid else "")
            + (f", {dropped} dropped that later ones contradict" if dropped else "")
        )


def contacts_after(
    contacts: Contacts, outcomes: Sequence[ProbeOutcome], touches: int | None
) -> Contacts:
    """Return the present map's contacts, at most `touches`, after the last outcome."""
    last = outcomes[-1]
    if last.lost or last.joined:
        return contacts_of(maps_of(outcomes)[1], outcomes, touches)
    clock = sum(o.duration for o in outcomes[:-1])
    room = None if touches is None else touches - touches_made(contacts, outcomes[:-1])
    return _with_those_of(contacts, last, clock, room)


def contacts_of(
    of_map: Mapping[int, ProbeOutcome], outcomes: Sequence[ProbeOutcome], touches: int | None
) -> Contacts:
    """Return the contacts of a map, one of `maps_of` the outcomes."""
    contacts, ours = Contacts.empty(), list(of_map.values())
    for k, (i, outcome) in enumerate(of_map.items()):
        clock = sum(before.duration for before in outcomes[:i])
        room = None if touches is None else touches - int(are_touches(contacts, ours[:k]).sum())
        contacts = _with_those_of(contacts, outcome, clock, room)
    return contacts


def _with_those_of(
    contacts: Contacts, outcome: ProbeOutcome, clock: float, room: int | None
) -> Contacts:
    """Return the contacts with at most `room` of an outcome `clock` [s] after the first began."""
    if outcome.repeated or outcome.doubted:
        room = 0  # it measures the pose, and nothing new of the surface
    rows = new_contacts(contacts, outcome.contacts)
    made = rows < len(outcome.contacts) - outcome.slid
    new = outcome.contacts.subset(np.append(rows[made][:room], rows[~made][:room]))
    # The outcome's free space counts; a prober may repeat it in its contacts.
    added = replace(
        new,
        free_points=outcome.free_points,
        free_radii=outcome.free_radii,
        times=None if new.times is None else new.times + clock,
    )
    contacts, kept = contacts.append(added), np.ones(len(contacts) + len(added), dtype=bool)
    for point in outcome.dropped:
        kept &= np.any(np.abs(contacts.points - point) > _SAME_POINT, axis=1)
    return contacts if kept.all() else contacts.subset(kept)


def new_contacts(known: Contacts, contacts: Contacts) -> IndexArray:
    """Return the rows of contacts that are more than 1 mm from known ones, and from each other."""
    points = known.points
    rows = []
    for i, point in enumerate(contacts.points):
        if np.all(np.linalg.norm(points - point, axis=1) > _SAME_CONTACT):
            rows.append(i)
            points = np.vstack([points, point])
    return np.array(rows, dtype=np.intp)
