"""Observations of an object by probes, and the maps that they make of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.neighbours import BodyTouch
from lis_grasp.exploration.planar_motion import PoseBelief
from lis_grasp.exploration.prior import NOTHING, Prior
from lis_grasp.exploration.probe import HandPose, Probe, ProbeOutcome, ProbeStatus, are_touches
from lis_grasp.geometry import apply_pose, inverse_pose
from lis_grasp.records import Record, short_repr
from lis_grasp.typing import FloatArray, IndexArray

# Contacts closer than this are duplicates, and points the same [m].
_SAME_CONTACT, _SAME_POINT = 1e-3, 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Observation(Record):
    """What a probe showed of an object: its outcome, the object's pose, and strays before it.

    Examples
    --------
    >>> missed = ProbeOutcome(Probe([0, 0, 0.1], [0, 0, -1], 0.05, 0.05), "missed")
    >>> Observation(missed).is_lost
    False
    """

    #: contacts are in the object's frame after the probe, the probe in the frame before it
    outcome: ProbeOutcome
    belief: PoseBelief | None = None  #: about the object's pose after it; None if not tracked
    #: (D, 3) [m], in O: points of earlier contacts that turned out to be strays
    dropped: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    beside: tuple[BodyTouch, ...] = ()  #: its contacts of known bodies beside the object
    #: blocked, before the probe was chosen: no finger reaches them between known bodies
    refused: tuple[ProbeOutcome, ...] = ()

    __repr__ = short_repr

    @property
    def is_repeated(self) -> bool:
        """Whether the probe touched a landmark again, to track the object's pose."""
        return self.belief is not None and self.belief.repeated

    @property
    def is_lost(self) -> bool:
        """Whether the probe showed that the tracked object is somewhere else."""
        return self.belief is not None and self.belief.trust == "lost"

    @property
    def is_joined(self) -> bool:
        """Whether the probe showed where the contacts since a loss are on the map before it."""
        return self.belief is not None and self.belief.joined is not None

    @property
    def is_doubted(self) -> bool:
        """Whether the pose of the tracked object is in doubt, so that contacts wait."""
        return self.belief is not None and self.belief.trust == "doubted"

    def on_map(self, X_EF: FloatArray, X_PF: FloatArray | None = None) -> Observation:
        """Return the observation and its probe, given in P, in the frame F of another map."""
        probe, belief = self.outcome.probe, self.belief
        return replace(
            self,
            outcome=replace(
                self.outcome.in_frame(X_EF), probe=probe.in_frame(X_EF if X_PF is None else X_PF)
            ),
            dropped=apply_pose(inverse_pose(X_EF), self.dropped),
            belief=belief and replace(belief, X_WE=belief.X_WE @ X_EF),
        )

    def begins_map(self, X_WP: FloatArray, X_WF: FloatArray) -> Observation:
        """Return one in doubt, of a probe in P, on a new map F of an object that rests."""
        assert self.belief is not None
        X_EF, X_PF = (inverse_pose(X) @ X_WF for X in (self.belief.X_WE, X_WP))
        belief = replace(self.belief, trust="trusted", repeated=False)
        status: ProbeStatus = "touched" if len(self.outcome.contacts) else self.outcome.status
        outcome = replace(self.outcome, status=status)
        return replace(self, outcome=outcome, belief=belief).on_map(X_EF, X_PF)


@dataclass(frozen=True, slots=True, eq=False)
class Landmark(Record):
    """A known place of an object, and the probe that touches it again to show where it is."""

    probe: Probe
    contacts: Contacts  #: of a touch there, in the frame of the probe; the first is the place
    hand_pose: HandPose | None = None  #: of the touch; None if it is not known


@dataclass(frozen=True, slots=True, eq=False)
class MapEntry(Record):
    """An observation in the frame of a map."""

    number: int  #: of the probe
    began: float  #: time of the probe since the first one began [s]
    observation: Observation


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMap(Record):
    """What is known of an object in one frame: beforehand, and by observations."""

    prior: Prior = NOTHING  #: known beforehand, not by touches
    known: tuple[Landmark, ...] = ()  #: touched before the first probe
    entries: tuple[MapEntry, ...] = ()

    __repr__ = short_repr

    @property
    def outcomes(self) -> list[ProbeOutcome]:
        """Outcomes of the probes, in order."""
        return [entry.observation.outcome for entry in self.entries]

    @property
    def attempts(self) -> list[ProbeOutcome]:
        """Outcomes of the probes, in order, and of those that were refused before each."""
        observations = (entry.observation for entry in self.entries)
        return [outcome for o in observations for outcome in (*o.refused, o.outcome)]

    @property
    def landmarks(self) -> list[Landmark]:
        """All known landmarks: those from before, and one of each probe that touched."""
        touches = (outcome for outcome in self.outcomes if outcome.status == "touched")
        return [*self.known, *(Landmark(o.probe, o.contacts, o.hand_pose) for o in touches)]

    @property
    def size(self) -> int:
        """How many contacts were made, repeated ones too."""
        return len(self.known) + sum(len(outcome.contacts) for outcome in self.outcomes)

    def first_contacts(self) -> Contacts:
        """Return the contacts that were touched before the first probe, without duplicates."""
        contacts = Contacts.empty()
        for landmark in self.known:
            rows = new_contacts(contacts, landmark.contacts)
            new = landmark.contacts.subset(rows)
            none = replace(new, free_points=np.empty((0, 3)), free_radii=np.empty(0))
            contacts = contacts.append(none)
        return contacts

    def contacts(self, wanted: int | None) -> Contacts:
        """Return the contacts made by touches, at most `wanted` of them and ends of slides."""
        contacts, outcomes = self.first_contacts(), self.outcomes
        for k, entry in enumerate(self.entries):
            contacts = _with_those_of(contacts, outcomes[:k], entry, wanted)
        return contacts


@dataclass(frozen=True, slots=True, eq=False)
class Maps(Record):
    """The present map of an object, and one that waits since the object was lost."""

    present: ObjectMap = field(default_factory=ObjectMap)
    waiting: ObjectMap = field(default_factory=ObjectMap)  #: empty without a loss

    @classmethod
    def of(cls, observations: Sequence[Observation]) -> Maps:
        """Return the maps that observations make."""
        maps = cls()
        for i, observation in enumerate(observations):
            maps = maps.after(observation, observations[:i])
        return maps

    def after(self, observation: Observation, before: Sequence[Observation]) -> Maps:
        """Return the maps after an observation; earlier ones are as they were made.

        A loss begins another map, with the observations in doubt; the larger of the earlier maps
        waits, until an observation joins the present one to it.
        """
        belief, present, waiting = observation.belief, self.present, self.waiting
        if belief is not None and observation.is_lost:
            doubted = [entry for entry in present.entries if entry.observation.is_doubted]
            rest = tuple(entry for entry in present.entries if entry not in doubted)
            waiting = max(waiting, replace(present, entries=rest), key=lambda one: one.size)
            begun = (_begun_again(entry, before, belief.X_WE) for entry in doubted)
            present = ObjectMap(entries=tuple(begun))
        elif belief is not None and belief.joined is not None:
            moved = (
                replace(entry, observation=entry.observation.on_map(belief.joined))
                for entry in present.entries
            )
            present, waiting = replace(waiting, entries=(*waiting.entries, *moved)), ObjectMap()
        clock = sum(o.outcome.duration for o in before)
        entry = MapEntry(len(before), clock, observation)
        return Maps(replace(present, entries=(*present.entries, entry)), waiting)

    def contacts_after(self, before: Maps, contacts: Contacts, wanted: int | None) -> Contacts:
        """Return the present map's contacts, at most `wanted`, continuing from the maps before."""
        last = self.present.entries[-1]
        if last.observation.is_lost or last.observation.is_joined:
            return self.present.contacts(wanted)
        return _with_those_of(contacts, before.present.outcomes, last, wanted)


def _begun_again(entry: MapEntry, before: Sequence[Observation], X_WF: FloatArray) -> MapEntry:
    """Return an entry in doubt on the map F of an object that was lost."""
    last = before[entry.number - 1].belief if entry.number else PoseBelief.start()
    X_WP = X_WF if last is None else last.X_WE
    return replace(entry, observation=entry.observation.begins_map(X_WP, X_WF))


def _with_those_of(
    contacts: Contacts, outcomes: Sequence[ProbeOutcome], entry: MapEntry, wanted: int | None
) -> Contacts:
    """Return the contacts made by outcomes on a map, and those made by its next entry.

    No more are added than are still wanted.
    """
    observation, outcome = entry.observation, entry.observation.outcome
    room = None if wanted is None else wanted - int(are_touches(contacts, outcomes).sum())
    if observation.is_repeated or observation.is_doubted:
        room = 0  # it measures the pose, and nothing new of the surface
    rows = new_contacts(contacts, outcome.contacts)
    made = rows < len(outcome.contacts) - outcome.slid
    new = outcome.contacts.subset(np.append(rows[made][:room], rows[~made][:room]))
    # The outcome's free space counts; a prober may repeat it in its contacts.
    added = replace(
        new,
        free_points=outcome.free_points,
        free_radii=outcome.free_radii,
        times=None if new.times is None else new.times + entry.began,
    )
    contacts, kept = contacts.append(added), np.ones(len(contacts) + len(added), dtype=bool)
    for point in observation.dropped:
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
