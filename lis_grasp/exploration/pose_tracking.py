"""Pose tracking of an object that touches move: a Kalman filter on contacts and the estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import require_at_least
from lis_grasp.exploration.observations import Landmark, Observation
from lis_grasp.exploration.planar_motion import PoseBelief, PoseTrust, push_of
from lis_grasp.exploration.probe import HandPose, PassedWay, Probe, ProbeOutcome
from lis_grasp.exploration.states import ExplorationState
from lis_grasp.geometry import relative_rotation
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

# A contact this far off certain surface, in standard deviations and [m], shows a large motion,
# with these standard deviations of x, y [m] and yaw [rad].
_CONTRADICTION, _FAR, _LARGE_MOTION = 5.0, 0.003, (0.015, 0.015, 0.3)
# A landmark's probe begins this far before its contact when it is repeated [m].
_BEFORE_AGAIN = 0.03
# The hand is slow from this far before it, plus two standard deviations of the pose [m].
_SLOW_AGAIN = 0.012
# From this many standard deviations on, it is suspicious: a known place is probed again.
_SUSPICIOUS = 2.0
# A contact this deep inside free space, in standard deviations and [m], shows a motion too.
_DEEP, _DEPTH = 4.0, 0.004
# After a contradiction, the object is found when all contacts are this certain again [m], and lost
# after this many probes. A second contradiction counts twice; soon after a find it is a loss.
_FOUND, _LOST_AFTER = 0.003, 6
# Least cosine between the normals of a place and of its repetition, else it met another side; and
# of the hand's turn, else it is no repetition: another roll leads the finger to another place.
_SAME_SIDE = 0.87
# A place is touched again when its position is this uncertain [m], and this many times more than
# a touch makes it.
_UNCERTAIN, _WORTHWHILE = 0.0008, 2.0
# The first touches show how far they move the object; then at most one of this many is a repeat,
# unless the next contact could hardly be used.
_OF_TOUCHES = 6
# Contacts of more uncertain position [m] are not used.
_UNUSABLE = 0.004
# Fewer contacts are too few to recognise a motion; then this many probes in a row without a contact
# show that the object is somewhere else.
_FEW, _NOTHING_LEFT = 5, 12
# A contact this near an earlier one [m] measures the distance from its tangent plane, which the
# surface leaves by this fraction of the distance in it.
_NEAR, _BEND = 0.003, 0.1
# Error of a distance computed with the gradient, as a fraction of it, and at least [m].
_NONLINEAR, _LEAST_ERROR = 0.1, 1e-4

MOVED = "the object moved too far to place the contact"
LOST = "the object is no longer where it was: a second map begins"
JOINED = "the object is found again: its maps are joined"


@dataclass(frozen=True, slots=True)
class PoseTracker:
    """Estimates how touches move an object on a table, and keeps its contacts in its own frame.

    The state is the planar displacement (x, y, yaw) of the object from the frame E of contacts and
    estimate (`PoseBelief`). After each touch E moves by the mean. A touch pushes the object against
    the contact's normal (`push_of`). The measurement is that a contact is on the surface estimated
    before it:

        d(p) = n . (t + yaw z x p) + noise

    where d is the value f of the estimate over the length of its gradient, n is the unit gradient,
    and the noise is that of the estimate and the sensor. Where the surface
    is unknown, a contact says little about the pose. When the pose has become uncertain, an earlier
    probe is repeated.

    A repeated probe far off its first contact, or free space where contacts were, shows a large
    motion: the pose becomes uncertain, and the next touches register it. If they contradict the
    estimate too, the object has toppled or rolled away, and a second map begins (`Maps`).

    Parameters
    ----------
    position_noise
        One standard deviation of a contact's position [m].

    Raises
    ------
    InvalidOptionError
        If the noise is negative.
    """

    position_noise: float = 0.0

    def __post_init__(self) -> None:
        require_at_least(0, position_noise=self.position_noise)

    def probe_again(self, state: ExplorationState) -> Probe | None:
        """Return the probe that touches a landmark again, as the pose is uncertain, or None.

        It is the one whose contact's position along its normal is least certain.
        """
        present, belief = state.maps.present, state.belief
        touches, observations = present.landmarks, state.observations
        repeated = sum(entry.observation.is_repeated for entry in present.entries)
        spent = _OF_TOUCHES * (repeated - 1) >= len(touches)
        if belief is None or not touches:
            return None
        in_doubt = belief.trust == "doubted"
        if belief.repeated and not in_doubt:
            return None
        # A blocked probe would be blocked again; while in doubt, each is repeated once.
        count, doubts = len(observations), belief.count if in_doubt else 0
        tried = [
            outcome.probe.target
            for i, outcome in enumerate(state.outcomes)
            if outcome.status == "blocked" or i >= count - doubts
        ]
        if tried:
            near = cdist([touch.probe.target for touch in touches], tried).min(axis=1)
            touches = [touches[i] for i in np.flatnonzero(near > _NEAR)]
        if not touches:
            return None
        if belief.suspicious and not spent:
            return _from_near(_sideways(touches, observations[-1].outcome))
        points = np.array([touch.contacts.points[0] for touch in touches])
        normals = np.array([touch.contacts.normals[0] for touch in touches])
        deviations = np.sqrt(belief.variances(points, normals))
        best = int(np.argmax(deviations))
        least = max(_UNCERTAIN, _WORTHWHILE * belief.push_deviation)
        if deviations[best] < (max(least, 0.5 * _UNUSABLE) if spent else least):
            return None
        beyond = 2.0 * float(deviations[best])
        # After one contact, only the landmark's own way is known to be free.
        few, touch = len(state.known) < 2, touches[best]
        again = touch.probe if few else _from_near(touch, beyond)
        at, margin = touch.hand_pose, _SLOW_AGAIN + beyond
        way = None if at is None else PassedWay(at.X_OH, margin)
        return replace(again, overshoot=again.overshoot + beyond, passed=way)

    def track(
        self, outcome: ProbeOutcome, state: ExplorationState
    ) -> tuple[Observation, tuple[FloatArray, ...]]:
        """Return an outcome in the object's new frame, with the belief about its pose.

        The second result has the poses (4, 4) of successive new frames, each in the one before;
        later probes are in the last one. `state` is the one before the probe; if it asked for a
        landmark, the probe touched it.
        """
        known, recent, repeated = state.touched, state.maps.present, state.again is not None
        belief = replace(state.belief or PoseBelief.start(), joined=None)
        contacts = outcome.contacts
        certain = state.estimated if len(state.known) >= _FEW else None
        contradicted = certain is not None and _free_where_touched(outcome, known, belief)
        target = outcome.probe.target
        same = [o for o in recent.landmarks if np.array_equal(o.probe.target, target)]
        same = [o for o in same if _turned_alike(o.hand_pose, outcome.hand_pose)]
        place = next((landmark.contacts.subset([0]) for landmark in same if repeated), None)
        if place is not None:  # missed, or met on another side; an edge has two sides
            alike = contacts.normals @ place.normals[0] > _SAME_SIDE
            alike |= np.linalg.norm(contacts.points - place.points[0], axis=1) < _FAR
            contradicted |= outcome.status == "missed" or (len(alike) > 0 and not alike.any())
        push = push_of(contacts, state.known) if len(contacts) else None
        usable, suspicious = True, False
        if push is not None:
            belief = belief.pushed(push, detected=False)
            belief, surprise = self._measured(belief, contacts, place or known, certain, place)
            # Elsewhere the estimate may be wrong: only a known place is evidence of a motion.
            usable = surprise <= _CONTRADICTION
            contradicted |= place is not None and not usable
            suspicious = surprise > _SUSPICIOUS
            deviations = np.sqrt(belief.variances(contacts.points, contacts.normals))
            usable &= not (
                contradicted or belief.trust == "doubted" or deviations.max() > _UNUSABLE
            )
            noise = np.hypot(self.position_noise, deviations)
            outcome = replace(outcome, contacts=replace(contacts, position_noise=noise))
        belief, X_EC = belief.centered()  # C is the frame at the contacts
        outcome = outcome.in_frame(X_EC)
        if push is not None:
            belief = belief.pushed(push, detected=True)
        belief = _judged(belief, known, contradicted=contradicted)
        belief, X_CF = belief.centered()
        belief = replace(belief, repeated=repeated, suspicious=suspicious and not repeated)
        if belief.trust == "lost" or _nothing_left([*recent.outcomes, outcome], known):
            belief = replace(PoseBelief.start(), X_WE=belief.X_WE, trust="lost")
            new = outcome.contacts
            if len(new):  # they define the new frame: it has no doubt of the old pose
                new = replace(new, position_noise=np.full(len(new), self.position_noise))
            outcome = replace(outcome, contacts=new, reason=LOST)
        elif not usable:
            kept = outcome.contacts if belief.trust == "doubted" else Contacts.empty()
            kept = replace(kept, position_noise=np.full(len(kept), self.position_noise))
            outcome = replace(outcome, status="blocked", contacts=kept, reason=MOVED)
        return Observation(outcome, belief), (X_EC, X_CF)

    def joined(
        self, observation: Observation, X_EF: FloatArray, covariance: FloatArray
    ) -> Observation:
        """Return an observation that joins the contacts since a loss to the earlier map F in E."""
        observation, start = observation.on_map(X_EF), PoseBelief.start()
        covariances = start.covariances + covariance
        belief = replace(observation.belief or start, means=start.means, covariances=covariances)
        belief = replace(belief, trust="trusted", count=0, joined=X_EF)
        outcome = replace(observation.outcome, reason=JOINED)
        return replace(observation, outcome=outcome, belief=belief)

    def _measured(
        self,
        belief: PoseBelief,
        contacts: Contacts,
        known: Contacts,
        surface: ImplicitSurface | None,
        place: Contacts | None,
    ) -> tuple[PoseBelief, float]:
        """Return the belief after contacts, and the largest innovation in standard deviations.

        Innovations of a few millimetres do not count.
        """
        surprise = 0.0
        for point in contacts.points:
            measurement = _to_plane(point, known, self.position_noise, near=place is None)
            if measurement is None and surface is not None:
                measurement = _to_surface(point, surface)
            if measurement is None:
                continue
            normal, distance, variance = measurement
            variance += self.position_noise**2 + (_NONLINEAR * distance) ** 2 + _LEAST_ERROR**2
            off, deviation = belief.innovation(point, normal, distance, variance)
            if abs(off) > _FAR:
                surprise = max(surprise, abs(off) / deviation)
            belief = belief.measured(point, normal, distance, variance)
        return belief, surprise


def doubted() -> PoseBelief:
    """Return the belief after a large motion: the object must be found again."""
    return replace(PoseBelief.start().loosened(np.array(_LARGE_MOTION)), trust="doubted")


def _judged(belief: PoseBelief, known: Contacts, *, contradicted: bool) -> PoseBelief:
    """Return the belief in its next state of trust, loosened by a contradiction."""
    count = belief.count + 1
    if contradicted:
        belief = belief.loosened(np.array(_LARGE_MOTION))
        if belief.trust == "on_probation":
            return replace(belief, trust="lost", count=0)
        count += belief.trust == "doubted"
    elif belief.trust == "doubted":
        worst = float(belief.variances(known.points, known.normals).max(initial=0.0))
        if worst < _FOUND**2:
            return replace(belief, trust="on_probation", count=_FEW)
    else:
        on_probation = belief.trust == "on_probation" and belief.count > 1
        trust: PoseTrust = "on_probation" if on_probation else "trusted"
        return replace(belief, trust=trust, count=max(belief.count - 1, 0))
    return replace(belief, trust="doubted" if count <= _LOST_AFTER else "lost", count=count)


def _to_plane(
    point: FloatArray, known: Contacts, noise: float, *, near: bool
) -> tuple[FloatArray, float, float] | None:
    """Return normal (3,), distance [m] and its variance to the plane of a near contact, or None.

    Of the contact's noise only the sensor's counts: both places have the tracked pose in common.
    """
    if not len(known):
        return None
    offsets = point - known.points
    nearest = int(np.argmin(np.linalg.norm(offsets, axis=1)))
    normal, offset = known.normals[nearest], offsets[nearest]
    distance = float(offset @ normal)
    aside = float(np.linalg.norm(offset - distance * normal))
    if near and (aside > _NEAR or abs(distance) > _FAR):
        return None
    return normal, distance, (_BEND * aside) ** 2 + noise**2


def _to_surface(
    point: FloatArray, surface: ImplicitSurface
) -> tuple[FloatArray, float, float] | None:
    """Return normal (3,), distance [m] and its variance to an estimate, or None."""
    gradient = surface.gradient(point)
    steepness = float(np.linalg.norm(gradient))
    if steepness == 0.0:
        return None
    return (
        gradient / steepness,
        float(surface.evaluate(point)) / steepness,
        float(surface.uncertainty(point)) ** 2,
    )


def _nothing_left(outcomes: Sequence[ProbeOutcome], known: Contacts) -> bool:
    """Return whether probes no longer meet an object of few known contacts."""
    last = outcomes[-_NOTHING_LEFT:]
    touched = any(outcome.status == "touched" for outcome in last)
    return 0 < len(known) < _FEW and len(last) == _NOTHING_LEFT and not touched


def _turned_alike(first: HandPose | None, second: HandPose | None) -> bool:
    """Return whether the hand had about the same rotation in two touches, as far as is known."""
    if first is None or second is None:
        return True
    R = relative_rotation(first.X_OH, second.X_OH)
    return bool(0.5 * (np.trace(R) - 1.0) > _SAME_SIDE)


def _from_near(touch: Landmark, deviation: float = 0.0) -> Probe:
    """Return the probe of a landmark, begun just before its contact: the way there is known."""
    probe, point = touch.probe, touch.contacts.points[0]
    before = float((probe.target - point) @ probe.direction) + _BEFORE_AGAIN + deviation
    return replace(probe, standoff=float(np.clip(before, 0.0, probe.standoff)))


def _sideways(touches: Sequence[Landmark], last: ProbeOutcome) -> Landmark:
    """Return the landmark, other than the last, whose side faces most like it."""
    others = [touch for touch in touches if touch.probe is not last.probe] or list(touches)
    normal = last.contacts.normals[0] if len(last.contacts) else -last.probe.direction
    alike = [abs(touch.contacts.normals[0][:2] @ normal[:2]) for touch in others]
    return others[int(np.argmax(alike))]


def _free_where_touched(outcome: ProbeOutcome, known: Contacts, belief: PoseBelief) -> bool:
    """Return whether a known contact is deep inside the free space of a probe."""
    if not len(outcome.free_radii):
        return False
    depths = (outcome.free_radii - cdist(known.points, outcome.free_points)).max(axis=1)  # (N,)
    deviations = np.sqrt(belief.variances(known.points, known.normals))
    return bool(np.any(depths > np.maximum(_DEEP * deviations, _DEPTH)))
