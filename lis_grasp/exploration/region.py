"""Region that contains an object at an unknown place, and the workspace that contacts show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.workspace import STEP_FRACTION, TIP_RADIUS, Workspace
from lis_grasp.typing import FloatArray

DEFAULT_REGION = (0.4, 0.4, 0.3)
"""Lengths of the region along x, y and z [m]."""

# A longer side is in another unit: a search of it would take hours.
_LONGEST = 5.0
# Behind a contact an object is at least this thick [m].
_THICKNESS = 0.03
# Largest extent of the object, in extents of its contacts.
_BEYOND = 1.15
# Length beyond that, divided by the number of contacts [m].
_UNKNOWN = 0.2


@dataclass(frozen=True, slots=True)
class Region:
    """Box on a table that contains an object of unknown place, size and orientation.

    The table is the plane z = 0 of the world frame W, in which an exploration of a region is. The
    box is centred at x = y = 0.

    Parameters
    ----------
    lengths
        Along x, y and z [m].
    tip_radius
        Radius of the fingertips that touch [m].

    Raises
    ------
    InvalidOptionError
        If these are not three positive lengths of at most 5 m.
    """

    lengths: Sequence[float] = DEFAULT_REGION
    tip_radius: float = TIP_RADIUS

    def __post_init__(self) -> None:
        try:
            lengths = tuple(float(length) for length in self.lengths)
        except (TypeError, ValueError):
            lengths = ()
        if len(lengths) != 3 or not all(0.0 < length <= _LONGEST for length in lengths):
            raise InvalidOptionError.out_of_range(
                "region", self.lengths, f"3 lengths in metres, above 0 and at most {_LONGEST:g}"
            )
        object.__setattr__(self, "lengths", lengths)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner, shape (2, 3) [m]."""
        x, y, z = self.lengths
        return np.array([[-0.5 * x, -0.5 * y, 0.0], [0.5 * x, 0.5 * y, z]])

    def grown(self, contacts: Contacts) -> Workspace:
        """Return the workspace that contacts show; without any, that of the whole region.

        It contains the box of the contacts, of what is behind each of them, and of the table below
        them. The margin shrinks with their number.
        """
        if not len(contacts):
            low, high = self.bounds
            size = float(np.linalg.norm(high - low)) / np.sqrt(3.0)
            return self._workspace(0.5 * (low + high), size)
        behind = contacts.points - _THICKNESS * contacts.normals
        known = np.vstack([contacts.points, behind]) if len(contacts) == 1 else contacts.points
        low, high = known.min(axis=0), known.max(axis=0)
        low[2], high[2] = 0.0, max(high[2], _THICKNESS)
        size = _BEYOND * max(float((high - low).max()), _THICKNESS) + _UNKNOWN / len(contacts)
        return self._workspace(0.5 * (low + high), size)

    def fitted_to(self, contacts: Contacts) -> Workspace:
        """Return the workspace with the step of the object that the contacts show."""
        return self.grown(contacts).fitted_to(contacts)

    def _workspace(self, center: FloatArray, size: float) -> Workspace:
        return Workspace(STEP_FRACTION * size, center, size, 0.0, self.tip_radius)
