"""Convex hull of the contacts: the part of space where the object is known to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from lis_grasp.contacts import Contacts
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ContactHull:
    """Convex hull of contacts: a convex object contains it, any other object crosses it.

    A line through it is likely to meet the object; a line beside it meets surface that is
    extrapolated.
    """

    equations: FloatArray  # (S, 4): unit outward normal and offset of each facet

    @classmethod
    def of(cls, contacts: Contacts) -> ContactHull | None:
        """Return the hull; None of fewer than four contacts, or of contacts in one plane."""
        try:
            hull = ConvexHull(contacts.points)
        except (QhullError, ValueError):
            return None
        return cls(hull.equations)

    def crossing(
        self, points: FloatArray, directions: FloatArray, *, margin: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return where lines enter and leave the hull, grown by a margin [m].

        Points (..., 3) [m] and unit directions (..., 3), in O. Both results have shape (...) [m]:
        distances from the point along its direction. A line that misses the hull enters it at
        infinity. (Clipping of a line by half-spaces: Cyrus and Beck 1978.)
        """
        normals, offsets = self.equations[:, :3], self.equations[:, 3] - margin
        heights = points @ normals.T + offsets  # (..., S): outside of a facet if positive
        slopes = directions @ normals.T
        parallel = np.abs(slopes) < 1e-12
        at = -heights / np.where(parallel, 1.0, slopes)
        enter = np.where(slopes < 0.0, at, -np.inf)
        enter = np.where(parallel, np.where(heights > 0.0, np.inf, -np.inf), enter).max(axis=-1)
        leave = np.where((slopes > 0.0) & ~parallel, at, np.inf).min(axis=-1)
        return np.where(enter <= leave, enter, np.inf), leave
