"""Gaussian process implicit surfaces, told positions and normals: the smooth baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.contact_merging import merge_duplicates, resolution_of, spacing_of
from lis_grasp.surfaces.gaussian_process_regression import ROWS, GradientRegression
from lis_grasp.surfaces.gaussian_process_selection import (
    DEFAULT_LENGTHS,
    LENGTH_FACTORS,
    Criterion,
    choose_length,
    fit_with_noise,
)
from lis_grasp.surfaces.kernels import (
    KernelName,
    Matern52,
    RadialKernel,
    SquaredExponential,
    ThinPlate,
)
from lis_grasp.surfaces.queries import (
    flat_points,
    map_rows,
    require_choice,
    require_contacts,
    require_range,
)
from lis_grasp.typing import FloatArray

_KERNELS: dict[KernelName, type[SquaredExponential] | type[Matern52] | type[ThinPlate]] = {
    "rbf": SquaredExponential,
    "matern52": Matern52,
    "thin_plate": ThinPlate,
}

# Below this the gradient says nothing about where the surface is.
_MIN_SLOPE = 0.1
# The matrices of this many take 5 GB, and a minute.
_MOST_CONTACTS = 3000

# Numbers held at once by an evaluation: (queries) x (contacts or equations).
_CHUNK = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class GaussianProcessImplicitSurface:
    """The posterior mean of a Gaussian process that is 0 with the normal as gradient at contacts.

    f(x) = mean + k_*^T (K + noise)^-1 (targets - mean)                                   (eq. 3)

    with value and gradient blocks in K, 4N x 4N (Williams and Fitzgibbon 2007; Rasmussen and
    Williams 2006, section 9.4; Ottenhaus et al. 2016, section II.B). The prior mean is positive:
    far from every contact is outside. Coordinates are centred on the contacts and scaled to about
    unit size; everything private is in that unit.

    Made by `from_contacts`. Near contacts f is about metric [m] (its gradient is told to have unit
    length); far from them it flattens to the prior mean, but for the thin plate, which goes on
    rising.

    Parameters
    ----------
    points
        Shape (N, 3) [m], contacts in O.
    normals
        Shape (N, 3), unit, outward.
    kernel
        Covariance, in scaled coordinates.
    center
        Shape (3,) [m], origin of the scaled coordinates.
    scale
        Their unit [m]: the largest distance between two contacts.
    mean
        Prior mean, scaled.
    amplitude
        Standard deviation of the prior, scaled, see `variance`.
    margin
        By how much bounds exceed the contacts' box [m].
    """

    points: FloatArray
    normals: FloatArray
    kernel: RadialKernel
    center: FloatArray
    scale: float
    mean: float
    amplitude: float
    margin: float
    _process: GradientRegression

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        kernel: KernelName = "matern52",
        length: float | Criterion | None = None,
        position_noise: float = 0.0,
        normal_noise: float = 0.0,
        misfit: tuple[float, float] = (0.001, 0.1),
        prior_mean: float | None = None,
        margin: float | None = None,
    ) -> GaussianProcessImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Time grows with the cube of the number of contacts, memory with its square.

        Parameters
        ----------
        contacts
            Where the object was touched.
        kernel
            "matern52", "rbf" (eq. 6) or "thin_plate" (eq. 2, mended).
        length
            Of the kernel [m]. None takes 0.8 (Matern) or 0.4 (RBF) of the largest distance between
            two contacts, or for the thin plate 1.5 diagonals of the bounds (its length is above
            the largest distance that may occur). "likelihood" and "leave_one_out" choose it by
            these contacts, see `choose_length`.
        position_noise
            One standard deviation of the sensor's positions along the normals [m].
        normal_noise
            One standard deviation of each component of the sensor's normals [rad].
        misfit
            Noise of positions and of normals added to the sensor's for what no smooth f can
            follow, in units of the prior's standard deviation (scaled, and so in radians for the
            normals). Far less than the default makes spurious sheets between contacts.
        prior_mean
            f where nothing is known [m], above 0; None takes the largest distance
            between two contacts.
        margin
            By how much bounds exceed the contacts' box [m]; None takes one spacing.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range or set.
        EstimationError
            If the equations are singular to working precision, or there are more contacts than a
            machine has memory for.
        """
        require_contacts(contacts)
        _require_few(len(contacts))
        require_choice("kernel", kernel, get_args(KernelName))
        spacing = spacing_of(contacts)
        largest = float(pdist(contacts.points).max(initial=0.0))
        scale = largest if largest > resolution_of(contacts) else spacing
        margin = spacing if margin is None else require_range("margin", margin, 0.0, unit="m")
        require_range("position_noise", position_noise, 0.0, unit="m")
        require_range("normal_noise", normal_noise, 0.0, unit="rad")
        for part in misfit:
            require_range("misfit", part, 0.0)
        prior_mean = scale if prior_mean is None else prior_mean
        require_range("prior_mean", prior_mean, 0.0, unit="m", low_included=False)

        center = contacts.bounds.mean(axis=0)

        def fit(scaled_length: float, some: Contacts = contacts) -> GradientRegression:
            return fit_with_noise(
                _KERNELS[kernel](scaled_length),
                *_scaled(some, center, scale, prior_mean / scale),
                sensor_noise=_variances(position_noise / scale, normal_noise),
                misfit=_variances(*misfit),
            )

        if length is None or isinstance(length, str):
            sides = np.ptp(contacts.points, axis=0) + 2.0 * margin
            unit = np.linalg.norm(sides) / scale if kernel == "thin_plate" else 1.0
            scaled_length = float(DEFAULT_LENGTHS[kernel] * unit)
            if isinstance(length, str):
                require_choice("length", length, get_args(Criterion))
                scaled_length = choose_length(fit, length, scaled_length, LENGTH_FACTORS[kernel])
        else:
            require_range("length", length, 0.0, unit="m", low_included=False)
            scaled_length = length / scale
        process = fit(scaled_length)
        # Touches of one place foretell each other, whatever the others do.
        places = merge_duplicates(contacts)
        judged = process if len(places) == len(contacts) else fit(scaled_length, places)
        return cls(
            points=contacts.points,
            normals=contacts.normals,
            kernel=process.kernel,
            center=center,
            scale=scale,
            mean=prior_mean / scale,
            amplitude=judged.leave_one_out_amplitude(),
            margin=margin,
            _process=process,
        )

    def with_contacts(self, new: Contacts) -> GaussianProcessImplicitSurface:
        """Return the estimate from the new contacts too, with all options as they were chosen.

        Kernel, noise, prior mean, amplitude and scaled coordinates stay; time grows with the square
        of the number of contacts, for each new one. When the object has turned out to be far larger
        than what was touched at first, estimate anew.

        Raises
        ------
        EstimationError
            If the equations become singular: a new contact at the place of another, without
            misfit, or farther from the others than a thin plate's length allows.
        """
        _require_few(len(self.points) + len(new))
        process = self._process.extended(*_scaled(new, self.center, self.scale, self.mean))
        return replace(
            self,
            points=np.vstack([self.points, new.points]),
            normals=np.vstack([self.normals, new.normals]),
            _process=process,
        )

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m]."""
        corners = np.array([self.points.min(axis=0), self.points.max(axis=0)])
        return corners + self.margin * np.array([[-1.0], [1.0]])

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior mean of f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        values = map_rows(self._process.mean, scaled, max(1, _CHUNK // len(self.points)))
        return self.scale * (self.mean + values).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        count = max(1, _CHUNK // len(self.points))
        gradients = map_rows(self._process.mean_gradient, scaled, count)
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of f over the length of its gradient: to first order, how
        far the zero moves. Capped by the diagonal of the bounds. Over the objects of
        `shapes` as a whole the truth lies within one deviation about as often as it should, on
        the middle of faces more often, beside edges, which no smooth f can follow, less.
        """
        rows, shape = flat_points(points)
        deviation = np.sqrt(self.variance(rows))
        slope = np.maximum(np.linalg.norm(self.gradient(rows), axis=1), _MIN_SLOPE)
        limit = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))
        return np.minimum(deviation / slope, limit).reshape(shape)

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return what all other contacts foretell at each contact: f (N,) [m], gradient (N, 3).

        That of the process refitted without the contact, with all else as it is: kernel, noise,
        prior mean, center and scale (closed form, see `GradientRegression.leave_one_out`).
        """
        means, _ = self._process.leave_one_out()
        return self.scale * (self.mean + means[:, 0]), means[:, 1:]

    def leave_groups_out(self, groups: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return what all other groups foretell at each contact: f (N,) [m], gradient (N, 3).

        As `leave_one_out`, for contacts left out together: those of one number in `groups`, (N,).
        """
        means = self._process.leave_groups_out(groups)
        return self.scale * (self.mean + means[:, 0]), means[:, 1:]

    def log_marginal_likelihood(self) -> float:
        """Return the logarithm of how likely the contacts are (in scaled units).

        Rasmussen and Williams 2006, eq. 5.8, at the amplitude that maximises it. Comparable between
        options with the same contacts.
        """
        return self._process.log_marginal_likelihood()

    def leave_one_out_log_density(self) -> float:
        """Return the sum of the log densities of each contact, foretold by all others.

        Rasmussen and Williams 2006, eq. 5.11, in scaled units, at the amplitude that maximises it.
        Comparable between options with the same contacts.
        """
        return self._process.leave_one_out_log_density()

    def variance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior variance of f, shape (...) [m^2].

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26), times the
        amplitude's square: that of the prior, chosen so that contacts are as far from what all
        others foretell as they should be (`GradientRegression.leave_one_out_amplitude`).
        """
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        count = max(1, _CHUNK // (ROWS * len(self.points)))
        variances = map_rows(self._process.variance, scaled, count)
        return (self.amplitude * self.scale) ** 2 * variances.reshape(shape)


def _require_few(count: int) -> None:
    if count > _MOST_CONTACTS:
        raise EstimationError(
            f"a Gaussian process takes at most {_MOST_CONTACTS} contacts, for its memory; {count}"
            " came: estimate with 'blend', 'patch' or 'lis', or from fewer contacts"
        )


def _scaled(
    contacts: Contacts, center: FloatArray, scale: float, mean: float
) -> tuple[FloatArray, FloatArray]:
    """Return contacts in scaled coordinates, (N, 3), and what is told there: f - mean, grad f."""
    values = np.full((len(contacts), 1), -mean)
    return (contacts.points - center) / scale, np.hstack([values, contacts.normals])


def _variances(value_deviation: float, gradient_deviation: float) -> FloatArray:
    return np.array([value_deviation, *[gradient_deviation] * 3]) ** 2
