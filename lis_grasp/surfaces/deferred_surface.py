"""A surface that is estimated when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy.typing as npt

from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.typing import FloatArray


class DeferredSurface:
    """The surface that a function makes; it is called at the first use, and once.

    Parameters
    ----------
    make
        Makes the surface. What it raises, the first use raises.
    """

    def __init__(self, make: Callable[[], ImplicitSurface]) -> None:
        self._make = make

    @cached_property
    def surface(self) -> ImplicitSurface:
        """The surface."""
        return self._make()

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.surface.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        return self.surface.evaluate(points)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward."""
        return self.surface.gradient(points)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m]."""
        return self.surface.uncertainty(points)
