"""Checked and counted evaluation of an implicit surface."""

from __future__ import annotations

import numpy as np

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.typing import FloatArray


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
        normals[defined] = gradients[defined] / largest[defined, None]
        normals[defined] /= np.linalg.norm(normals[defined], axis=1, keepdims=True)
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
