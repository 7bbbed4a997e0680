"""What every estimated surface promises, whatever its mathematics.

An implicit surface is a function f of space whose zero set is the surface (Ottenhaus et al. 2016,
eq. 1). Promised are its sign (negative inside, positive outside), its zero set, and that every
point that can be asked for has a finite value, near contacts or far from them. Not promised is that
f is a distance: an estimator whose values are metric says so in its own docstring.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy.typing as npt

from lis_grasp.typing import FloatArray


@runtime_checkable
class ImplicitSurface(Protocol):
    """A surface given by the zero set of a function, all of it in the object frame O."""

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m].

        The contacts' box grown by a margin: outside of it there is a value, but no evidence.
        """
        ...

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): negative inside, 0 on the surface.

        Raises
        ------
        InvalidOptionError
            If the last axis is not of length 3 or a coordinate is not finite.
        """
        ...

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward.

        Not normalised. Where f has a kink, the value is one of, or between, its one-sided
        gradients.
        """
        ...

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        Meant for points on or near the zero set.
        """
        ...
