"""Workspace: prior knowledge of the object, and the obstacles known while it is explored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.level_set_samples import sample_zero_level_set
from lis_grasp.records import read_only
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import BoolArray, FloatArray

STEP_FRACTION = 0.25
"""Length of a step in sizes of the object: 50 mm on 20 cm (Ottenhaus et al. 2016, IV.B)."""

# An estimate is sampled on a grid of this many cells a step, in a box larger than the object's by
# this fraction of its size.
_CELLS_PER_STEP, _MARGIN = 4.0, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Position and size of an object, without its shape.

    Parameters
    ----------
    step
        Distance between touches [m]; a surface is explored within a step of a contact.
    center
        Shape (3,) [m], in O: centre of the object's bounding box.
    size
        Largest extent of the object [m].
    support_height
        Height in O of the table under the object [m]; None for an object that is held, and can be
        touched from below.

    Raises
    ------
    InvalidOptionError
        If a length is not positive or the centre is not three finite numbers.
    """

    step: float
    center: FloatArray
    size: float
    support_height: float | None = None

    def __post_init__(self) -> None:
        for name in ("step", "size"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidOptionError.out_of_range(name, value, "a positive length [m]")
        center = np.array(self.center, dtype=np.float64)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise InvalidOptionError.out_of_range("center", self.center, "3 finite numbers")
        object.__setattr__(self, "center", read_only(center))

    @property
    def radius(self) -> float:
        """Radius of the ball about the centre that contains the object [m]."""
        return 0.5 * float(np.sqrt(3.0)) * self.size

    def approach_distance(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the distance from the object's ball to each point along its direction [m].

        Points and unit directions have shapes (..., 3) [m] and (..., 3). The distance is measured
        backwards to where the line enters the ball; 0 if it misses the ball or ends before it.
        """
        offsets = points - self.center
        along = np.sum(offsets * directions, axis=-1)
        inside = self.radius**2 - np.sum(offsets * offsets, axis=-1) + along**2
        return np.where(
            inside > 0.0, np.maximum(along + np.sqrt(np.maximum(inside, 0.0)), 0.0), 0.0
        )

    def sample(
        self, surface: ImplicitSurface, *, rng: np.random.Generator | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return points and unit outward normals of an estimate here, shapes (P, 3).

        The points are a quarter of a step apart. With `rng`, the grid is shifted at random, which
        keeps its pattern out of the touches.
        """
        cell = self.step / _CELLS_PER_STEP
        half = (0.5 + _MARGIN) * self.size
        shift = 0.0 if rng is None else cell * rng.random(3)
        low = self.center - half - shift
        return sample_zero_level_set(surface, np.array([low, self.center + half]), cell)


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleModel:
    """Known object and table, which the hand avoids on its approach to a probe."""

    space: Workspace
    contacts: Contacts
    surface: ImplicitSurface | None  # estimated from the contacts, free space carved off

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
