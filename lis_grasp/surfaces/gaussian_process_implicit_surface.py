"""Gaussian process implicit surface (GPIS) from contact positions and normals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.records import made_by, short_repr
from lis_grasp.surfaces._gaussian_process_regression import ROWS, GradientRegression
from lis_grasp.surfaces._kernels import (
    Matern52,
    RadialKernel,
    SquaredExponential,
    ThinPlate,
)
from lis_grasp.surfaces.contact_places import resolution_of
from lis_grasp.surfaces.contact_preparation import PreparedContacts, prepare_contacts
from lis_grasp.surfaces.queries import flat_points, map_rows, require_range
from lis_grasp.typing import FloatArray, IndexArray

KernelName = Literal["rbf", "matern52", "thin_plate"]
"""Name of a kernel."""

_KERNELS: dict[KernelName, type[SquaredExponential] | type[Matern52] | type[ThinPlate]] = {
    "rbf": SquaredExponential,
    "matern52": Matern52,
    "thin_plate": ThinPlate,
}

# Length of each kernel, in largest distances between two contacts; of the thin plate, in diagonals
# of the bounds: its matrix is positive definite only above about 4/3 of the largest distance.
# Chosen on eight objects of 0.2 m, five walks each. Maximum marginal likelihood and leave-one-out
# density lose edges (matern52: 6.5 and 6.3 mm rms there, instead of 5.8 mm).
_LENGTHS: dict[KernelName, float] = {"rbf": 0.4, "matern52": 0.8, "thin_plate": 1.5}

# Below this slope the gradient does not locate the surface.
_MIN_SLOPE = 0.1
# Noise for edges that no smooth f can follow, see `from_contacts`.
_MISFIT = (0.001, 0.1)
# The prior's amplitude is fitted to so many contacts at most: it takes a dozen solutions.
_MOST_FOR_AMPLITUDE = 150


@made_by("from_contacts")
@dataclass(frozen=True, eq=False)
class GaussianProcessImplicitSurface:
    """The posterior mean of a GP conditioned on value 0 and the normal as gradient at contacts.

    f(x) = mean + k_*^T (K + noise)^-1 (targets - mean)                                   (eq. 3)

    with value and gradient blocks in K, 4N x 4N (Williams and Fitzgibbon 2007; Rasmussen and
    Williams 2006, section 9.4; Ottenhaus et al. 2016, section II.B). The prior mean is positive:
    far from every contact is outside. Coordinates are centred on the contacts and scaled to about
    unit size; everything private is in that unit.

    Made by `from_contacts`. Near contacts f is about metric [m], because its gradient there has
    unit length. Far from them it flattens to the prior mean, except for the thin plate, which keeps
    rising.

    Examples
    --------
    >>> surface = GaussianProcessImplicitSurface.from_contacts(contacts)
    >>> surface.uncertainty(contacts.points).shape
    (6,)
    """

    points: FloatArray  #: (N, 3) [m], contacts in O
    normals: FloatArray  #: (N, 3), unit, outward
    kernel: RadialKernel  #: covariance, in scaled coordinates
    center: FloatArray  #: (3,) [m], origin of the scaled coordinates
    scale: float  #: their unit [m]: the largest distance between two contacts
    mean: float  #: prior mean, scaled
    bounds: FloatArray  #: (2, 3) [m], the contacts' box grown by one spacing
    _contacts: PreparedContacts
    _process: GradientRegression

    __repr__ = short_repr

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts | PreparedContacts,
        *,
        kernel: KernelName = "matern52",
        length: float | None = None,
        position_noise: float | None = None,
        normal_noise: float | None = None,
        misfit: tuple[float, float] = _MISFIT,
        prior_mean: float | None = None,
    ) -> GaussianProcessImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts, position_noise, normal_noise
            See `prepare_contacts`, also for errors.
        kernel
            "matern52", "rbf" (eq. 6) or "thin_plate" (eq. 2, see `ThinPlate`).
        length
            Of the kernel [m]. None takes 0.8 (Matern) or 0.4 (RBF) of the largest distance between
            two contacts, or for the thin plate 1.5 diagonals of the bounds (its length must exceed
            every distance).
        misfit
            Noise of positions and of normals added to the sensor's, for edges that no smooth f can
            follow, in units of the prior's standard deviation (scaled, and so in radians for the
            normals). Far less than the default makes spurious sheets between contacts.
        prior_mean
            f far from all contacts [m], above 0; None takes the largest distance between two
            contacts.

        Raises
        ------
        InvalidOptionError
            If an option is outside its range or set.
        EstimationError
            If the equations are singular to working precision.
        """
        if kernel not in _KERNELS:
            raise InvalidOptionError.not_one_of("kernel", kernel, _KERNELS)
        prepared = prepare_contacts(contacts, position_noise, normal_noise)
        contacts, spacing = prepared.contacts, prepared.spacing
        largest = float(pdist(contacts.points).max(initial=0.0))
        scale = largest if largest > resolution_of(contacts) else spacing
        for part in misfit:
            require_range("misfit", part)
        prior_mean = scale if prior_mean is None else prior_mean
        require_range("prior_mean", prior_mean, unit="m", above_zero=True)
        if length is None:
            sides = np.ptp(contacts.points, axis=0) + 2.0 * spacing
            unit = np.linalg.norm(sides) / scale if kernel == "thin_plate" else 1.0
            scaled_length = float(_LENGTHS[kernel] * unit)
        else:
            scaled_length = require_range("length", length, unit="m", above_zero=True) / scale
        center = contacts.bounds.mean(axis=0)

        def observed(some: PreparedContacts) -> tuple[FloatArray, FloatArray, FloatArray]:
            points, normals = some.contacts.points, some.contacts.normals
            values = np.full((len(points), 1), -prior_mean / scale)  # f less its prior mean
            return (
                (points - center) / scale,
                np.hstack([values, normals]),
                _variances(some.position_noise / scale, some.normal_noise),
            )

        prior, of_misfit = _KERNELS[kernel](scaled_length), _variances(*misfit)
        nodes, targets, noise = observed(prepared)
        if noise.any():  # in units of the prior's amplitude, and so is the result
            few, few_targets, few_noise = observed(prepared.thinned(_MOST_FOR_AMPLITUDE))
            log_amplitude = GradientRegression.log_prior_amplitude(
                prior, few, few_targets, sensor_noise=few_noise, misfit=of_misfit
            )
            noise = noise * np.exp(-2.0 * log_amplitude)
        process = GradientRegression.fit(prior, nodes, targets, of_misfit + noise)
        return cls(
            points=contacts.points,
            normals=contacts.normals,
            kernel=process.kernel,
            center=center,
            scale=scale,
            mean=prior_mean / scale,
            bounds=prepared.bounds,
            _contacts=prepared,
            _process=process,
        )

    @cached_property
    def amplitude(self) -> float:
        """Standard deviation of the prior, scaled, see `variance`."""
        # Contacts of one place predict each other, however wrong the surface between places.
        places = self._contacts.places
        return self._process.leave_groups_out_amplitude(places.place, places.nodes)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior mean of f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = self._scaled(points)
        values = map_rows(self._process.mean.value, rows, len(self.points))
        return self.scale * (self.mean + values).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = self._scaled(points)
        gradients = map_rows(self._process.mean.gradient, rows, len(self.points))
        return gradients.reshape(*shape, 3)

    def variance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior variance of f, shape (...) [m^2].

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26), times the square
        of the prior's amplitude, which fits the residuals of places that are left out
        (`GradientRegression.leave_groups_out_amplitude`).
        """
        rows, shape = self._scaled(points)
        variances = map_rows(self._process.variance, rows, ROWS * len(self.points))
        return (self.amplitude * self.scale) ** 2 * variances.reshape(shape)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of f over the length of its gradient: to first order, the
        shift of the zero. Capped by the diagonal of the bounds. Averaged over the objects of
        `shapes` it is calibrated; on the middle of faces it is too large, beside edges, which no
        smooth f can follow, too small.
        """
        rows, shape = flat_points(points)
        deviation = np.sqrt(self.variance(rows))
        slope = np.maximum(np.linalg.norm(self.gradient(rows), axis=1), _MIN_SLOPE)
        limit = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))
        return np.minimum(deviation / slope, limit).reshape(shape)

    def leave_groups_out(self, groups: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return leave-group-out predictions at each contact: f (N,) [m], gradient (N, 3).

        Contacts of one number in `groups`, (N,), are predicted from all others; kernel, noise,
        prior mean and scaled coordinates stay.
        """
        means = self._process.leave_groups_out(groups)
        return self.scale * (self.mean + means[:, 0]), means[:, 1:]

    def _scaled(self, points: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        """Return points as scaled rows (P, 3), and the shape (...) of the query."""
        rows, shape = flat_points(points)
        return (rows - self.center) / self.scale, shape


def _variances(value_deviation: npt.ArrayLike, gradient_deviation: npt.ArrayLike) -> FloatArray:
    """Return the variances of a value and three slopes, shape (..., 4)."""
    return np.stack([value_deviation, *[gradient_deviation] * 3], axis=-1) ** 2
