"""Meshing grid: cubic cells over the bounds, nodes with one index each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# Parts of a cell by which the grid is shifted: multiples of the golden ratio, no simple fractions.
_SHIFT = np.array([0.1459, 0.0902, 0.0557])
# Boxes of fewer cells are not shifted: a single node inside should be in the middle.
_MANY = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Cubic cells that cover a box and reach a little beyond each of its sides.

    Nodes are numbered in C order of (x, y, z); a cell has the number of its lowest node.
    """

    origin: FloatArray  # (3,) [m], the lowest node, in O
    cell: float  # side of a cell [m]
    nodes: tuple[int, int, int]  # number of nodes along x, y and z
    bounds: FloatArray  # (2, 3) [m], the box

    @classmethod
    def cover(cls, bounds: FloatArray, cell: float, *, multiple: int) -> Grid:
        """Lay a grid over `bounds`, its number of cells a multiple of `multiple` each way.

        The sides of the box are at least a tenth of a cell away from every node: bounds on faces of
        the object would otherwise put nodes there, neither inside nor outside. For the same reason
        the grid is shifted by odd fractions of a cell: faces are often at round coordinates.
        """
        length = (bounds[1] - bounds[0]) / cell  # (3,) in cells
        excess = length % 1.0
        margin = np.where(excess < 0.5, 0.5 - 0.5 * excess, 1.0 - 0.5 * excess)
        margin += np.where(length > _MANY, _SHIFT, 0.0)
        cells = multiple * np.ceil((length + margin + 0.25) / multiple).astype(int)
        nodes = (int(cells[0]) + 1, int(cells[1]) + 1, int(cells[2]) + 1)
        return cls(bounds[0] - margin * cell, cell, nodes, bounds)

    @property
    def strides(self) -> tuple[int, int, int]:
        """Difference of two nodes' numbers for a step along x, y and z."""
        return self.nodes[1] * self.nodes[2], self.nodes[2], 1

    def coordinates(self, numbers: IndexArray) -> IndexArray:
        """Return grid coordinates of nodes, shape (N, 3)."""
        return np.stack(np.unravel_index(numbers, self.nodes), axis=-1)

    def positions(self, numbers: IndexArray) -> FloatArray:
        """Return positions of nodes, shape (N, 3) [m]."""
        return self.origin + self.cell * self.coordinates(numbers)

    def within_bounds(self) -> BoolArray:
        """Return which nodes are inside the box, shape `nodes`."""
        x, y, z = (
            (low < ticks) & (ticks < high)
            for low, high, ticks in zip(*self.bounds, self._ticks(), strict=True)
        )
        return x[:, None, None] & y[:, None] & z

    def _ticks(self) -> list[FloatArray]:
        return [self.origin[k] + self.cell * np.arange(self.nodes[k]) for k in range(3)]
