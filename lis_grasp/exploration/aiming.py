"""From a place that is worth touching to the motion of a fingertip that touches it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.hollows import bridged_places
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

AXES = np.vstack([np.eye(3), -np.eye(3)])
"""Directions of the first probes, shape (6, 3)."""

SAME_DIRECTION = float(np.cos(np.radians(50.0)))
"""Two directions count as one where their cosine is above this."""

# How far from the very middle the first probes aim, in sizes, so that explorations differ.
_OPENING_SPREAD = 0.1
# How far a tip goes on beyond its target; in units of the step.
_OVERSHOOT = 1.5
# After a miss the next probe comes in aslant, over the edge and back towards what is known.
_SLANT = np.radians(40.0)

# A start that would lie lower above a table than this is raised, in steps.
_ABOVE_TABLE = 1.0


def opening(space: Workspace, outcomes: Sequence[ProbeOutcome], rng: np.random.Generator) -> Probe:
    """Return a probe along an axis to the middle, from a side that had none."""
    had = np.array([outcome.probe.direction for outcome in outcomes]).reshape(-1, 3)
    left = np.flatnonzero(~np.any(AXES @ had.T > SAME_DIRECTION, axis=1))
    direction = AXES[rng.choice(left)]
    target = space.center + _OPENING_SPREAD * space.size * rng.uniform(-1.0, 1.0, size=3)
    return Probe(target, direction, 0.6 * space.size + 0.5 * space.step, 0.0)


def across(space: Workspace, rng: np.random.Generator) -> Probe:
    """Return a straight pass right through the object's box, from a random side."""
    direction = rng.normal(size=3)
    target = space.center + space.size * rng.uniform(-0.4, 0.4, size=3)
    return Probe(target, direction, 1.2 * space.size, 1.2 * space.size)


def from_within(
    space: Workspace,
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
    rng: np.random.Generator,
) -> Probe | None:
    """Return a probe to the wall of a hollow that the estimate bridges, or None."""
    places, ways = bridged_places(contacts, surface, outcomes, space.step)
    starts = np.array([outcome.probe.start for outcome in outcomes])
    directions = np.array([outcome.probe.direction for outcome in outcomes])
    # Sideways from the way in, to a side drawn once for all places.
    sideways = np.cross(ways, rng.normal(size=3))
    sideways /= np.maximum(np.linalg.norm(sideways, axis=1, keepdims=True), 1e-12)
    near = np.linalg.norm(places[:, None] - starts, axis=-1) < space.step  # (K, outcomes)
    new = ~np.any(near & (sideways @ directions.T > SAME_DIRECTION), axis=1)
    if not new.any():
        return None
    chosen = rng.choice(np.flatnonzero(new))
    half = 0.5 * space.size
    return Probe(places[chosen] + half * sideways[chosen], sideways[chosen], half, half)


def onto(
    target: FloatArray,
    normal: FloatArray,
    space: Workspace,
    contacts: Contacts,
    surface: ImplicitSurface,
    outcomes: Sequence[ProbeOutcome],
) -> Probe:
    """Return the probe down on a target, against its normal; after a miss aslant.

    Aslant means from beyond the edge that the missed probe must have crossed, back towards the
    nearest contact.
    """
    slant = _SLANT if outcomes[-1].status == "missed" else 0.0
    nearest = np.argmin(np.linalg.norm(contacts.points - target, axis=1))
    away = target - contacts.points[nearest]
    away = away - (away @ normal) * normal
    length = float(np.linalg.norm(away))
    back = np.cos(slant) * normal  # the way back from the target, out of the object
    if length > 0.0:
        back = back + np.sin(slant) * away / length
    if space.support_height is not None:  # not along the table, nor out of it, but from above
        back = back / np.linalg.norm(back)
        back[2] = max(back[2], _ABOVE_TABLE - (target[2] - space.support_height) / space.step)
        back /= np.linalg.norm(back)
    # Start a step away, or halfway to whatever the estimate has in the way.
    distances = space.step * np.arange(0.2, 1.01, 0.1)
    inside = surface.evaluate(target + distances[:, None] * back) < 0.0
    standoff = 0.5 * float(distances[np.argmax(inside)]) if inside.any() else space.step
    return Probe(target, -back, standoff, _OVERSHOOT * space.step)
