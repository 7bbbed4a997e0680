"""Space at an estimated object: what inner links keep out of, and where a hand is slow."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import ndimage

from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

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
        count = int(np.ceil((1.0 + 2.0 * _MARGIN) * _CELLS)) + 1
        self._lowest = space.center - 0.5 * (count - 1) * self._cell
        self._levels = np.full((count,) * 3, FREE, dtype=np.int8)
        self._slow = np.zeros((count,) * 3, dtype=np.bool_)
        self._space = space
        #: whether the contacts show the object
        self.is_known = surface is not None and len(obstacles.contacts) >= _FEW
        if surface is None or not self.is_known:
            return
        nodes = self._lowest + self._cell * np.moveaxis(np.indices((count,) * 3), 0, -1)
        inside = surface.evaluate(nodes) < 0.0  # (X, Y, Z)
        self.is_known = bool(inside.any())
        if not self.is_known:
            return
        distances, nearest = ndimage.distance_transform_edt(~inside, return_indices=True)
        border = inside & ~ndimage.binary_erosion(inside)
        deviations = np.zeros(inside.shape)
        deviations[border] = surface.uncertainty(nodes[border])
        deviations = deviations[tuple(nearest)]
        # The surface is half a cell beyond the last node inside, on average.
        apart = (distances - 0.5) * self._cell
        self._levels[apart < np.clip(_DEVIATIONS * deviations, _LEAST, _LARGEST)] = NEAR
        self._levels[inside] = INSIDE
        slow = np.clip(_SLOW_DEVIATIONS * deviations, _SLOW_LEAST, _SLOW_LARGEST)
        self._slow = (apart < slow) | inside

    def nearness(self, points: FloatArray) -> int:
        """Return the worst place of points (..., 3) [m]: `FREE`, `NEAR` or `INSIDE`."""
        index, within = self._index(points)
        i, j, k = index[within].T
        return int(self._levels[i, j, k].max(initial=FREE))

    def may_touch(self, points: FloatArray) -> BoolArray:
        """Return which points (..., 3) [m] on a hand may touch the object, shape (...).

        They are within three standard deviations of the estimate's surface, or, before contacts
        show the object, in the ball that contains it.
        """
        if not self.is_known:
            space = self._space
            return np.asarray(np.linalg.norm(points - space.center, axis=-1) < space.radius)
        index, within = self._index(points)
        found = np.zeros(within.shape, dtype=np.bool_)
        i, j, k = index[within].T
        found[within] = self._slow[i, j, k]
        return found

    def _index(self, points: FloatArray) -> tuple[IndexArray, BoolArray]:
        """Return the nodes nearest to points (..., 3), and which are in the grid, (...)."""
        index = np.round((points - self._lowest) / self._cell).astype(np.intp)
        within = (index >= 0) & (index < len(self._levels))
        return index, np.asarray(within.all(axis=-1))
