"""Baseline surfaces interpolated from offset points on both sides of each contact."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RBFInterpolator

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.io.optional_packages import needed_package
from lis_grasp.surfaces.queries import flat_points
from lis_grasp.typing import FloatArray
from lis_grasp_studies.baselines._support import BaselineSurface, Support

Predict = Callable[[FloatArray], FloatArray]
Fit = Callable[[FloatArray, FloatArray], Predict]

# Distance of the points beside a contact, in spacings.
_OFFSET = 0.25
# Step of differences, in extents of the contacts.
_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSurface(BaselineSurface):
    """Interpolation of the values 0 at contacts, +h outside and -h inside of them.

    General interpolators take no normals. So each normal is replaced by two points at a distance h
    on either side of the contact, with the values +h and -h (Carr et al. 2001, "Reconstruction and
    representation of 3D objects with radial basis functions"). By default h is a quarter of the
    contacts' spacing. Coordinates are centred on the contacts and scaled to about unit size.

    Made by `thin_plate` (SciPy) or `gaussian_process` (scikit-learn).
    """

    error: ClassVar[float] = 0.2
    support: Support
    predict: Predict

    @classmethod
    def thin_plate(
        cls, contacts: Contacts, *, offset: float = _OFFSET, smoothing: float = 0.0
    ) -> OffsetSurface:
        """Interpolate by SciPy's RBFInterpolator, a thin-plate spline.

        `offset` is h in spacings of the contacts; `smoothing` is RBFInterpolator's.
        """
        return cls._fitted(contacts, partial(RBFInterpolator, smoothing=smoothing), offset)

    @classmethod
    def gaussian_process(cls, contacts: Contacts) -> OffsetSurface:
        """Regress by scikit-learn's GaussianProcessRegressor, length by its marginal likelihood.

        InvalidOptionError if scikit-learn is not installed.
        """
        with needed_package("scikit-learn", "baselines"):
            from sklearn.exceptions import ConvergenceWarning
            from sklearn.gaussian_process import GaussianProcessRegressor
            from sklearn.gaussian_process.kernels import RBF, WhiteKernel

        def fit(points: FloatArray, values: FloatArray) -> Predict:
            kernel = RBF(0.4, (0.1, 2.0)) + WhiteKernel(1e-6, (1e-9, 1e-2))
            # The prior mean is one extent, as in GaussianProcessImplicitSurface.
            with warnings.catch_warnings():
                # A length or noise at a border of its range is accepted.
                warnings.simplefilter("ignore", ConvergenceWarning)
                process = GaussianProcessRegressor(kernel).fit(points, values - 1.0)
            return lambda queries: np.asarray(process.predict(queries) + 1.0)

        return cls._fitted(contacts, fit)

    @classmethod
    def _fitted(cls, contacts: Contacts, fit: Fit, offset: float = _OFFSET) -> OffsetSurface:
        support = Support.of(contacts)
        points, normals = support.contacts.points, support.contacts.normals
        h = offset * support.spacing
        around = np.vstack([points + s * normals for s in (0.0, h, -h)])
        values = np.repeat([0.0, h, -h], len(points)) / support.scale
        try:
            predict = fit(support.scaled(around), values)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise EstimationError(
                f"the interpolation's equations are singular ({error}): it needs contacts that are"
                " not all in one plane"
            ) from None
        return cls(support, predict)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        if not len(rows):
            return np.empty(shape)
        return self.support.scale * self.predict(self.support.scaled(rows)).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], by central differences."""
        rows, shape = flat_points(points)
        array = rows.reshape(*shape, 3)
        step = _STEP * self.support.scale
        sides = [self.evaluate(array + s) - self.evaluate(array - s) for s in step * np.eye(3)]
        return np.stack(sides, axis=-1) / (2.0 * step)
