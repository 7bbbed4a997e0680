"""Space that the inner links of a hand keep out of on a probe: the estimated object and around."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.typing import FloatArray

# Cells of the grid along the object's largest extent; the grid reaches beyond it by so many sizes.
_CELLS, _MARGIN = 24, 0.2
# Fewer contacts show no surface: inner links keep out of nothing.
_FEW = 5
# Distance to keep from the estimate: so many standard deviations, between these bounds [m].
_DEVIATIONS, _LEAST, _LARGEST = 2.0, 0.004, 0.012


FREE, NEAR, INSIDE = range(3)
"""Places that are off the estimate, within its uncertainty, and inside of it."""


class KeepOut:
    """The estimated object, and around it what is within two standard deviations of its surface.

    Only fingertips are to touch it: the estimate counts everywhere, also far from all contacts.
    A grid of nodes approximates it; with fewer than five contacts, everything is free.
    """

    def __init__(self, obstacles: ObstacleModel) -> None:
        space, surface = obstacles.space, obstacles.surface
        self._cell = space.size / _CELLS
        count = int(np.ceil((1.0 + 2.0 * _MARGIN) * _CELLS)) + 1
        self._lowest = space.center - 0.5 * (count - 1) * self._cell
        self._levels = np.full((count,) * 3, FREE, dtype=np.int8)
        if surface is None or len(obstacles.contacts) < _FEW:
            return
        nodes = self._lowest + self._cell * np.moveaxis(np.indices((count,) * 3), 0, -1)
        inside = surface.evaluate(nodes) < 0.0  # (X, Y, Z)
        if not inside.any():
            return
        distances, nearest = ndimage.distance_transform_edt(~inside, return_indices=True)
        border = inside & ~ndimage.binary_erosion(inside)
        margins = np.zeros(inside.shape)
        deviations = surface.uncertainty(nodes[border])
        margins[border] = np.clip(_DEVIATIONS * deviations, _LEAST, _LARGEST)
        # The surface is half a cell beyond the last node inside, on average.
        apart = (distances - 0.5) * self._cell
        self._levels[apart < margins[tuple(nearest)]] = NEAR
        self._levels[inside] = INSIDE

    def nearness(self, points: FloatArray) -> int:
        """Return the worst place of points (..., 3) [m]: `FREE`, `NEAR` or `INSIDE`."""
        index = np.round((points - self._lowest) / self._cell).astype(np.intp)
        within = ((index >= 0) & (index < len(self._levels))).all(axis=-1)
        i, j, k = index[within].T
        return int(self._levels[i, j, k].max(initial=FREE))
