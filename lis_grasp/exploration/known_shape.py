"""What a hand has to go round: the estimate, as far as touches vouch for it, and the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class KnownShape:
    """What is known of an object while it is explored.

    Parameters
    ----------
    space
        Where the object is and how large; outside of that nothing is in the way.
    contacts
        Felt so far.
    surface
        Estimated from these contacts, without what the hand passed through (`carved`); None as long
        as there are no contacts.
    """

    space: Workspace
    contacts: Contacts
    surface: ImplicitSurface | None

    def blocks(self, points: FloatArray) -> npt.NDArray[np.bool_]:
        """Tell which points (P, 3) [m] are known to be in the object or the table, shape (P,).

        The estimate counts within half a step of a contact; farther away, and so behind a wall, it
        is a guess, and a guarded motion may find out.

        Parameters
        ----------
        points
            Shape (P, 3) [m], in O.
        """
        height = self.space.support_height
        blocked = points[:, 2] < (-np.inf if height is None else height)
        if self.surface is None:
            return blocked
        near = np.flatnonzero(_within(self.contacts.points, points, 0.5 * self.space.step))
        if len(near):
            blocked[near] |= self.surface.evaluate(points[near]) < 0.0
        return blocked


def _within(places: FloatArray, points: FloatArray, reach: float) -> npt.NDArray[np.bool_]:
    """Tell which points (P, 3) are within reach of any place (K, 3), shape (P,)."""
    if not len(places) or not len(points):
        return np.zeros(len(points), dtype=bool)
    apart, _ = cKDTree(places).query(points, distance_upper_bound=reach)
    return np.asarray(np.isfinite(apart))
