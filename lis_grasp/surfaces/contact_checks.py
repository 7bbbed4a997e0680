"""Checks of contacts from files: a size in plausible units, and normals that point outward."""

from __future__ import annotations

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError
from lis_grasp.shapes import UNITS
from lis_grasp.shapes.shape import LARGEST, SMALLEST
from lis_grasp.typing import FloatArray

# Smallest largest extent of contacts on an object that a hand can grasp [m].
_LEAST_EXTENT = 1e-3
# Largest extent of an object that a unit is proposed for [m].
_GRASPABLE = 0.5
# Heights below this fraction of the extent do not count: the contact is beside the other.
_LEAST_HEIGHT = 0.01
# Pairs are of at most so many contacts.
_MOST = 400
# Contacts of one view have all but 5 % of their normals in a half space, up to its border.
_VIEW, _BORDER = 0.95, -0.1
# Length of the mean of unit normals below which it has no direction: they are on all sides.
_LEAST_MEAN = 0.1
# Of 1560 sets of 5 to 400 contacts with outward normals on test objects, 2 have more in front.
INWARD = 0.75
"""Fraction in front above which normals point inward."""
DOUBTFUL = 0.55
"""Fraction in front above which normals may point inward."""


def require_plausible_size(points: FloatArray, units: str) -> None:
    """Raise `InvalidContactsError` if points (N, 3) [m], read in `units`, fit no object of a hand.

    The message names the units that fit. Points that are not finite pass: `Contacts` names them.
    """
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if extent == 0.0 or not np.isfinite(extent) or _LEAST_EXTENT <= extent <= LARGEST:
        return
    fitting = [
        f"{name} (then {1e3 * extent * metres / UNITS[units]:.3g} mm)"
        for name, metres in UNITS.items()
        if SMALLEST <= extent * metres / UNITS[units] <= _GRASPABLE
    ]
    advice = (
        f"estimate --units {' or '.join(fitting)} would fit" if fitting else "no unit would fit"
    )
    raise InvalidContactsError(
        f"contacts must be within {_LEAST_EXTENT:g} to {LARGEST:g} m of each other; they are"
        f" {extent:.3g} m apart when read in {units}: {advice}",
        field="points",
    )


def fraction_in_front(contacts: Contacts) -> float:
    """Return the fraction of ordered pairs of contacts whose second is in front of the first.

    In front means above the first's tangent plane, on the side of its normal. It is 0 for a convex
    object with outward normals, 1 with inward ones, and 0 where no pair shows it. Contacts whose
    normals are in one half space, as of one camera view, do not show it either: a bowl and a ball
    differ by the sign of the normals alone.
    """
    chosen = contacts.subset(
        np.linspace(0, len(contacts) - 1, min(len(contacts), _MOST)).astype(int)
    )
    points, normals = chosen.points, chosen.normals
    if len(points) < 2 or _are_of_one_view(normals):
        return 0.0
    heights = np.einsum("ijk,ik->ij", points[None] - points[:, None], normals)  # (N, N)
    counted = np.abs(heights) > _LEAST_HEIGHT * chosen.extent
    return float(np.mean(heights[counted] > 0.0)) if counted.any() else 0.0


def require_outward_normals(contacts: Contacts) -> None:
    """Raise `InvalidContactsError` if nearly all contacts are in front of the others."""
    fraction = fraction_in_front(contacts)
    if fraction > INWARD:
        raise InvalidContactsError(
            "normals must point out of the object; these point inward: seen from a contact,"
            f" {100 * fraction:.0f} % of the others are in front of it. Change their sign"
            " (estimate --normals inward does), or keep them with --normals outward",
            field="normals",
        )


def _are_of_one_view(normals: FloatArray) -> bool:
    """Return whether nearly all normals (N, 3) are in the half space about their mean."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return length > _LEAST_MEAN and bool(np.mean(normals @ (mean / length) > _BORDER) >= _VIEW)
