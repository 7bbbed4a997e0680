"""Estimate of an object that rests on a table: nothing of it is below the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.records import short_repr
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.queries import flat_points
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class AboveTableImplicitSurface:
    """An estimate less the half-space below a table (CSG intersection).

    f(x) = max(g(x), h - x_z)

    with the estimate g and the height h of the table. The hand cannot touch an underside: the
    estimate, extrapolated there, is closed by the table. Its uncertainty stays that of g.
    """

    surface: ImplicitSurface  #: the estimate g
    height: float  #: of the table [m]

    __repr__ = short_repr

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.surface.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = np.maximum(self.surface.evaluate(rows), self.height - rows[:, 2])
        return np.asarray(values.reshape(shape))

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward."""
        rows, shape = flat_points(points)
        gradients = np.array(self.surface.gradient(rows))
        gradients[self.height - rows[:, 2] > self.surface.evaluate(rows)] = (0.0, 0.0, -1.0)
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the estimate along its normal, shape (...) [m]."""
        return self.surface.uncertainty(points)


def above_table(surface: ImplicitSurface, height: float | None) -> ImplicitSurface:
    """Return an estimate closed by a table at a height [m]; None for no table."""
    return surface if height is None else AboveTableImplicitSurface(surface, height)
