"""State of an exploration, the next probe, and the result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import get_args

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import counted
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.neighbours import Neighbours
from lis_grasp.exploration.observations import Maps, Observation
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.prior import PriorKnowledge
from lis_grasp.exploration.probe import Probe, ProbeOutcome, ProbeStatus, are_touches
from lis_grasp.exploration.stopping import StopRule
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ExplorationState(Record):
    """Everything known after some probes. It never changes: `advance` makes the next one."""

    observations: tuple[Observation, ...] = ()  #: by every probe, in order
    contacts: Contacts = field(default_factory=Contacts.empty)  #: made by touches, in O
    maps: Maps = field(default_factory=Maps)
    #: estimated from all contacts, before free space is removed; None without contacts
    estimated: DeferredEstimate | None = None
    surface: ImplicitSurface | None = None  #: the estimate without the free space
    is_new: bool = False  #: whether the surface was estimated anew after the last probe
    #: the estimate of the map before a loss, while later contacts are on another
    waiting: DeferredEstimate | None = None
    belief: PoseBelief | None = None  #: about the object's pose; None if it is not tracked
    beside: Neighbours | None = None  #: known bodies in the frame of the first probe; None alone
    again: Probe | None = None  #: of a landmark, to be touched again before anything new
    #: poses (4, 4) of the object's new frames by the last probe, each in the one before
    frames: tuple[FloatArray, ...] = ()
    rules: tuple[StopRule, ...] = ()  #: stop rules, with their memory of earlier estimates
    wanted: int | None = None  #: touches, beyond which contacts are left out; None for any number
    duration: float = 0.0  #: of the probes [s]
    homeward: float = 0.0  #: time of the robot's way home at the end [s]
    ended: str = ""  #: why the exploration ended; empty before
    given: PriorKnowledge = field(init=False)  #: known beside the touches, on the present map
    known: Contacts = field(init=False)  #: prior contacts, then those of the touches

    __repr__ = short_repr

    def __post_init__(self) -> None:
        given = self.maps.present.prior.given(self.contacts)
        object.__setattr__(self, "given", given)
        object.__setattr__(self, "known", given.contacts.append(self.contacts))

    @property
    def prior(self) -> Contacts:
        """Contacts of the present map that are known beforehand."""
        return self.given.contacts

    @property
    def touched(self) -> Contacts:
        """The known contacts without those that were only seen."""
        return self.known[len(self.given.seen) :] if len(self.given.seen) else self.known

    @property
    def neighbours(self) -> Neighbours | None:
        """Known bodies beside the object in the frame of the contacts; None without any."""
        beside, belief = self.beside, self.belief
        return beside if beside is None or belief is None else beside.in_frame(belief.X_WE)

    @property
    def outcomes(self) -> tuple[ProbeOutcome, ...]:
        """Outcome of every probe so far, in order."""
        return tuple(observation.outcome for observation in self.observations)

    @property
    def made(self) -> int:
        """Number of contacts that are touches, not ends of slides."""
        return int(are_touches(self.contacts, self.maps.present.outcomes).sum())

    @property
    def result(self) -> Exploration:
        """The exploration so far."""
        return Exploration(self.contacts, self.observations, self.ended, self.homeward)


@dataclass(frozen=True, slots=True, eq=False)
class NextProbe(Record):
    """The next probe of an exploration, and what the hand avoids on its approach."""

    probe: Probe
    obstacles: ObstacleModel | None  #: None if the approach is left to the prober
    refused: tuple[ProbeOutcome, ...] = ()  #: chosen before it, but no finger reaches them


@dataclass(frozen=True, slots=True, eq=False)
class Exploration(Record):
    """Result of an exploration: the robot's knowledge, without the true object."""

    contacts: Contacts  #: in O, without duplicates; has all free space
    observations: tuple[Observation, ...]  #: by every probe, in order
    ended: str = ""  #: why it ended
    homeward: float = 0.0  #: time of the robot's way home at the end [s]

    __repr__ = short_repr

    @classmethod
    def replay(
        cls, observations: Sequence[Observation], *, touches: int | None = None
    ) -> Exploration:
        """Rebuild an exploration from its record, as if it had ended after `touches`."""
        contacts, maps, used = Contacts.empty(), Maps(), 0
        for used, observation in enumerate(observations, start=1):
            before, maps = maps, maps.after(observation, observations[: used - 1])
            contacts = maps.contacts_after(before, contacts, touches)
            made = are_touches(contacts, maps.present.outcomes)
            if touches is not None and made.sum() >= touches:
                break
        return cls(contacts, tuple(observations[:used]), "replayed")

    def first(self, touches: int) -> Contacts:
        """Return the first contacts, and the free space known when the last of them was made."""
        return self.replay(self.observations, touches=touches).contacts

    @property
    def outcomes(self) -> tuple[ProbeOutcome, ...]:
        """Outcome of every probe, in order."""
        return tuple(observation.outcome for observation in self.observations)

    @property
    def belief(self) -> PoseBelief | None:
        """Belief about the object's pose at the end; None if it was not tracked."""
        return self.observations[-1].belief if self.observations else None

    @property
    def touches(self) -> tuple[ProbeOutcome, ...]:
        """The outcome that made each contact, in the contacts' order."""
        outcomes = reversed(Maps.of(self.observations).present.outcomes)
        makers = {
            point.tobytes(): outcome for outcome in outcomes for point in outcome.contacts.points
        }
        return tuple(makers[p.tobytes()] for p in self.contacts.points if p.tobytes() in makers)

    @property
    def made(self) -> int:
        """Number of contacts that are touches, not ends of slides."""
        outcomes = Maps.of(self.observations).present.outcomes
        return int(are_touches(self.contacts, outcomes).sum())

    @property
    def touched_beside(self) -> Counter[str]:
        """Number of contacts of each known body beside the object, by its name."""
        return Counter(touch.body for o in self.observations for touch in o.beside)

    @property
    def duration(self) -> float:
        """Total time of the probes, and of the way home [s]."""
        return sum(outcome.duration for outcome in self.outcomes) + self.homeward

    def summary(self) -> str:
        """Return the counts in one line."""
        counts = Counter(outcome.status for outcome in self.outcomes)
        dropped = sum(len(observation.dropped) for observation in self.observations)
        slid = len(self.contacts) - self.made
        return (
            f"{counted(len(self.contacts), 'contact')} from {counted(len(self.outcomes), 'probe')}"
            f" ({', '.join(f'{counts[status]} {status}' for status in get_args(ProbeStatus))})"
            + (f", {slid} of them at the ends of slides" if slid else "")
            + (f", {dropped} dropped that later ones contradict" if dropped else "")
        )
