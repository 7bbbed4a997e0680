"""Concavities that the estimate bridges: free space inside the estimated surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

# Distance between the points checked along a tip's path, in steps.
_SPACING = 0.25


def bridged_points(
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return points of free space inside the estimate, and the tip's direction of motion there.

    Contacts around a hole do not show it, so an estimate closes it. A tip that passed through free
    space there contradicts the estimate. Only points within the contacts' convex hull count: the
    estimate outside of it is extrapolated, and wrong there without a concavity.

    Points (K, 3) [m] and unit directions (K, 3) are in the order of `outcomes`.
    """
    points, directions = _tip_path(outcomes, step)
    if not len(points):
        return points, directions
    try:
        sides = ConvexHull(contacts.points).equations  # (S, 4): outward normal and offset
    except QhullError:  # fewer than four contacts, or all in a plane
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
