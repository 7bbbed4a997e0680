"""The ImplicitSurface protocol that every estimator implements, and a deferred estimate.

An implicit surface is the zero set of a function f of space (Ottenhaus et al. 2016, eq. 1).
Guaranteed are the sign of f (negative inside, positive outside), its zero set, and a finite value
at every point, near contacts or far from them. f need not be a distance: an estimator whose values
are metric says so in its own docstring.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from lis_grasp.typing import FloatArray


@runtime_checkable
class ImplicitSurface(Protocol):
    """A surface given by the zero set of a function, in the object frame O.

    Examples
    --------
    >>> isinstance(estimate(contacts), ImplicitSurface)
    True
    """

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m].

        The contacts' box grown by a margin: outside of it there is a value, but no evidence.
        """

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): negative inside, 0 on the surface.

        Raises `InvalidOptionError` if the last axis is not of length 3 or a coordinate is not
        finite.
        """

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward.

        Not normalised. Where f has a kink, the result is one of, or between, the one-sided
        gradients.
        """

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        Valid on or near the zero set.
        """


class DeferredSurface:
    """A surface made by a function, which is called once, at the first use.

    Parameters
    ----------
    make
        Makes the surface. Its errors are raised at the first use.
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
