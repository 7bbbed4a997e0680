"""The estimator under test, its surfaces of known bodies, and comparisons of two surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.estimators import Estimator, accepted_options
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.testing._known_surfaces import ball, block, places_around
from lis_grasp.typing import BoolArray, FloatArray

ASIDE = 0.004
"""Distance from a contact at which its sides are certain [m]."""

# Signs of two surfaces may differ at so many of the places: those on a surface have no certain one.
_SIGNS_DIFFER = 0.02
# Ratio by which medians of uncertainty of two equal cases may differ.
_SAME_UNCERTAINTY = 1.1


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class EstimatorSubject:
    """An estimator, and what it makes of known bodies."""

    made_by: Estimator

    def surface(self, contacts: Contacts, **noise: float) -> ImplicitSurface:
        """Return the surface of contacts, with the keywords of noise that the estimator has."""
        return self.made_by(contacts, **accepted_options(self.made_by, noise))

    @cached_property
    def ball(self) -> ImplicitSurface:
        """The surface of a ball."""
        return self.surface(ball())

    @cached_property
    def block(self) -> ImplicitSurface:
        """The surface of a block."""
        return self.surface(block())


def values(surface: ImplicitSurface, points: FloatArray) -> FloatArray:
    """Return f at points, as an array whatever the surface returns."""
    return np.asarray(surface.evaluate(points))


def different(
    first: ImplicitSurface,
    second: ImplicitSurface,
    *,
    X: FloatArray | None = None,
    factor: float = 1.0,
    median: bool = True,
) -> str:
    """Return how a surface differs from another one that is turned, moved and scaled.

    `second` is at ``factor * R x + t`` what `first` is at x, with R and t of the pose X (4, 4).
    Compared are the signs, which are what a surface guarantees, and with `median` the median
    uncertainty. Empty if they agree.
    """
    points = places_around()
    R, t = (np.eye(3), np.zeros(3)) if X is None else (X[:3, :3], X[:3, 3])
    there = factor * points @ R.T + t
    here, moved = values(first, points), values(second, there)
    share = float(np.mean(np.sign(here) != np.sign(moved)))
    if share > _SIGNS_DIFFER:
        return f"its sign changed at {100.0 * share:.0f} % of the places"
    if not median:
        return ""
    doubts = [
        float(np.median(np.asarray(surface.uncertainty(at))))
        for surface, at in ((first, points), (second, there))
    ]
    low, high = sorted((doubts[0] * factor, doubts[1]))
    if high > _SAME_UNCERTAINTY * low + 1e-12:
        return f"its median uncertainty was {doubts[0]:.3g} m, and then {doubts[1]:.3g} m"
    return ""


def wrong_sides(surface: ImplicitSurface, contacts: Contacts, aside: float = ASIDE) -> str:
    """Return how many contacts have no outside and inside at a distance [m]; else empty."""
    outside, inside = (
        values(surface, contacts.points + side * contacts.normals) for side in (aside, -aside)
    )
    wrong = int(((outside <= 0.0) | (inside >= 0.0)).sum())
    return f"it is not so at {wrong} of {len(contacts)} contacts" if wrong else ""


def not_finite(surface: ImplicitSurface, points: FloatArray) -> str:
    """Return which member has a value that is not finite at some of the points; else empty."""
    for member in ("evaluate", "gradient", "uncertainty"):
        found = np.asarray(getattr(surface, member)(points))
        finite: BoolArray = np.isfinite(found)
        if not finite.all():
            return f"{member} returned {int((~finite).sum())} numbers that are not finite"
    return ""


def kind_of_value(value: Any) -> str:
    """Return the type and shape of a value in words."""
    kind = type(value).__name__
    return f"a {kind} of {value.dtype}" if isinstance(value, np.ndarray) else f"a {kind}"
