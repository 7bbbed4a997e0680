"""Gaussian process implicit surface (GPIS) from contact positions and normals.

f(x) = mean + k_*^T (K + noise)^-1 (targets - mean)                                   (eq. 3)

with value and gradient blocks in K, 4N x 4N (Williams and Fitzgibbon 2007; Rasmussen and
Williams 2006, section 9.4; Ottenhaus et al. 2016, section II.B). The prior mean is positive:
far from every contact is outside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.guesses import with_advice
from lis_grasp.records import short_repr
from lis_grasp.surfaces._gaussian_process_regression import ROWS, GradientRegression
from lis_grasp.surfaces._kernels import (
    MISFIT,
    Matern52,
    Matern72,
    RadialKernel,
    SquaredExponential,
    ThinPlate,
)
from lis_grasp.surfaces.contact_preparation import PreparedContacts, prepare_contacts
from lis_grasp.surfaces.queries import Predicting, flat_points, map_rows, require_range
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

KernelName = Literal["rbf", "matern52", "matern72", "thin_plate"]
"""Name of a kernel."""

_KERNELS: dict[KernelName, Callable[[float], RadialKernel]] = {
    "rbf": SquaredExponential,
    "matern52": Matern52,
    "matern72": Matern72,
    "thin_plate": ThinPlate,
}

# Length of each kernel, in largest distances between two contacts; of the thin plate, in diagonals
# of the bounds: its matrix is positive definite only above about 4/3 of the largest distance.
# Chosen on eight objects of 0.2 m, five walks each. Maximum marginal likelihood and leave-one-out
# density lose edges (matern52: 6.5 and 6.3 mm rms there, instead of 5.8 mm).
_LENGTHS: dict[KernelName, float] = {
    "rbf": 0.4,
    "matern52": 0.8,
    "matern72": 0.8,
    "thin_plate": 1.5,
}

# Below this slope the gradient does not locate the surface.
_MIN_SLOPE = 0.1
# Least standard deviation of the surface, in largest distances between two contacts.
_LEAST = 0.0003
# Largest number of contacts for fitting settings: the prior's amplitude takes a dozen solutions.
MOST_FOR_SETTINGS = 150
# The least axis of stretched coordinates, as a fraction of the largest.
_LEAST_AXIS = 0.15


@methods_underflow
@dataclass(frozen=True, eq=False)
class GaussianProcessImplicitSurface(Predicting):
    """The posterior mean of a GP conditioned on value 0 and the normal as gradient at contacts.

    Made by `from_contacts` (Williams and Fitzgibbon 2007; equations of Ottenhaus et al. 2016). Near
    contacts f is about metric [m]; far from them it flattens to the prior mean, except for the thin
    plate.

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
    squeeze: FloatArray | None  #: (3, 3), maps scaled to stretched coordinates; None for the same
    gain: float  #: makes f metric where gradients are of free length
    bounds: FloatArray  #: (2, 3) [m], the contacts' box grown by a margin
    _contacts: PreparedContacts
    _process: GradientRegression

    __repr__ = short_repr

    @classmethod
    @with_advice
    def from_contacts(
        cls,
        contacts: Contacts | PreparedContacts,
        *,
        kernel: KernelName = "matern52",
        length: float | None = None,
        position_noise: float | None = None,
        normal_noise: float | None = None,
        misfit: tuple[float, float] = MISFIT,
        prior_mean: float | None = None,
        length_noise: float = 0.0,
        stretch: bool = False,
    ) -> GaussianProcessImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Parameters
        ----------
        contacts, position_noise, normal_noise
            See `prepare_contacts`, also for errors.
        kernel
            "matern52", "matern72", "rbf" (eq. 6) or "thin_plate" (eq. 2, see `ThinPlate`).
        length
            Of the kernel [m]. None takes 0.8 (Matern) or 0.4 (RBF) of the largest distance between
            two contacts, or for the thin plate 1.5 diagonals of the bounds (its length must exceed
            every distance).
        misfit
            Noise of positions and of normals added to the sensor's, for edges that no smooth f can
            follow, in units of the prior's standard deviation.
        prior_mean
            f far from all contacts [m], above 0; None takes the largest distance between two
            contacts.
        length_noise
            Standard deviation of the gradients' lengths at contacts, in units of the prior's: 0
            binds them to 1.
        stretch
            Whether the kernel's length is proportional to the contacts' extent along each principal
            axis, instead of the same in all directions. Not for "thin_plate".

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
        contacts, scale = prepared.contacts, prepared.scale
        for part in misfit:
            require_range("misfit", part)
        require_range("length_noise", length_noise)
        squeeze = _principal_squeeze(prepared) if stretch else None
        prior_mean = scale if prior_mean is None else prior_mean
        require_range("prior_mean", prior_mean, unit="m", above_zero=True)
        if length is None:
            sides = np.ptp(contacts.points, axis=0) + 2.0 * prepared.spacing
            unit = np.linalg.norm(sides) / scale if kernel == "thin_plate" else 1.0
            scaled_length = float(_LENGTHS[kernel] * unit)
        else:
            scaled_length = require_range("length", length, unit="m", above_zero=True) / scale
        center = contacts.bounds.mean(axis=0)

        def observed(some: PreparedContacts) -> tuple[FloatArray, FloatArray, FloatArray]:
            points, normals = some.contacts.points, some.contacts.normals
            values = np.full((len(points), 1), -prior_mean / scale)  # f less its prior mean
            nodes, position, normal = (points - center) / scale, some.position_noise, 1.0
            if squeeze is not None:
                nodes, slopes = nodes @ squeeze, normals @ np.linalg.inv(squeeze)
                lengths = np.linalg.norm(slopes, axis=1)
                normals, position = slopes / lengths[:, None], position / lengths
                normal = 1.0 / (np.cbrt(np.linalg.det(squeeze)) * lengths)
            return (
                nodes,
                np.hstack([values, normals]),
                _variances(position / scale, some.normal_noise * normal),
            )

        prior, of_misfit = _KERNELS[kernel](scaled_length), _variances(*misfit)
        nodes, targets, noise = observed(prepared)
        if noise.any():  # in units of the prior's amplitude, and so is the result
            few, few_targets, few_noise = observed(prepared.thinned(MOST_FOR_SETTINGS))
            log_amplitude = GradientRegression.log_prior_amplitude(
                prior,
                few,
                few_targets,
                sensor_noise=few_noise,
                misfit=of_misfit,
                length_noise=length_noise,
            )
            noise = noise * np.exp(-2.0 * log_amplitude)
        process = GradientRegression.fit(
            prior, nodes, targets, of_misfit + noise, length_noise=length_noise
        )
        gain = 1.0
        if length_noise:
            slopes = process.mean.gradient(nodes)
            slopes = slopes if squeeze is None else slopes @ squeeze
            logs = np.log(np.maximum(np.linalg.norm(slopes, axis=1), _MIN_SLOPE))
            gain = float(np.exp(-logs.mean()))
        return cls(
            points=contacts.points,
            normals=contacts.normals,
            kernel=process.kernel,
            center=center,
            scale=scale,
            mean=prior_mean / scale,
            squeeze=squeeze,
            gain=gain,
            bounds=prepared.bounds,
            _contacts=prepared,
            _process=process,
        )

    @cached_property
    def amplitude(self) -> float:
        """Standard deviation of the prior, scaled, see `variance`."""
        # Contacts of one place predict each other, however wrong the surface between places.
        places = self._contacts.places
        fitted = self._process.leave_groups_out_amplitude(places.place, places.nodes)
        return fitted * float(np.sqrt(1.0 + 2.0 / len(places.nodes)))

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior mean of f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = self._scaled(points)
        values = map_rows(self._process.mean.value, rows, len(self.points))
        return self.gain * self.scale * (self.mean + values).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = self._scaled(points)
        gradients = map_rows(self._process.mean.gradient, rows, len(self.points))
        return self._unstretched(gradients).reshape(*shape, 3)

    def variance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior variance of f, shape (...) [m^2].

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26), times the square
        of the prior's amplitude. It fits the residuals of K places that are left out, times
        sqrt(1 + 2 / K), as in Student's t.
        """
        rows, shape = self._scaled(points)
        variances = map_rows(self._process.variance, rows, ROWS * len(self.points))
        return (self.amplitude * self.gain * self.scale) ** 2 * variances.reshape(shape)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of f over the length of its gradient, which is the shift of
        the zero to first order; at least a minimum, at most the diagonal of the bounds. It is too
        large on the middle of faces, and too small beside edges, which no smooth f can follow.
        """
        rows, shape = flat_points(points)
        slope = np.maximum(np.linalg.norm(self.gradient(rows), axis=1), _MIN_SLOPE)
        deviation = np.hypot(np.sqrt(self.variance(rows)) / slope, _LEAST * self.scale)
        limit = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))
        return np.minimum(deviation, limit).reshape(shape)

    def leave_groups_out(self, groups: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return leave-group-out predictions at each contact: f (N,) [m], gradient (N, 3).

        Contacts with one number in `groups`, (N,), are predicted from all others, with the same
        kernel, noise, prior mean and scaled coordinates.
        """
        means = self._process.leave_groups_out(groups)
        values = self.gain * self.scale * (self.mean + means[:, 0])
        return values, self._unstretched(means[:, 1:])

    def _scaled(self, points: npt.ArrayLike) -> tuple[FloatArray, tuple[int, ...]]:
        """Return points as scaled rows (P, 3), and the shape (...) of the query."""
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        return scaled if self.squeeze is None else scaled @ self.squeeze, shape

    def _unstretched(self, gradients: FloatArray) -> FloatArray:
        """Return the gradients (P, 3) of f from those in its own coordinates."""
        gradients = self.gain * gradients
        return gradients if self.squeeze is None else gradients @ self.squeeze


def _principal_squeeze(prepared: PreparedContacts) -> FloatArray:
    """Return the map (3, 3) that makes the contacts equally wide along their principal axes.

    The inverse root of the moments of the places of contacts, 1 along the widest axis.
    """
    points = prepared.contacts.points[prepared.places.nodes]
    offsets = points - points.mean(axis=0)
    moments, axes = np.linalg.eigh(offsets.T @ offsets)
    largest = moments[-1]
    if not largest > 0.0:
        return np.eye(3)
    widths = np.sqrt(np.maximum(moments / largest, _LEAST_AXIS**2))
    return np.asarray((axes / widths) @ axes.T)


def _variances(value_deviation: npt.ArrayLike, gradient_deviation: npt.ArrayLike) -> FloatArray:
    """Return the variances of a value and three slopes, shape (..., 4)."""
    return np.stack([value_deviation, *[gradient_deviation] * 3], axis=-1) ** 2
