"""Space at an estimated object: what inner links keep out of, and where a hand is slow."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.meshing.occupancy import occupied_nodes
from lis_grasp.typing import BoolArray, FloatArray

_T = TypeVar("_T", bound=np.generic)

# Cells of the grid along the object's largest extent; the grid extends this many sizes beyond it.
_CELLS, _MARGIN = 24, 0.2
# Fewer contacts do not show a surface, and inner links may be anywhere.
_FEW = 5
# Distance to keep from the estimate: standard deviations, and its bounds [m].
_DEVIATIONS, _LEAST, _LARGEST = 2.0, 0.004, 0.012
# The same, within which a hand is slow; links are covered by points that are apart.
_SLOW_DEVIATIONS, _SLOW_LEAST, _SLOW_LARGEST = 3.0, 0.012, 0.06

FREE, NEAR, INSIDE = range(3)
"""Places that are off the estimate, within its uncertainty, and inside of it."""


@lru_cache(maxsize=1)
def keep_out_of(obstacles: ObstacleModel) -> KeepOut:
    """Return the space at an estimated object; the last one is kept."""
    return KeepOut(obstacles)


class KeepOut:
    """The estimated object, and the space within two standard deviations of its surface.

    Only fingertips are to touch it: the estimate counts everywhere, also far from all contacts.
    A grid of nodes approximates it; with fewer than five contacts, everything is free.
    """

    def __init__(self, obstacles: ObstacleModel) -> None:
        space, surface = obstacles.space, obstacles.surface
        self._cell = space.size / _CELLS
        self._space, self._region = space, obstacles.region
        #: whether the contacts show the object
        self.is_known = surface is not None and len(obstacles.contacts) >= _FEW
        if surface is None or not self.is_known:
            return
        reach = (0.5 + _MARGIN) * space.size
        box = np.array([space.center - reach, space.center + reach])
        self._lowest, inside = occupied_nodes(surface, box, self._cell)
        self.is_known = bool(inside.any())
        if not self.is_known:
            return
        distances, nearest = ndimage.distance_transform_edt(~inside, return_indices=True)
        border = inside & ~ndimage.binary_erosion(inside)
        deviations = np.zeros(inside.shape)
        nodes = self._lowest + self._cell * np.argwhere(border)
        deviations[border] = surface.uncertainty(nodes)
        deviations = deviations[tuple(nearest)]
        # The surface is half a cell beyond the last node inside, on average.
        apart = (distances - 0.5) * self._cell
        near = apart < np.clip(_DEVIATIONS * deviations, _LEAST, _LARGEST)
        self._levels = np.where(inside, INSIDE, np.where(near, NEAR, FREE)).astype(np.int8)
        slow = np.clip(_SLOW_DEVIATIONS * deviations, _SLOW_LEAST, _SLOW_LARGEST)
        self._slow = (apart < slow) | inside
        outermost = np.pad(
            np.zeros(np.subtract(inside.shape, 2), dtype=np.bool_), 1, constant_values=True
        )
        self._levels[outermost], self._slow[outermost] = FREE, False

    def nearness(self, points: FloatArray) -> int:
        """Return the worst place of points (..., 3) [m] at a known object, such as `NEAR`."""
        return int(self._at(self._levels, points).max(initial=FREE))

    def may_touch(self, points: FloatArray) -> BoolArray:
        """Return which points (..., 3) [m] on a hand may touch the object, shape (...).

        They are within three standard deviations of the estimate's surface, or, before contacts
        show the object, in the ball, and the region, that contain it.
        """
        if not self.is_known:
            space = self._space
            inside = np.linalg.norm(points - space.center, axis=-1) < space.radius
            if self._region is not None:
                low, high = self._region
                inside &= np.all((points > low) & (points < high), axis=-1)
            return np.asarray(inside)
        return self._at(self._slow, points)

    def _at(self, values: NDArray[_T], points: FloatArray) -> NDArray[_T]:
        """Return the values (...) of the nodes nearest to points (..., 3).

        Beyond the grid, they are those of its outermost nodes, which are free.
        """
        index = ((points - (self._lowest - 0.5 * self._cell)) / self._cell).astype(np.int32)
        i, j, k = np.moveaxis(np.clip(index, 0, np.array(values.shape) - 1), -1, 0)
        return values[i, j, k]
