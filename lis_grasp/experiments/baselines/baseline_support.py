"""What baselines without a measure of their own have for uncertainty, and their bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.queries import flat_points, require_contacts
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """Contacts made ready, the box they are meant for, and the distance to the nearest one.

    Parameters
    ----------
    contacts
        Without duplicates.
    spacing
        Of them [m].
    bounds
        Shape (2, 3) [m]: their box, grown by one spacing.
    """

    contacts: Contacts
    spacing: float
    bounds: FloatArray
    _tree: cKDTree

    @classmethod
    def of(cls, contacts: Contacts) -> Support:
        """Merge duplicates and prepare; InvalidContactsError if there is no contact."""
        require_contacts(contacts)
        merged = merge_duplicates(contacts)
        spacing = spacing_of(merged)
        bounds = merged.bounds + spacing * np.array([[-1.0], [1.0]])
        return cls(merged, spacing, bounds, cKDTree(merged.points))

    def uncertainty(self, points: npt.ArrayLike, error: float) -> FloatArray:
        """Return `error` d^2 / spacing at points (..., 3); d is how far the nearest contact is."""
        rows, shape = flat_points(points)
        distances = self._tree.query(rows)[0]
        return np.asarray(error * distances**2 / self.spacing).reshape(shape)
