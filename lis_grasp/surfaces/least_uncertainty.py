"""Least uncertainty of an estimate far from all measurements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.queries import Predicting, flat_points
from lis_grasp.typing import FloatArray
from lis_grasp.underflow import methods_underflow

# Growth of the standard deviation of a surface with the distance from the nearest contact.
_GROWTH = 0.25


@methods_underflow
@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class LeastUncertainty(Predicting, Record):
    """An estimate that is at least as uncertain as the nearest measured contact permits.

    s(x)^2 = max(g(x)^2, n^2 + (k d)^2)

    with the estimate's own deviation g, and the noise n of the nearest contact at a distance d.
    Hundreds of contacts of one view have an error in common, that of the camera's pose, and
    contacts that are assumed where nothing was measured agree with each other: a process that takes
    their errors for independent is too certain of both.

    Examples
    --------
    >>> far = LeastUncertainty(surface, contacts)
    >>> bool(np.all(far.uncertainty(contacts.points) >= surface.uncertainty(contacts.points)))
    True
    """

    surface: ImplicitSurface  #: the estimate
    measured: Contacts  #: seen or touched, at least one, in the frame of the estimate

    __repr__ = short_repr

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.measured.points)

    @property
    def bounds(self) -> FloatArray:
        """Box of the estimate, shape (2, 3) [m]."""
        return self.surface.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): that of the estimate."""
        return self.surface.evaluate(points)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        return self.surface.gradient(points)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m]."""
        rows, shape = flat_points(points)
        distances, nearest = self._tree.query(rows)
        noise = self.measured.position_noise
        least = _GROWTH * distances
        if noise is not None:
            least = np.hypot(np.nan_to_num(noise)[nearest], least)
        return np.maximum(self.surface.uncertainty(rows), least).reshape(shape)
