"""Meshing grid, and the checked and counted evaluation of an implicit surface at its nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.exceptions import EstimationError
from lis_grasp.geometry import unit
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
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


class Field:
    """Values and gradients of an implicit surface, with counts of evaluations."""

    def __init__(self, surface: ImplicitSurface) -> None:
        self._surface = surface
        self.evaluations = 0
        self.gradients = 0

    def values(self, points: FloatArray) -> FloatArray:
        """Return f at points (P, 3) [m], shape (P,), infinities too; EstimationError for NaN."""
        if not len(points):
            return np.empty(0)
        self.evaluations += len(points)
        values = np.asarray(self._surface.evaluate(points), dtype=np.float64)
        undefined = np.isnan(values)
        if undefined.any():
            place = points[np.flatnonzero(undefined)[0]]
            raise EstimationError(
                f"the surface's function must be a number everywhere; at {place} it is NaN:"
                " mesh smaller bounds, or correct the estimator"
            )
        return values

    def normals(self, points: FloatArray) -> FloatArray:
        """Return unit gradients at points (P, 3), shape (P, 3); 0 where there is none."""
        if not len(points):
            return np.empty((0, 3))
        self.gradients += len(points)
        gradients = np.asarray(self._surface.gradient(points), dtype=np.float64)
        # Scaled first: squares of very large or small components would leave the number range.
        largest = np.abs(gradients).max(axis=1)
        defined = np.isfinite(largest) & (largest > 0.0)
        normals = np.zeros_like(gradients)
        normals[defined] = unit(gradients[defined] / largest[defined, None])
        return normals

    def uncertainty(self, points: FloatArray) -> FloatArray:
        """Return one standard deviation of the surface at points (P, 3), shape (P,) [m].

        Raises `EstimationError` if it is negative or NaN somewhere.
        """
        uncertainty = np.asarray(self._surface.uncertainty(points), dtype=np.float64)
        if not (uncertainty >= 0.0).all():
            place = points[np.flatnonzero(~(uncertainty >= 0.0))[0]]
            raise EstimationError(
                f"the surface's uncertainty must be 0 or more everywhere; at {place} it is not:"
                " correct the estimator"
            )
        return uncertainty
