"""Collision model of what is known during an exploration: the estimate near contacts, the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleModel:
    """What the hand avoids on its way to a probe.

    The surface is estimated from the contacts, free space carved off; None without contacts.
    """

    space: Workspace
    contacts: Contacts
    surface: ImplicitSurface | None

    def occupies(self, points: FloatArray) -> BoolArray:
        """Return which points (P, 3) [m], in O, are inside known object or table, shape (P,).

        The estimate counts within half a step of a contact. Farther away it is a guess, which a
        guarded motion may test.
        """
        height = self.space.support_height
        occupied = points[:, 2] < (-np.inf if height is None else height)
        if self.surface is None or not len(points):
            return occupied
        tree = cKDTree(self.contacts.points)
        distances, _ = tree.query(points, distance_upper_bound=0.5 * self.space.step)
        near = np.flatnonzero(np.isfinite(distances))
        if len(near):
            occupied[near] |= self.surface.evaluate(points[near]) < 0.0
        return occupied
