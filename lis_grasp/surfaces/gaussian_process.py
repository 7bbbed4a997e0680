"""Gaussian process implicit surfaces, told positions and normals: the smooth baseline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.contact_merging import spacing_of
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

FloatArray = npt.NDArray[np.float64]

# Length of the RBF and Matern kernels, in units of the largest distance between two contacts.
_LENGTH = 0.4

# Length of the thin plate, in diagonals of the bounds. With gradient blocks its matrix is positive
# definite only if the length exceeds the largest distance by about a third.
_THIN_PLATE_LENGTH = 1.5

# Below this the gradient says nothing about where the surface is.
_MIN_SLOPE = 0.1

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
    length); far from them it flattens to the prior mean.

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
        Factor of the prior standard deviation that makes the contacts most likely, see `variance`.
    bounds
        Shape (2, 3) [m].
    """

    points: FloatArray
    normals: FloatArray
    kernel: RadialKernel
    center: FloatArray
    scale: float
    mean: float
    amplitude: float
    bounds: FloatArray
    _nodes: FloatArray  # (N, 3) contacts, scaled
    _value_weights: FloatArray  # (N,) part of (K + noise)^-1 (targets - mean) that meets values
    _gradient_weights: FloatArray  # (N, 3) and the part that meets gradients
    _cholesky: FloatArray  # (4N, 4N) lower

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        kernel: KernelName = "rbf",
        length: float | None = None,
        position_noise: float | None = None,
        normal_noise: float = 0.1,
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
            "rbf" (eq. 6), "matern52" or "thin_plate" (eq. 2, mended).
        length
            Of the kernel [m]; None takes 0.4 of the largest distance
            between two contacts, and for the thin plate 1.5
            diagonals of the bounds (its length is above the largest distance that may occur).
        position_noise
            One standard deviation of contacts along their normals [m]; None takes 0.001 of
            the largest distance between two contacts.
        normal_noise
            One standard deviation of each component of the normals [rad]. Far less than the
            default makes spurious sheets between contacts.
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
            If the equations are singular to working precision.
        """
        require_contacts(contacts)
        require_choice("kernel", kernel, get_args(KernelName))
        spacing = spacing_of(contacts)
        scale = float(pdist(contacts.points).max(initial=0.0)) or spacing
        margin = spacing if margin is None else require_range("margin", margin, 0.0, unit="m")
        bounds = contacts.bounds + margin * np.array([[-1.0], [1.0]])
        if length is None:
            diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
            length = _THIN_PLATE_LENGTH * diagonal if kernel == "thin_plate" else _LENGTH * scale
        require_range("length", length, 0.0, unit="m", low_included=False)
        position_noise = 1e-3 * scale if position_noise is None else position_noise
        require_range("position_noise", position_noise, 0.0, unit="m")
        require_range("normal_noise", normal_noise, 0.0, unit="rad")
        prior_mean = scale if prior_mean is None else prior_mean
        require_range("prior_mean", prior_mean, 0.0, unit="m", low_included=False)

        center = contacts.bounds.mean(axis=0)
        nodes = (contacts.points - center) / scale
        covariance = _radial_kernel(kernel, length / scale)
        cholesky = _factorize(covariance, nodes, position_noise / scale, normal_noise)
        residuals = np.concatenate(
            [np.full(len(nodes), -prior_mean / scale), contacts.normals.T.reshape(-1)]
        )
        weights = cho_solve((cholesky, True), residuals)
        return cls(
            points=contacts.points,
            normals=contacts.normals,
            kernel=covariance,
            center=center,
            scale=scale,
            mean=prior_mean / scale,
            amplitude=float(np.sqrt(residuals @ weights / len(residuals))),
            bounds=bounds,
            _nodes=nodes,
            _value_weights=weights[: len(nodes)],
            _gradient_weights=weights[len(nodes) :].reshape(3, -1).T,
            _cholesky=cholesky,
        )

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior mean of f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        values = map_rows(self._mean_at, scaled, max(1, _CHUNK // len(self._nodes)))
        return self.scale * values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        gradients = map_rows(self._gradient_at, scaled, max(1, _CHUNK // len(self._nodes)))
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The posterior standard deviation of f over the length of its gradient: to first order, how
        far the zero moves. Capped by the diagonal of the bounds.
        """
        rows, shape = flat_points(points)
        deviation = np.sqrt(self.variance(rows))
        slope = np.maximum(np.linalg.norm(self.gradient(rows), axis=1), _MIN_SLOPE)
        limit = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))
        return np.minimum(deviation / slope, limit).reshape(shape)

    def variance(self, points: npt.ArrayLike) -> FloatArray:
        """Return the posterior variance of f, shape (...) [m^2].

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26), times the
        amplitude that makes the contacts most likely, residuals^T (K + noise)^-1 residuals / 4N
        (their eq. 5.8 solved for a common factor), which the mean does not depend on.
        """
        rows, shape = flat_points(points)
        scaled = (rows - self.center) / self.scale
        variances = map_rows(self._variance_at, scaled, max(1, _CHUNK // len(self._cholesky)))
        return (self.amplitude * self.scale) ** 2 * variances.reshape(shape)

    def _mean_at(self, queries: FloatArray) -> FloatArray:
        r = _distances(queries, self._nodes)  # (P, N)
        slopes = queries @ self._gradient_weights.T  # (P, N): d . gamma
        slopes -= np.einsum("nk,nk->n", self._nodes, self._gradient_weights)
        values = self.kernel.value(r) @ self._value_weights
        return self.mean + values + np.einsum("pn,pn->p", self.kernel.first(r), slopes)

    def _gradient_at(self, queries: FloatArray) -> FloatArray:
        # A sum over contacts of factors times d = x - x_i is x sum(factors) - factors @ x_i.
        r = _distances(queries, self._nodes)
        slopes = queries @ self._gradient_weights.T
        slopes -= np.einsum("nk,nk->n", self._nodes, self._gradient_weights)
        first = self.kernel.first(r)
        factors = first * self._value_weights + self.kernel.second(r) * slopes  # (P, N)
        pulls = queries * factors.sum(axis=1)[:, None] - factors @ self._nodes
        return first @ self._gradient_weights - pulls

    def _variance_at(self, queries: FloatArray) -> FloatArray:
        cross = _cross_covariance(self.kernel, queries, self._nodes)  # (P, 4N)
        solved = solve_triangular(self._cholesky, cross.T, lower=True)
        prior = self.kernel.value(np.zeros(1))[0]
        return np.clip(prior - np.einsum("np,np->p", solved, solved), 0.0, prior)


def _radial_kernel(name: KernelName, length: float) -> RadialKernel:
    kinds: dict[str, type[SquaredExponential] | type[Matern52] | type[ThinPlate]] = {
        "rbf": SquaredExponential,
        "matern52": Matern52,
        "thin_plate": ThinPlate,
    }
    return kinds[name](length)


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return distances between rows, shape (P, N)."""
    squares = np.sum(first**2, axis=1)[:, None] + np.sum(second**2, axis=1) - 2.0 * first @ second.T
    return np.sqrt(np.maximum(squares, 0.0))


def _cross_covariance(kernel: RadialKernel, queries: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return the covariance of f at queries with all values, then all x, y, z slopes: (P, 4N)."""
    r = _distances(queries, nodes)
    first = kernel.first(r)
    blocks = [kernel.value(r)]
    blocks += [first * (queries[:, k, None] - nodes[:, k]) for k in range(3)]
    return np.concatenate(blocks, axis=1)


def _covariance(kernel: RadialKernel, nodes: FloatArray) -> FloatArray:
    """Return the covariance of all values, then all x, y, z slopes, with each other: (4N, 4N)."""
    count = len(nodes)
    offsets = nodes[:, None, :] - nodes  # (N, N, 3)
    r = np.linalg.norm(offsets, axis=2)
    value, first, second = kernel.value(r), kernel.first(r), kernel.second(r)
    matrix = np.empty((4 * count, 4 * count))
    blocks = matrix.reshape(4, count, 4, count)
    blocks[0, :, 0, :] = value
    for a in range(3):
        blocks[0, :, a + 1, :] = first * offsets[:, :, a]
        blocks[a + 1, :, 0, :] = -first * offsets[:, :, a]
        for b in range(3):
            blocks[a + 1, :, b + 1, :] = (a == b) * first - second * offsets[:, :, a] * offsets[
                :, :, b
            ]
    return matrix


def _factorize(
    kernel: RadialKernel, nodes: FloatArray, value_noise: float, gradient_noise: float
) -> FloatArray:
    """Return the lower Cholesky factor of K + noise, with noise on every diagonal entry."""
    matrix = _covariance(kernel, nodes)
    noise = np.repeat([value_noise**2, gradient_noise**2], [len(nodes), 3 * len(nodes)])
    matrix[np.diag_indices_from(matrix)] += noise
    try:
        factor, _ = cho_factor(matrix, lower=True, overwrite_a=True)
    except LinAlgError as error:
        raise EstimationError(
            f"the Gaussian process' equations are singular ({error}): raise position_noise or"
            " normal_noise, or remove contacts at the same place"
        ) from None
    return np.tril(factor)
