"""The loop of touching, estimating and choosing again, and the record of how it went."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.known_shape import KnownShape
from lis_grasp.exploration.policy import Policy
from lis_grasp.exploration.probe import HandPose, ProbeOutcome, Prober, ProbeStatus
from lis_grasp.exploration.stopping import StopRule
from lis_grasp.exploration.tactile_sensor import TactileSensor
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface, carved

# Two contacts closer than this are one contact felt twice [m].
_SAME_CONTACT = 1e-3
# Probes that an exploration may take, for each touch and on top, before it gives up.
_PROBES_PER_TOUCH, _SPARE_PROBES = 4, 20


@dataclass(frozen=True, slots=True, eq=False)
class Exploration:
    """How an exploration went.

    Parameters
    ----------
    contacts
        What was felt, in O, without duplicates, and every place found free.
    outcomes
        Every probe and what came of it, in order.
    ended
        Why it came to its end.
    """

    contacts: Contacts
    outcomes: tuple[ProbeOutcome, ...]
    ended: str = ""

    @classmethod
    def replay(cls, outcomes: Sequence[ProbeOutcome], *, touches: int | None = None) -> Exploration:
        """Return the exploration that a log tells of: the same contacts, without a hand.

        Parameters
        ----------
        outcomes
            Every probe and what came of it, in order.
        touches
            Contacts to keep at the most; None for all.
        """
        contacts, clock = Contacts.empty(), 0.0
        for outcome in outcomes:
            contacts = _with_outcome(contacts, outcome, clock, touches)
            clock += outcome.duration
        return cls(contacts, tuple(outcomes), "replayed")

    def first(self, touches: int) -> Contacts:
        """Return the first contacts, and what was known to be free when the last of them was felt.

        Parameters
        ----------
        touches
            How many contacts; all where there are no more.
        """
        contacts, clock = Contacts.empty(), 0.0
        for outcome in self.outcomes:
            if len(contacts) >= touches:
                break
            contacts = _with_outcome(contacts, outcome, clock, touches)
            clock += outcome.duration
        return contacts

    @property
    def touches(self) -> tuple[ProbeOutcome, ...]:
        """The outcome that made each contact, in the contacts' order."""
        contacts, touches = Contacts.empty(), list[ProbeOutcome]()
        for outcome in self.outcomes:
            before = len(contacts)
            contacts = _with_outcome(contacts, outcome, 0.0, len(self.contacts))
            touches += [outcome] * (len(contacts) - before)
        return tuple(touches)

    @property
    def hand_poses(self) -> tuple[HandPose | None, ...]:
        """Where the hand was at each contact, in the contacts' order; None where not known."""
        return tuple(outcome.hand_pose for outcome in self.touches)

    @property
    def touched(self) -> int:
        """Number of probes that felt something."""
        return self._count("touched")

    @property
    def missed(self) -> int:
        """Number of probes that went to their end and felt nothing."""
        return self._count("missed")

    @property
    def blocked(self) -> int:
        """Number of probes that could not be carried out."""
        return self._count("blocked")

    @property
    def duration(self) -> float:
        """Time that all probes took [s]."""
        return sum(outcome.duration for outcome in self.outcomes)

    def summary(self) -> str:
        """Return the counts in one line."""
        return (
            f"{_count(len(self.contacts), 'contact')} from {_count(len(self.outcomes), 'probe')}"
            f" ({self.touched} touched, {self.missed} missed, {self.blocked} blocked)"
        )

    def _count(self, status: ProbeStatus) -> int:
        return sum(outcome.status == status for outcome in self.outcomes)


def explore(
    prober: Prober,
    policy: Policy,
    estimate: Callable[[Contacts], ImplicitSurface],
    *,
    touches: int,
    rng: np.random.Generator,
    space: Workspace | None = None,
    sensor: TactileSensor | None = None,
    stop: Sequence[StopRule] = (),
    max_probes: int | None = None,
    recorded: Sequence[ProbeOutcome] = (),
    record: Callable[[ProbeOutcome], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    observe: Callable[[int, ImplicitSurface], None] | None = None,
) -> Exploration:
    """Touch an object again and again, each time where the surface estimated so far suggests.

    Ends with `touches` contacts, or when a rule says stop, or when the policy knows no further
    probe, or when `max_probes` are made: fewer contacts than asked for are a result, not an error.

    Every probe draws from a generator of its own, so an exploration that goes on from its recorded
    outcomes makes the same probes as one that was never interrupted.

    Parameters
    ----------
    prober
        Carries out probes.
    policy
        Chooses them.
    estimate
        Estimates the surface from at least one contact; done anew after every new contact. What the
        hand passed through is carved off before the surface is used.
    touches
        Contacts to make.
    rng
        For every draw of policy and sensor.
    space
        Where the object is; the hand comes in from outside of it, past what is known. None leaves
        it to the prober how it gets to where a probe starts.
    sensor
        Reports what the prober meets; None for one that reports it as it is.
    stop
        Rules that end the exploration early, asked after every probe once there is an estimate.
    max_probes
        Probes to make at the most; None for a number that leaves room for misses.
    recorded
        Outcomes of an interrupted exploration, to go on from.
    record
        Called with every new outcome, before anything else is made of it.
    progress
        Called after every probe with the contacts made and those wanted.
    observe
        Called with the number of contacts and the surface estimated from them, free space carved
        off, whenever the surface has been estimated.

    Raises
    ------
    InvalidOptionError
        If `touches` or `max_probes` is below 1.
    """
    if max_probes is None:
        max_probes = _PROBES_PER_TOUCH * touches + _SPARE_PROBES
    for name, value in (("touches", touches), ("max_probes", max_probes)):
        if value < 1:
            raise InvalidOptionError(f"{name} must be at least 1; it is {value}")
    rng.spawn(len(recorded))  # used up already
    outcomes = list(recorded)
    contacts = Exploration.replay(outcomes, touches=touches).contacts
    clock = 0.0
    for outcome in outcomes:  # as below; `sum` compensates for rounding from Python 3.12 on
        clock += outcome.duration
    margin = 0.0 if sensor is None else sensor.free_margin
    estimated: ImplicitSurface | None = None
    estimated_from = 0  # contacts
    while True:
        is_new = len(contacts) > estimated_from
        if is_new:
            estimated, estimated_from = estimate(contacts), len(contacts)
        surface = None if estimated is None else carved(estimated, contacts, margin=margin)
        if observe is not None and is_new and surface is not None:
            observe(len(contacts), surface)
        ended = _reason_to_end(contacts, surface, outcomes, touches, max_probes, stop)
        if ended:
            return Exploration(contacts, tuple(outcomes), ended)
        draws = rng.spawn(1)[0]
        probe = policy.next_probe(contacts, estimated, outcomes=outcomes, rng=draws)
        if probe is None:
            return Exploration(contacts, tuple(outcomes), "nothing is left that is worth a touch")
        known = None if space is None else KnownShape(space, contacts, surface)
        outcome = prober.probe(probe, known)
        if sensor is not None:
            outcome = sensor.report(outcome, rng=draws)
        if record is not None:
            record(outcome)
        outcomes.append(outcome)
        contacts = _with_outcome(contacts, outcome, clock, touches)
        clock += outcome.duration
        if progress is not None:
            progress(len(contacts), touches)


def _reason_to_end(
    contacts: Contacts,
    surface: ImplicitSurface | None,
    outcomes: Sequence[ProbeOutcome],
    touches: int,
    max_probes: int,
    stop: Sequence[StopRule],
) -> str | None:
    if len(contacts) >= touches:
        return f"{_count(len(contacts), 'contact')} made"
    if len(outcomes) >= max_probes:
        return f"{_count(len(outcomes), 'probe')} made"
    if surface is not None:
        for rule in stop:
            reason = rule.reason_to_stop(contacts, surface, outcomes)
            if reason:
                return reason
    return None


def _with_outcome(
    contacts: Contacts, outcome: ProbeOutcome, clock: float, touches: int | None
) -> Contacts:
    """Return the contacts and what an outcome adds to them, `clock` seconds after the first."""
    room = None if touches is None else touches - len(contacts)
    new = outcome.contacts.subset(_new_contacts(contacts, outcome)[:room])
    # What was free is told by the outcome; a prober may have it in its contacts as well.
    felt = replace(
        new,
        free_points=outcome.free_points,
        free_radii=outcome.free_radii,
        times=None if new.times is None else new.times + clock,
    )
    return contacts.append(felt)


def _new_contacts(known: Contacts, outcome: ProbeOutcome) -> npt.NDArray[np.intp]:
    """Return the rows of an outcome's contacts that coincide with no contact before them."""
    points = known.points
    rows = []
    for i, point in enumerate(outcome.contacts.points):
        if np.all(np.linalg.norm(points - point, axis=1) > _SAME_CONTACT):
            rows.append(i)
            points = np.vstack([points, point])
    return np.array(rows, dtype=np.intp)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
