"""Candidate targets of the next touch: surface points and their distances to contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.neighbours import Neighbours, has_room
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import (
    SAME_DIRECTION,
    contact_hull,
    is_flat,
    level_targets,
    retreats,
)
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import hull_crossing, tangent_frame, unit
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.carved_implicit_surface import depths_in_free_space
from lis_grasp.surfaces.contact_places import box_lengths
from lis_grasp.typing import BoolArray, FloatArray

# A target repeats an earlier one within this fraction of its gap, if directions agree.
_SAME_TARGET = 0.4
# Failed probes of a target after which it is given up.
_OFTEN = 3
# A start repeats that of a blocked probe within this distance, in steps.
_SAME_START = 0.5
# Largest depth of a target in free space that a link passed, in steps.
_IN_FREE_SPACE = 0.05
# A line to a target passes the contacts' hull at most this far beside it, in steps.
_BESIDE = 0.2
# The same along a flat object of at least this ratio of length to width: its top may continue.
_BESIDE_LONG, _LONG = 1.0, 2.0
# Misses permitted per contact: they show where the estimate extends too far.
_MISSES = 0.1
FACES_AWAY = -0.5
"""Cosine of the normals of surface that faces away from a contact, as on the far side of a thin
wall: the contact does not count for it."""

# Slides to try after a touch.
_SLIDES = 4
# Places where a line may enter the estimate, on its way to a slide.
_ON_LINE = 33
# On a flat object the sides are near contacts on the top: these count only if they face alike.
_FACES_ALIKE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Samples of an estimate, and the approach to each, by its contacts alone."""

    points: FloatArray  # (P, 3) [m]
    normals: FloatArray  # (P, 3), unit, outward
    away: FloatArray  # (P, 3): directions of retreats
    targets: FloatArray  # (P, 3) [m]: targets of probes, which a table may raise
    depths: FloatArray  # (P,) [m] in free space; negative outside

    @classmethod
    def of(cls, space: Workspace, estimate: DeferredEstimate) -> Candidates:
        """Return the candidates of an estimate, made once."""
        known = estimate.contacts

        def make() -> Candidates:
            rng = np.random.default_rng(len(known))
            points, normals = space.sample(estimate, near=known, rng=rng)
            away = retreats(points, normals, space, known, estimate)
            depths = depths_in_free_space(points, estimate, known)
            for free in estimate.prior.free:
                depths = np.maximum(depths, free.depths(points)[0])
            return cls(points, normals, away, level_targets(points, away, space), depths)

        key = (*space.center, space.size, space.step)
        return estimate.derived("candidates", key, make)

    def depths_with(self, estimate: DeferredEstimate, contacts: Contacts) -> FloatArray:
        """Return the depths in all free space known now, shape (P,) [m]."""
        later = depths_in_free_space(self.points, estimate, estimate.later(contacts))
        return np.maximum(self.depths, later)


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """Points of an estimate that may be touched next."""

    points: FloatArray  # (P, 3) [m]: samples of the estimate
    normals: FloatArray  # (P, 3), unit, outward
    nearest: FloatArray  # (P,) [m]: distance to the nearest contact on the point's side
    eligible: BoolArray  # (P,): no earlier target, not in free space, and can be approached
    step: float  # wanted distance between touches [m]

    @classmethod
    def find(
        cls,
        space: Workspace,
        contacts: Contacts,
        surface: ImplicitSurface,
        outcomes: Sequence[ProbeOutcome],
        neighbours: Neighbours | None = None,
    ) -> Targets:
        """Return the targets of an estimate, given before free space is removed.

        Where known neighbours leave no room for a fingertip, there is none.
        """
        estimate = DeferredEstimate.of(surface, contacts)
        candidates = Candidates.of(space, estimate)
        points, normals, away = candidates.points, candidates.normals, candidates.away
        flat = is_flat(contacts, space)
        least_cosine = _FACES_ALIKE if flat else FACES_AWAY
        nearest = gaps(points, normals, contacts, least_cosine=least_cosine)
        eligible = candidates.depths_with(estimate, contacts) < _IN_FREE_SPACE * space.step
        eligible &= space.touchable(points, normals)
        eligible &= ~_tried(candidates.targets, away, np.minimum(nearest, space.step), outcomes)
        eligible &= ~_starts_blocked(candidates.targets, away, space.step, outcomes)
        if neighbours is not None:
            rows = np.flatnonzero(eligible)
            eligible[rows] = has_room(
                neighbours, candidates.targets[rows], away[rows], space.tip_radius
            )
        misses = sum(outcome.status == "missed" for outcome in outcomes)
        if misses >= _MISSES * len(contacts):  # surface beside the hull is mostly extrapolated
            _, width, length = box_lengths(contacts.points)
            beside = _BESIDE_LONG if flat and length > _LONG * width else _BESIDE
            eligible &= _meets_hull(points, normals, contacts, beside * space.step)
        return cls(points, normals, nearest, eligible, space.step)


def _meets_hull(
    points: FloatArray, normals: FloatArray, contacts: Contacts, margin: float
) -> BoolArray:
    """Return which probes of points, shape (P,), pass through the hull of the contacts."""
    hull = contact_hull(contacts)
    if hull is None:
        return np.ones(len(points), dtype=np.bool_)
    enter, leave = hull_crossing(hull - [0.0, 0.0, 0.0, margin], points, -normals)
    return np.isfinite(enter) & (leave > 0.0)


def gaps(
    points: FloatArray,
    normals: FloatArray,
    contacts: Contacts,
    *,
    least_cosine: float = FACES_AWAY,
) -> FloatArray:
    """Return each point's distance to the nearest contact on its side, shape (P,) [m].

    Contacts are on its side if the cosine of the normals is at least this.
    """
    distances = cdist(points, contacts.points)  # (P, N)
    distances[normals @ contacts.normals.T < least_cosine] = np.inf
    return np.asarray(distances.min(axis=1, initial=np.inf))


def choose_slides(
    probe: Probe,
    length: float,
    space: Workspace,
    contacts: Contacts,
    estimate: DeferredEstimate | None,
) -> FloatArray:
    """Return slides (K, 3) [m] of a length after a probe's touch, the largest gap first.

    They are some of eight; those that end on the estimate are first.
    """
    place, normal = probe.target, -probe.direction
    if estimate is not None:
        reach = probe.standoff + probe.overshoot
        line = probe.start + np.linspace(0.0, reach, _ON_LINE)[:, None] * probe.direction
        inside = estimate.evaluate(line) < 0.0
        if inside.any():
            place = line[np.argmax(inside)]
            normal = unit(estimate.gradient(place[None])[0], least=1e-12)
    angles = 0.25 * np.pi * np.arange(8)
    along = np.column_stack([np.cos(angles), np.sin(angles)]) @ tangent_frame(normal)
    ends = place + length * along  # (8, 3)
    gap = gaps(ends, np.tile(normal, (8, 1)), contacts)
    if space.support_height is not None:
        gap[ends[:, 2] < space.level_height] = -2.0
    if estimate is not None:
        depths = np.linspace(-length, length, _ON_LINE)
        lines = ends[:, None] - depths[:, None] * normal  # (8, D, 3), inwards
        values = estimate.evaluate(lines.reshape(-1, 3)).reshape(lines.shape[:2])
        gap[(values > 0.0).all(axis=1)] -= 1.0
    return length * np.asarray(along[np.argsort(-gap, kind="stable")[:_SLIDES]])


def _tried(
    points: FloatArray, away: FloatArray, gap: FloatArray, outcomes: Sequence[ProbeOutcome]
) -> BoolArray:
    """Return which points, shape (P,), were targets before, from about the same side.

    Points where probes failed often, from any side, count as tried.
    """
    failed = np.array([outcome.status != "touched" for outcome in outcomes], dtype=np.bool_)
    targets = np.array([outcome.probe.target for outcome in outcomes]).reshape(-1, 3)
    directions = np.array([outcome.probe.direction for outcome in outcomes]).reshape(-1, 3)
    near = cdist(points, targets) < _SAME_TARGET * gap[:, None]
    same = near & (-away @ directions.T > SAME_DIRECTION)
    return np.asarray(same.any(axis=1) | ((near & failed).sum(axis=1) >= _OFTEN))


def _starts_blocked(
    points: FloatArray, away: FloatArray, step: float, outcomes: Sequence[ProbeOutcome]
) -> BoolArray:
    """Return which points, shape (P,), would be probed from a place that the hand did not reach.

    In a cavity too narrow for the hand, other directions from there are blocked, too.
    """
    blocked = np.zeros(len(points), dtype=np.bool_)
    starts = [outcome.probe.start for outcome in outcomes if outcome.status == "blocked"]
    if not starts:
        return blocked
    tree = cKDTree(np.array(starts))
    for distance in (0.0, 0.5, 1.0):  # a probe starts up to a step from its target
        near, _ = tree.query(points + distance * step * away)
        blocked |= near < _SAME_START * step
    return blocked
