"""Known bodies beside the object: whose a contact is, and where a fingertip has room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe, ProbeOutcome, Prober
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.geometry import apply_pose, rotate
from lis_grasp.records import Record
from lis_grasp.typing import BoolArray, FloatArray

TOUCHED = "touched"
"""Start of the reason of a probe that met a known body, before its name."""

# Distance between checked places of a fingertip on a line, and its least distance from bodies [m].
_SPACING, _CLEARANCE = 0.005, 0.002


@dataclass(frozen=True, slots=True, eq=False)
class BodyTouch(Record):
    """A contact of a known body beside the object, in the frame W of the first probe."""

    body: str  #: its name
    point: FloatArray  #: (3,) [m]
    normal: FloatArray  #: (3,), unit, out of the body


class Neighbours(Protocol):
    """Known bodies beside the object, where they are believed to be, in the frame E of contacts."""

    @property
    def error(self) -> float:
        """Largest error of the believed places [m]."""
        ...

    @property
    def poses(self) -> Mapping[str, FloatArray]:
        """Believed poses (4, 4) of the bodies by their names, in the frame of the first probe."""
        ...

    def in_frame(self, X_EF: FloatArray) -> Neighbours:
        """Return the same bodies in a frame F, whose pose in the present E is `X_EF` (4, 4)."""
        ...

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (P,) of points (P, 3) from the nearest body [m]."""
        ...

    def nearest(self, points: FloatArray) -> str:
        """Return the name of the body nearest to any of the points (P, 3)."""
        ...

    def whose(self, contacts: Contacts) -> list[str | None]:
        """Return for each contact the body that it belongs to; None for the object."""
        ...

    def corrected(self, touches: Sequence[BodyTouch]) -> Neighbours:
        """Return the bodies at the places that touches show."""
        ...


@runtime_checkable
class PlanningProber(Prober, Protocol):
    """A prober that plans its motions between known bodies beside the object."""

    def reaches(self, probe: Probe, obstacles: ObstacleModel) -> str:
        """Return why no finger reaches a probe; empty if one does."""
        ...

    def place_known(self, poses: Mapping[str, FloatArray]) -> None:
        """Place known bodies at believed poses (4, 4) in the frame of the first probe."""
        ...


def attributed(
    outcome: ProbeOutcome, neighbours: Neighbours, X_WE: FloatArray
) -> tuple[ProbeOutcome, tuple[BodyTouch, ...]]:
    """Return an outcome without the contacts of known bodies, and these contacts, in W.

    A probe that met nothing else is blocked by the body; its free space remains.
    """
    contacts = outcome.contacts
    owners = neighbours.whose(contacts) if len(contacts) else []
    theirs = [k for k, owner in enumerate(owners) if owner is not None]
    if not theirs:
        return outcome, ()
    points, normals = apply_pose(X_WE, contacts.points), rotate(X_WE, contacts.normals)
    touches = tuple(BodyTouch(str(owners[k]), points[k], normals[k]) for k in theirs)
    kept = [k for k, owner in enumerate(owners) if owner is None]
    made = len(contacts) - outcome.slid
    outcome = replace(
        outcome,
        status="touched" if kept else "blocked",
        reason=outcome.reason if kept else f"{TOUCHED} {touches[0].body}",
        contacts=contacts.subset(np.array(kept, dtype=np.intp)),
        slid=sum(k >= made for k in kept),
    )
    return outcome, touches


def has_room(
    neighbours: Neighbours, points: FloatArray, directions: FloatArray, tip_radius: float
) -> BoolArray:
    """Return which surface points (P, 3) a fingertip may touch between bodies, (P,).

    It comes against directions (P, 3), from nearby at least.
    """
    return _have_room(points + (tip_radius + _SPACING) * directions, neighbours, tip_radius)


def fitted(probe: Probe, neighbours: Neighbours, tip_radius: float) -> Probe | None:
    """Return a probe that begins and ends before known bodies; None if its target has no room."""
    along = _places_along(probe)
    free = _have_room(_tips(probe, along, tip_radius), neighbours, tip_radius)
    return _between(probe, along, free, int(np.argmin(np.abs(along))))


def longest_parts(
    probes: Sequence[Probe], neighbours: Neighbours, tip_radius: float
) -> list[Probe]:
    """Return the longest part of each probe that is free of known bodies, if it has one."""
    places = [_places_along(probe) for probe in probes]
    centers = [_tips(probe, along, tip_radius) for probe, along in zip(probes, places, strict=True)]
    room = _have_room(np.vstack([np.empty((0, 3)), *centers]), neighbours, tip_radius)
    ends = np.cumsum([len(along) for along in places])
    parts = zip(probes, places, np.split(room, ends[:-1]), strict=True)
    longest = (_longest(probe, along, free) for probe, along, free in parts)
    return [part for part in longest if part is not None]


def _longest(probe: Probe, along: FloatArray, free: BoolArray) -> Probe | None:
    """Return the longest free part of a probe, given its free places."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(int), [0]]))).reshape(-1, 2)
    if free.all() or not len(edges):
        return probe if len(edges) else None
    begin, end = edges[np.argmax(np.diff(edges, axis=1))]
    middle, half = 0.5 * (along[begin] + along[end - 1]), 0.5 * (along[end - 1] - along[begin])
    target = probe.target + middle * probe.direction
    return replace(probe, target=target, standoff=half, overshoot=half)


def _places_along(probe: Probe) -> FloatArray:
    """Return places along a probe (P,) [m] from its target, which is one of them."""
    before = -_SPACING * np.arange(np.floor(probe.standoff / _SPACING), 0.0, -1.0)
    after = _SPACING * np.arange(np.floor(probe.overshoot / _SPACING) + 1.0)
    return np.unique(np.concatenate([[-probe.standoff], before, after, [probe.overshoot]]))


def _tips(probe: Probe, along: FloatArray, tip_radius: float) -> FloatArray:
    """Return the centres (P, 3) of the fingertip at places along a probe [m]."""
    return probe.target + (along[:, None] - tip_radius) * probe.direction


def _have_room(centers: FloatArray, neighbours: Neighbours, tip_radius: float) -> BoolArray:
    """Return whether known bodies leave room for a fingertip at centres (P, 3) [m], (P,)."""
    return neighbours.distances(centers) > tip_radius + _CLEARANCE + neighbours.error


def _between(probe: Probe, along: FloatArray, free: BoolArray, at: int) -> Probe | None:
    """Return the part of a probe around a free place; None if the place is not free."""
    if not free[at]:
        return None
    if free.all():
        return probe
    blocked = np.flatnonzero(~free)
    first = int(blocked[blocked < at].max(initial=-1)) + 1
    last = int(blocked[blocked > at].min(initial=len(along))) - 1
    standoff, overshoot = max(-float(along[first]), 0.0), max(float(along[last]), 0.0)
    return replace(probe, standoff=standoff, overshoot=overshoot)
