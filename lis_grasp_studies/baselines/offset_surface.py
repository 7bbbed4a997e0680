"""Baseline surfaces interpolated from offset points on both sides of each contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RBFInterpolator

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.queries import flat_points
from lis_grasp.typing import FloatArray
from lis_grasp_studies.baselines._support import BaselineSurface, Support

Predict = Callable[[FloatArray], FloatArray]

# Distance of the points beside a contact, in spacings.
_OFFSET = 0.25
# Step of differences, in extents of the contacts.
_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSurface(BaselineSurface):
    """Interpolation of the values 0 at contacts, +h outside and -h inside of them.

    SciPy's thin-plate spline takes no normals. So each normal is replaced by two points at a
    distance h on either side of the contact, with the values +h and -h (Carr et al. 2001,
    "Reconstruction and representation of 3D objects with radial basis functions"). By default h is
    a quarter of the contacts' spacing. Coordinates are centred on the contacts and scaled to about
    unit size.
    """

    error: ClassVar[float] = 0.2
    support: Support
    predict: Predict

    @classmethod
    def thin_plate(
        cls,
        contacts: Contacts,
        *,
        offset: float = _OFFSET,
        smoothing: float = 0.0,
        position_noise: float = 0.0,
    ) -> OffsetSurface:
        """Interpolate by SciPy's RBFInterpolator, a thin-plate spline.

        `offset` is h in spacings of the contacts; `smoothing` is RBFInterpolator's. The standard
        deviation of positions [m] adds to the uncertainty alone.
        """
        support = Support.of(contacts, position_noise)
        points, normals = support.contacts.points, support.contacts.normals
        h = offset * support.spacing
        around = np.vstack([points + s * normals for s in (0.0, h, -h)])
        values = np.repeat([0.0, h, -h], len(points)) / support.scale
        try:
            predict = RBFInterpolator(support.scaled(around), values, smoothing=smoothing)
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
