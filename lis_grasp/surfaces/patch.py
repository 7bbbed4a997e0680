"""A smooth patch of a surface: a Gaussian process with a quadric trend.

The local shape y_i of the paper "can be any signed distance function" (Ottenhaus et al. 2016,
section III), which takes planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.kernel_expansion import (
    ROWS,
    KernelExpansion,
    cross_covariance,
    gradient_covariance,
)
from lis_grasp.surfaces.kernels import Matern52
from lis_grasp.surfaces.quadric_trend import (
    COEFFICIENTS,
    design_rows,
    prior_variances,
    value_rows,
)
from lis_grasp.typing import FloatArray, IndexArray

# Covariance of the residual, with its length in spacings.
_KERNEL = Matern52(3.0)

# Standard deviations of the residual that are tried, in spacings: from none to that of no trend.
AMPLITUDES = tuple(np.geomspace(0.003, 1.0, 5))

# Prior standard deviations of the trend: value in spacings, slope, curvature in 1/spacing. Wide for
# the first two, which two contacts determine.
_TREND = prior_variances(value=30.0, slope=2.0, curvature=0.5)

# Contacts of a patch that its hyperparameters are fitted to.
_SAMPLE = 100

# Less noise than this (in spacings and rad) makes the equations ill-conditioned.
_LEAST_NOISE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class PatchEquations:
    """The equations of one smooth patch through some contacts, before amplitude and noise.

    f = quadric + a g, with a normal prior on the quadric's coefficients and a Gaussian process g:
    regression with explicit basis functions (O'Hagan 1978; Rasmussen and Williams 2006, section
    2.7). f is 0 at contacts, and its gradient their normals. Lengths in spacings of the contacts.
    """

    nodes: FloatArray  # (N, 3), relative to their centroid
    design: FloatArray  # (4N, 10), maps the trend's coefficients to values and slopes at nodes
    trend: FloatArray  # (4N, 4N) prior covariance of the trend
    residual: FloatArray  # (4N, 4N) prior covariance of g
    targets: FloatArray  # (4N,)

    @classmethod
    def of(cls, points: FloatArray, normals: FloatArray) -> PatchEquations:
        """Prepare the equations of contacts, shapes (N, 3) in spacings and (N, 3)."""
        nodes = points - points.mean(axis=0)
        design = design_rows(nodes).reshape(-1, COEFFICIENTS)
        targets = np.hstack([np.zeros((len(nodes), 1)), normals])
        trend = (design * _TREND) @ design.T
        return cls(nodes, design, trend, gradient_covariance(_KERNEL, nodes), targets.ravel())

    def log_evidence(
        self, variances: FloatArray, amplitudes: Sequence[float] = AMPLITUDES
    ) -> float:
        """Return the logarithm of the marginal likelihood, averaged over amplitudes.

        `variances` (4N,) are those of noise, in spacings^2 and rad^2, see `noise_variances`.
        """
        logs = [self._log_likelihood(a, variances) for a in amplitudes]
        return float(np.logaddexp.reduce(logs) - np.log(len(logs)))

    def likeliest_amplitude(self, variances: FloatArray) -> float:
        """Return the amplitude of largest marginal likelihood."""
        return max(AMPLITUDES, key=lambda a: self._log_likelihood(a, variances))

    def factor(self, amplitude: float, variances: FloatArray) -> FloatArray:
        """Return the lower Cholesky factor of the covariance of targets, (4N, 4N)."""
        covariance = self.trend + amplitude**2 * self.residual
        covariance.ravel()[:: len(covariance) + 1] += variances  # the diagonal
        factor, info = dpotrf(covariance, lower=1, clean=1, overwrite_a=1)
        if info:
            raise EstimationError(
                f"the equations of {len(self.nodes)} contacts are singular: give their noise"
            )
        return np.asarray(factor)

    def _log_likelihood(self, amplitude: float, variances: FloatArray) -> float:
        factor = self.factor(amplitude, variances)
        whitened, _ = dtrtrs(factor, self.targets, lower=1)
        count = len(self.targets)
        log_determinant = 2.0 * float(np.log(np.diag(factor)).sum())
        return -0.5 * (float(whitened @ whitened) + log_determinant + count * np.log(2.0 * np.pi))


def central(points: FloatArray) -> IndexArray:
    """Return the points (N, 3) nearest to their centroid, at most 100, ascending.

    Amplitude and noise are those of the patch about them: the equations of all take too long.
    """
    if len(points) <= _SAMPLE:
        return np.arange(len(points))
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
    return np.sort(np.argsort(distances, kind="stable")[:_SAMPLE])


def noise_variances(position_noise: FloatArray, normal_noise: FloatArray) -> FloatArray:
    """Return the variances of targets of N contacts, (4N,), from their noise in spacings, rad."""
    deviations = np.column_stack([position_noise, normal_noise, normal_noise, normal_noise])
    return np.maximum(deviations, _LEAST_NOISE).ravel() ** 2


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A smooth patch: the posterior of `PatchEquations`, in metres."""

    members: IndexArray  # (M,) indices of its contacts
    spacing: float  # of the contacts [m], its unit of length
    center: FloatArray  # (3,) [m], centroid of its contacts
    amplitude: float  # standard deviation of g, in spacings
    coefficients: FloatArray  # (10,) of the trend, in spacings
    residual: KernelExpansion  # in spacings
    _design: FloatArray  # (4M, 10)
    _factor: FloatArray  # (4M, 4M)

    @classmethod
    def fit(
        cls,
        members: IndexArray,
        points: FloatArray,
        normals: FloatArray,
        spacing: float,
        variances: FloatArray,
        amplitude: float | None = None,
    ) -> Patch:
        """Condition a patch on its contacts, points (M, 3) [m] and normals (M, 3).

        `variances` (4M,) are those of `noise_variances`. The amplitude defaults to the likeliest.
        """
        equations = PatchEquations.of(points / spacing, normals)
        if amplitude is None:
            some = central(points)
            subset = PatchEquations.of(points[some] / spacing, normals[some])
            amplitude = subset.likeliest_amplitude(variances.reshape(-1, ROWS)[some].ravel())
        factor = equations.factor(amplitude, variances)
        weights, _ = dpotrs(factor, equations.targets, lower=1)
        expansion = KernelExpansion(
            _KERNEL, equations.nodes, amplitude**2 * weights.reshape(-1, ROWS)
        )
        return cls(
            members=members,
            spacing=spacing,
            center=points.mean(axis=0),
            amplitude=amplitude,
            coefficients=_TREND * (equations.design.T @ weights),
            residual=expansion,
            _design=equations.design,
            _factor=factor,
        )

    def value(self, points: FloatArray) -> FloatArray:
        """Return the patch's function at points (P, 3) [m], shape (P,) [m]."""
        scaled = (points - self.center) / self.spacing
        trend = value_rows(scaled) @ self.coefficients
        return self.spacing * (trend + self.residual.value(scaled))

    def gradient(self, points: FloatArray) -> FloatArray:
        """Return its gradient at points (P, 3) [m], shape (P, 3)."""
        scaled = (points - self.center) / self.spacing
        xx, yy, zz, xy, xz, yz = self.coefficients[4:]
        curvature = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        trend = self.coefficients[1:4] + scaled @ curvature
        return trend + self.residual.gradient(scaled)

    def variance(self, points: FloatArray) -> FloatArray:
        """Return the posterior variance at points (P, 3) [m], shape (P,) [m^2]."""
        scaled = (points - self.center) / self.spacing
        rows = value_rows(scaled)
        cross = (rows * _TREND) @ self._design.T
        cross += self.amplitude**2 * cross_covariance(_KERNEL, scaled, self.residual.nodes)
        solved = solve_triangular(self._factor, cross.T, lower=True, check_finite=False)
        prior = self.amplitude**2 + rows**2 @ _TREND
        variances = np.maximum(prior - np.einsum("np,np->p", solved, solved), 0.0)
        return np.asarray(self.spacing**2 * variances)
