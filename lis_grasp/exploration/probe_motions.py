"""Probe motions to a chosen target: along axes, against the normal, and inside concavities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.geometry import AXES, cross, hull_crossing, unit
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import BoolArray, FloatArray

PROBE_SPEED = 0.1
"""Speed of a guarded motion, which may touch at any time [m/s]."""

GENTLE_SPEED = 0.03
"""The same if the object may move, from its first contact on [m/s].

A push at speed v gives a free object at most this speed. It topples only if half the width of its
foot is below v sqrt(h / g), its centre of mass at height h: 2 mm of 30 mm.
"""

QUICK_SPEED = 0.06
"""The same in a direction in which the object resisted a touch [m/s]."""

SLIDE_SPEED = 0.05
"""Speed of a fingertip that slides along a surface [m/s]."""

TRANSIT_SPEED = 0.25
"""Speed of approach, retreat, and the transfer from one probe to the next [m/s]."""

ARM_PROBE_SPEED, ARM_APPROACH_SPEED = 0.03, 0.05
"""Speeds of a hand that an arm carries, guarded, and where nothing is expected [m/s].

Its inertia runs on after a touch, also of a body that nobody knows of.
"""

SAME_DIRECTION = float(np.cos(np.radians(50.0)))
"""Two directions count as one if their cosine is above this."""

# Distance between the points checked along a tip's path, in steps.
_SPACING = 0.25
# Concavities are sought on the paths of this many recent probes.
_RECENT = 16
# Random offset of the first probes from the centre, in sizes of the object, so that seeds differ.
_AXIS_SPREAD = 0.05
# Length of the motion beyond the target, in steps.
_OVERSHOOT = 1.5
# Angle of a probe after a miss, from beyond the edge back towards the nearest contact.
_OBLIQUE_ANGLE = np.radians(40.0)
# Least height of a probe's start above the table, in steps, unless its motion is level.
_START_ABOVE_TABLE = 1.0
# Low surface is touched by level motions if its normal is at most this high: 45 degrees.
_LEVEL = float(np.sqrt(0.5))


def axis_probe(
    space: Workspace, outcomes: Sequence[ProbeOutcome], rng: np.random.Generator
) -> Probe | None:
    """Return a probe along an axis to the centre, from a side that has not been probed, or None.

    An object on a table is not probed from below.
    """
    probed = np.array([outcome.probe.direction for outcome in outcomes]).reshape(-1, 3)
    new = ~np.any(AXES @ probed.T > SAME_DIRECTION, axis=1)
    if space.support_height is not None:
        new &= AXES[:, 2] <= 0.0
    left = np.flatnonzero(new)
    if not len(left):
        return None
    direction = AXES[rng.choice(left)]
    target = space.center + _AXIS_SPREAD * space.size * rng.uniform(-1.0, 1.0, size=3)
    return Probe(target, direction, 0.6 * space.size + 0.5 * space.step, 0.0)


def random_pass(space: Workspace, rng: np.random.Generator) -> Probe:
    """Return a probe along a random line through the whole workspace, but not up out of a table."""
    direction = rng.normal(size=3)
    if space.support_height is not None:
        direction[2] = -abs(direction[2])
    target = space.center + space.size * rng.uniform(-0.4, 0.4, size=3)
    return Probe(target, direction, 1.2 * space.size, 1.2 * space.size)


def concavity_probe(
    space: Workspace,
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
    rng: np.random.Generator,
) -> Probe | None:
    """Return a probe to the wall of a concavity that the estimate bridges, or None."""
    points, directions = _bridged_points(contacts, surface, outcomes, space.step)
    starts = np.array([outcome.probe.start for outcome in outcomes]).reshape(-1, 3)
    probed = np.array([outcome.probe.direction for outcome in outcomes]).reshape(-1, 3)
    # Perpendicular to the tip's motion, to a side drawn once for all points.
    sideways = unit(cross(directions, rng.normal(size=3)), least=1e-12)
    near = np.linalg.norm(points[:, None] - starts, axis=-1) < space.step  # (K, outcomes)
    blocked = np.array([outcome.status == "blocked" for outcome in outcomes], dtype=np.bool_)
    new = ~np.any(near & (blocked | (sideways @ probed.T > SAME_DIRECTION)), axis=1)
    if not new.any():
        return None
    chosen = rng.choice(np.flatnonzero(new))
    half = 0.5 * space.size
    return Probe(points[chosen] + half * sideways[chosen], sideways[chosen], half, half)


def surface_probe(
    target: FloatArray,
    normal: FloatArray,
    space: Workspace,
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
) -> Probe:
    """Return a probe to a target against its outward normal, oblique after a miss.

    The oblique motion comes from beyond the edge that the missed probe must have crossed, back
    towards the nearest contact. Low above a table it is level: a slope would end at the table.
    """
    angle = _OBLIQUE_ANGLE if outcomes and outcomes[-1].status == "missed" else 0.0
    nearest = np.argmin(np.linalg.norm(contacts.points - target, axis=1))
    away = target - contacts.points[nearest]
    away = away - (away @ normal) * normal
    length = float(np.linalg.norm(away))
    retreat = np.cos(angle) * normal
    if length > 0.0:
        retreat = retreat + np.sin(angle) * away / length
    if space.support_height is not None:
        if angle and is_low(target, space) and np.hypot(*away[:2]) > 0.0:
            retreat = away * [1.0, 1.0, 0.0]
        retreat = retreats(target[None], retreat[None], space, contacts, surface)[0]
        target = level_targets(target, retreat, space)
    overshoot, hull = _OVERSHOOT * space.step, contact_hull(contacts)
    if hull is not None:
        enter, leave = hull_crossing(hull, target, -retreat)
        if np.isfinite(enter):
            overshoot = max(overshoot, float(leave))
    return Probe(target, -retreat, space.step, overshoot)


def retreats(
    points: FloatArray,
    directions: FloatArray,
    space: Workspace,
    contacts: Contacts,
    surface: ImplicitSurface,
) -> FloatArray:
    """Return unit directions (P, 3) away from points of an estimate, never out of a table.

    Points (P, 3) [m] and directions (P, 3) are in O. Low above a table, directions are level if
    they are nearly so and lead outside; others are raised. Those of a flat object need not lead
    outside: its estimate may extend too far.
    """
    if space.support_height is None:
        return directions
    raised = unit(directions)
    above = (points[:, 2] - space.support_height) / space.step
    level = is_low(points, space) & (np.abs(raised[:, 2]) < _LEVEL)
    if not is_flat(contacts, space):
        level[level] = _leads_outside(points[level], raised[level], space, surface)
    raised[:, 2] = np.where(level, 0.0, np.maximum(raised[:, 2], _START_ABOVE_TABLE - above))
    return unit(raised)


def _leads_outside(
    points: FloatArray, directions: FloatArray, space: Workspace, surface: ImplicitSurface
) -> BoolArray:
    """Return which level lines from points (P, 3) leave the estimate, unlike those in a hole."""
    level = unit(directions * [1.0, 1.0, 0.0])
    starts = level_targets(points, level, space)
    distances = np.arange(_SPACING * space.step, space.size, _SPACING * space.step)
    lines = starts[:, None] + distances[:, None] * level[:, None]  # (P, D, 3)
    return np.asarray(
        (surface.evaluate(lines.reshape(-1, 3)) > 0.0).reshape(lines.shape[:2]).all(axis=1)
    )


def level_targets(points: FloatArray, directions: FloatArray, space: Workspace) -> FloatArray:
    """Return targets (..., 3) at the lowest height of level fingertip motions."""
    if space.support_height is None:
        return points
    raised = points.copy()
    least = np.where(directions[..., 2] == 0.0, space.level_height, -np.inf)
    raised[..., 2] = np.maximum(points[..., 2], least)
    return raised


def is_low(points: FloatArray, space: Workspace) -> BoolArray:
    """Return which points (..., 3) the lowest level motion above a table meets."""
    if space.support_height is None:
        return np.zeros(points.shape[:-1], dtype=np.bool_)
    return np.asarray(points[..., 2] < space.level_height + space.tip_radius)


def is_flat(contacts: Contacts, space: Workspace) -> bool:
    """Return whether all contacts of an object on a table are low; see `is_low`."""
    return bool(is_low(contacts.bounds[1], space))


def _bridged_points(
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return points of free space inside the estimate, and the tip's direction of motion there.

    Points (K, 3) [m] and unit directions (K, 3) are in the order of `outcomes`, and only within
    the contacts' convex hull, because the estimate is extrapolated outside.
    """
    points, directions = _tip_path(outcomes[-_RECENT:], step)
    sides = contact_hull(contacts)
    if sides is None:
        return points[:0], directions[:0]
    within = np.all(points @ sides[:, :3].T + sides[:, 3] < -_SPACING * step, axis=1)
    points, directions = points[within], directions[within]
    inside = surface.evaluate(points) < 0.0
    return points[inside], directions[inside]


def _tip_path(outcomes: Sequence[ProbeOutcome], step: float) -> tuple[FloatArray, FloatArray]:
    """Return points that tips passed in free space, and the direction of motion at each."""
    points, directions = [np.empty((0, 3))], [np.empty((0, 3))]
    for outcome in outcomes:
        if outcome.status == "blocked":
            continue
        probe, end = outcome.probe, outcome.probe.overshoot
        if outcome.status == "touched":
            along = (outcome.contacts.points - probe.target) @ probe.direction
            end = min(end, float(along.min()) - _SPACING * step)
        path = np.arange(-probe.standoff, end, _SPACING * step)
        points.append(probe.target + path[:, None] * probe.direction)
        directions.append(np.tile(probe.direction, (len(path), 1)))
    return np.concatenate(points), np.concatenate(directions)


def contact_hull(contacts: Contacts) -> FloatArray | None:
    """Return outward normals and offsets (S, 4) of the contacts' hull; None if they are in a plane.

    A convex object contains it, any other crosses it: a line through it probably meets the object.
    A line beside it meets extrapolated surface.
    """
    try:
        return np.asarray(ConvexHull(contacts.points).equations)
    except (QhullError, ValueError):
        return None
