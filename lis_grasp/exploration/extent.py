"""Extent of an object on a table: its four level ends, and the probes that find and close them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.contacts import HALF_SPACE, Contacts
from lis_grasp.exploration.observations import Landmark
from lis_grasp.exploration.probe import Probe, ProbeOutcome, ProbeStatus, are_touches
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import unit
from lis_grasp.typing import FloatArray

# Motions to an end begin this far beyond the extreme contact [m]; the next value if blocked.
_BEYOND = (0.1, 0.2, 0.35)
# Most motions to an end, and most probes after the first contact, before the search ends.
_TRIES, _MOST = 3, 12
# A contact closes an end within this many steps of the extreme, if its normal's cosine to the
# outward direction is at least this.
_NEAR, _FACES_OUT = 0.35, float(np.sqrt(0.5))
# A direction is along an end's within 15 degrees: least cosine along it, largest sine across it.
_ALONG, _ACROSS = float(np.cos(np.radians(15.0))), float(np.sin(np.radians(15.0)))
# Contacts of at least this ratio of length to width show the axes; the normals of others do.
_ELONGATED = 2.0
# Sweeps across pass the ends of an object of at least this ratio of length to width.
_LONG = 1.5
# A sweep passes an end at this distance [m], plus this many widths, and is longer on each side.
_PASS, _OBLIQUE, _MARGIN = 0.02, 0.15, 0.03
# Beyond a closed end, space is free at this distance from the extreme contact [m].
_CLEAR = 3e-3
# Displacement of the centre of mass by an unseen end, in known lengths of the object.
_CONTINUES = 0.25
# The first motion down is this far inside of the first contact [m].
_INSIDE = 0.012


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """End of an object in a level direction, as far as contacts and probes show it."""

    out: FloatArray  # (3,), unit, level
    space: Workspace
    contacts: Contacts
    outcomes: Sequence[ProbeOutcome]  # since the first contact
    landmarks: Sequence[Landmark] = ()  # touched before

    @property
    def across(self) -> FloatArray:
        """Level direction across the end, shape (3,)."""
        return np.array([-self.out[1], self.out[0], 0.0])

    @property
    def extreme(self) -> FloatArray:
        """The contact farthest out, shape (3,) [m]."""
        return np.asarray(self.contacts.points[int(np.argmax(self.contacts.points @ self.out))])

    @property
    def tried(self) -> list[ProbeOutcome]:
        """Outcomes of inward motions."""
        return [o for o in self.outcomes if self._is_inward(o.probe)]

    @property
    def touched(self) -> list[Landmark]:
        """Landmarks that inward motions touch."""
        return [landmark for landmark in self.landmarks if self._is_inward(landmark.probe)]

    def _is_inward(self, probe: Probe) -> bool:
        return bool(-(probe.direction @ self.out) > _ALONG)

    @property
    def met(self) -> list[ProbeStatus]:
        """What inward motions meet: first landmarks, then their statuses when they were made."""
        statuses: list[ProbeStatus] = ["touched" for _ in self.touched]
        return statuses + [outcome.status for outcome in self.tried]

    @property
    def is_open(self) -> bool:
        """Whether the end is not closed, and tries are left."""
        return len(self.met) < _TRIES and not self.is_closed

    @property
    def is_closed(self) -> bool:
        """Whether a contact near the extreme shows that the object ends there.

        A contact shows it if its normal faces out, or if an inward motion ended there ahead of the
        tip, as on an upper edge.
        """
        points, normals = self.contacts.points, self.contacts.normals
        found = normals @ self.out > _FACES_OUT
        known = [(landmark.probe, landmark.contacts) for landmark in self.touched]
        for probe, made in (*known, *((o.probe, o.contacts) for o in self.tried)):
            for contact in made:
                aside = abs(float((contact.points[0] - probe.target) @ self.across))
                same = np.linalg.norm(points - contact.points[0], axis=1) < self.space.tip_radius
                found |= same & (aside < self.space.tip_radius) & (normals @ self.out > -0.3)
        near = points @ self.out > self.extreme @ self.out - _NEAR * self.space.step
        return bool((near & found).any())

    @property
    def displacement(self) -> FloatArray:
        """Displacement of the centre of mass by the end if it is unseen, shape (3,) [m].

        The unseen part may be half as long as the known one: one standard deviation.
        """
        return np.asarray(_CONTINUES * float(np.ptp(self.contacts.points @ self.out)) * self.out)

    def __str__(self) -> str:
        x, y = 1e3 * self.extreme[:2]
        return f"the end beyond x = {x:.0f}, y = {y:.0f} mm"

    @property
    def is_passed(self) -> bool:
        """Whether a level motion across passed the end, or met something beyond it."""
        place = float(self.extreme @ self.out)
        return any(
            o.probe.direction[2] == 0.0
            and abs(o.probe.direction @ self.out) < _ACROSS
            and o.probe.target @ self.out > place
            for o in self.outcomes
        )

    def inward(self) -> Probe:
        """Return a level motion to the end, from outside, along the middle of the known part."""
        places, extreme = self.contacts.points @ self.across, self.extreme
        middle = 0.5 * float(places.min() + places.max())
        height = 0.5 * float(self.contacts.points[:, 2].max())
        met = self.met
        if met and met[-1] != "blocked":
            middle = float(extreme @ self.across)
            if met[-1] == "missed":
                height = float(extreme[2]) if len(met) < 2 else 0.0
        beyond = _BEYOND[min(met.count("blocked"), len(_BEYOND) - 1)]
        inside = 0.5 * float(np.ptp(self.contacts.points @ self.out)) + self.space.step
        return Probe(self._place(0.0, middle, height), -self.out, beyond, inside)

    def sweep(self) -> Probe:
        """Return a level motion across, beyond the end, which meets any continuation."""
        places = self.contacts.points @ self.across
        half = 0.5 * float(np.ptp(places))
        beyond = self.space.tip_radius + _PASS + 2.0 * _OBLIQUE * half
        height = 0.5 * float(self.contacts.points[:, 2].max())
        target = self._place(beyond, 0.5 * float(places.min() + places.max()), height)
        return Probe(target, self.across, half + _MARGIN, half + _MARGIN)

    def _place(self, beyond: float, across: float, height: float) -> FloatArray:
        place = (float(self.extreme @ self.out) + beyond) * self.out + across * self.across
        place[2] = max(height, self.space.level_height)
        return np.asarray(place)


def ends_of(
    space: Workspace,
    contacts: Contacts,
    outcomes: Sequence[ProbeOutcome],
    landmarks: Sequence[Landmark] = (),
) -> tuple[End, ...]:
    """Return the four level ends: both along an axis, then both across it.

    `contacts`, at least one, come from the outcomes since the first contact, and from landmarks.
    """
    made = np.flatnonzero(are_touches(contacts, outcomes))
    along = _level_axis(contacts.subset(made) if len(made) else contacts)
    across = np.array([-along[1], along[0], 0.0])
    axes = along, -along, across, -across
    return tuple(End(out, space, contacts, outcomes, landmarks) for out in axes)


def since_first_contact(outcomes: Sequence[ProbeOutcome]) -> Sequence[ProbeOutcome]:
    """Return the outcomes from the first contact on; empty without a contact."""
    first = next((k for k, outcome in enumerate(outcomes) if len(outcome.contacts)), None)
    return () if first is None else outcomes[first:]


def open_ends(space: Workspace, contacts: Contacts, outcomes: Sequence[ProbeOutcome]) -> str:
    """Return in words which ends of an object on a table are still sought; empty if none.

    `contacts` come from the outcomes.
    """
    since = since_first_contact(outcomes)
    if not since or not len(contacts) or len(since) >= _MOST:
        return ""
    return ", ".join(str(end) for end in ends_of(space, contacts, since) if end.is_open)


def free_beyond(space: Workspace, contacts: Contacts, outcomes: Sequence[ProbeOutcome]) -> Contacts:
    """Return the free space beyond closed ends: balls as large as half-spaces, no contacts.

    Only ends that an inward motion touched count: the normal of a shoulder faces out, too.
    For the arguments see `open_ends`.
    """
    ends = ends_of(space, contacts, since_first_contact(outcomes)) if len(contacts) else ()
    closed = [end for end in ends if end.is_closed and any(len(o.contacts) for o in end.tried)]
    centers = [end.extreme + (_CLEAR + HALF_SPACE) * end.out for end in closed]
    radii = np.full(len(closed), HALF_SPACE)
    return replace(Contacts.empty(), free_points=np.reshape(centers, (-1, 3)), free_radii=radii)


def unseen_ends(space: Workspace, contacts: Contacts) -> tuple[End, ...]:
    """Return the ends that neither a contact nor known free space closes."""
    found = []
    for end in ends_of(space, contacts, ()) if len(contacts) else ():
        beyond = end.extreme + _PASS * end.out
        passed = np.linalg.norm(contacts.free_points - beyond, axis=1) < contacts.free_radii
        if end.is_open and not passed.any():
            found.append(end)
    return tuple(found)


def unreached(contacts: Contacts, refused: Sequence[ProbeOutcome], space: Workspace) -> list[str]:
    """Return in words the sides that no contact shows, and no finger reaches between bodies.

    These are the top and the four level ends; `refused` are probes that no finger could make.
    """
    if not len(contacts):
        return []
    ends = ends_of(space, contacts, ())
    sides = [(end.out, f"the side of {end}") for end in ends]
    sides.append((np.array([0.0, 0.0, 1.0]), "the top"))
    found = []
    for out, name in sides:
        shown = contacts.normals @ out > _FACES_OUT
        if not shown.any() and any(-(o.probe.direction @ out) > _FACES_OUT for o in refused):
            found.append(name)
    return found


def extent_probe(
    space: Workspace,
    contacts: Contacts,
    outcomes: Sequence[ProbeOutcome],
    landmarks: Sequence[Landmark] = (),
) -> Probe | None:
    """Return the next probe that shows how far an object on a table extends, or None.

    After the first contact a motion down beside it shows the height; it begins higher if it cannot
    begin there, as in a tall object. Then level motions from outside find the four ends, first the
    one opposite to the first contact. At last sweeps pass the ends of a long object: anything they
    meet, such as a jaw, is a new extreme with an open end.

    The outcomes are those since the first contact, or since the landmarks were touched.
    """
    if not len(contacts) or len(outcomes) >= _MOST:
        return None
    normal = contacts.normals[0]
    down = [o for o in outcomes if o.probe.direction[2] <= -_FACES_OUT]
    begun = any(o.status != "blocked" or len(o.free_points) for o in down)
    if not begun and len(down) < _TRIES and contacts.normals[:, 2].max() <= _FACES_OUT:
        place = contacts.points[0] - _INSIDE * normal
        place[2] = space.level_height
        above = _BEYOND[len(down)] if down else 0.6 * space.size
        return Probe(place, np.array([0.0, 0.0, -1.0]), above, 0.0)
    ends = ends_of(space, contacts, outcomes, landmarks)
    found = [end for end in ends if end.is_open]
    if found:
        return min(found, key=lambda end: (len(end.met) > 0, float(end.out @ normal))).inward()
    lengths = [float(np.ptp(contacts.points @ end.out)) for end in (ends[0], ends[2])]
    if max(lengths) < max(_LONG * min(lengths), contacts.points[:, 2].max()):
        return None
    both = ends[:2] if lengths[0] > lengths[1] else ends[2:]
    return next((end.sweep() for end in both if not end.is_passed), None)


def _level_axis(contacts: Contacts) -> FloatArray:
    """Return a level axis of an object, unit, shape (3,): the long one if contacts show it.

    Else it is perpendicular to the mean direction, without sign, of the level normals.
    """
    points = contacts.points[:, :2] - contacts.points[:, :2].mean(axis=0)
    variances, axes = np.linalg.eigh(points.T @ points)
    if len(points) > 2 and variances[1] > _ELONGATED**2 * variances[0]:
        return np.append(axes[:, 1], 0.0)
    x, y = contacts.normals[np.abs(contacts.normals[:, 2]) < _FACES_OUT, :2].T
    angle = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x**2 - y**2).sum())
    return np.asarray(unit(np.array([-np.sin(angle), np.cos(angle), 0.0])))
