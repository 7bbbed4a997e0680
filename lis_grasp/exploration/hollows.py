"""Hollows that the estimate bridges: places known to be free that it takes for inside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

# Places are looked at this far apart along a tip's way, in units of the step.
_SPACING = 0.25


def bridged_places(
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return free places inside the estimate, and the direction in which the tip passed each.

    Contacts round a hole say nothing of it, and an estimate goes straight across. Where a tip went
    in and felt nothing, that is known to be wrong. Only places within the contacts' convex hull
    count: outside of it the estimate is extrapolated, and wrong without being a hollow's fault.

    Returns
    -------
    places, directions
        Shapes (K, 3) [m] and (K, 3), unit, in the order of `outcomes`.
    """
    places, directions = _ways(outcomes, step)
    if not len(places):
        return places, directions
    try:
        sides = ConvexHull(contacts.points).equations  # (S, 4): outward normal and offset
    except QhullError:  # fewer than four contacts, or all in a plane: there is no inside yet
        return places[:0], directions[:0]
    within = np.all(places @ sides[:, :3].T + sides[:, 3] < -_SPACING * step, axis=1)
    places, directions = places[within], directions[within]
    inside = surface.evaluate(places) < 0.0
    return places[inside], directions[inside]


def _ways(outcomes: Sequence[ProbeOutcome], step: float) -> tuple[FloatArray, FloatArray]:
    """Return points along the ways that tips went freely, and the direction at each."""
    places, directions = [np.empty((0, 3))], [np.empty((0, 3))]
    for outcome in outcomes:
        probe = outcome.probe
        end = probe.overshoot
        if outcome.status == "touched":
            felt = (outcome.contacts.points - probe.target) @ probe.direction
            end = min(end, float(felt.min()) - _SPACING * step)
        if outcome.status != "blocked":
            along = np.arange(-probe.standoff, end, _SPACING * step)
            places.append(probe.target + along[:, None] * probe.direction)
            directions.append(np.tile(probe.direction, (len(along), 1)))
    return np.concatenate(places), np.concatenate(directions)
