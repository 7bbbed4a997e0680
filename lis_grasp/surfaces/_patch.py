"""Smooth patches of a surface: Gaussian processes with a quadric trend.

The local shape y_i of the paper "can be any signed distance function" (Ottenhaus et al. 2016,
section III), which takes planes. A quadric h + n.x + x'Qx / 2 has ten coefficients, in the order h,
n, Qxx, Qyy, Qzz, Qxy, Qxz, Qyz; it describes planes, spheres and cylinders exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrs

from lis_grasp.surfaces._gaussian_process_regression import (
    ROWS,
    KernelExpansion,
    cross_covariance,
    factorize,
    gradient_covariance,
    log_likelihood,
)
from lis_grasp.surfaces._kernels import Matern52
from lis_grasp.typing import FloatArray, IndexArray

COEFFICIENTS = 10
"""Number of coefficients."""


def prior_variances(*, value: float, slope: float, curvature: float) -> FloatArray:
    """Return the prior variances of the coefficients, (10,), from standard deviations of each kind.

    An entry off the diagonal of Q occurs twice: half its variance makes the prior the same in all
    frames.
    """
    kinds = [value**2, *[slope**2] * 3, *[curvature**2] * 3, *[0.5 * curvature**2] * 3]
    return np.array(kinds)


def value_rows(points: FloatArray) -> FloatArray:
    """Return the rows that map coefficients to values at points (P, 3), shape (P, 10)."""
    x, y, z = points.T
    squares = (0.5 * x * x, 0.5 * y * y, 0.5 * z * z)
    return np.stack([np.ones_like(x), x, y, z, *squares, x * y, x * z, y * z]).T


def about_origin(coefficients: FloatArray, center: FloatArray) -> FloatArray:
    """Return the coefficients (10,) of a quadric whose own are about a centre, (3,)."""
    xx, yy, zz, xy, xz, yz = coefficients[4:]
    slope = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ center
    value = coefficients[0] - coefficients[1:4] @ center + 0.5 * (center @ slope)
    return np.concatenate([[value], coefficients[1:4] - slope, coefficients[4:]])


def design_rows(points: FloatArray) -> FloatArray:
    """Return the matrices that map coefficients to value and gradient at points, (P, 4, 10)."""
    x, y, z = points.T
    rows = np.zeros((len(points), 4, COEFFICIENTS))
    rows[:, 0] = value_rows(points)
    rows[:, 1:, 1:4] = np.eye(3)
    rows[:, 1, 4], rows[:, 1, 7], rows[:, 1, 8] = x, y, z
    rows[:, 2, 5], rows[:, 2, 7], rows[:, 2, 9] = y, x, z
    rows[:, 3, 6], rows[:, 3, 8], rows[:, 3, 9] = z, x, y
    return rows


# Covariance of the residual, with its length in spacings.
_KERNEL = Matern52(3.0)

# Prior standard deviations of a plane and of a curved trend: value in spacings, slope, curvature in
# 1/spacing. Wide for the first two, which two contacts determine.
_PLANE = prior_variances(value=30.0, slope=2.0, curvature=0.0)
_CURVED = prior_variances(value=30.0, slope=2.0, curvature=0.5)

# Standard deviations of the residual that are tried, in spacings: from none to that of no trend.
_AMPLITUDES = tuple(np.geomspace(0.003, 1.0, 5))


class PatchPrior(NamedTuple):
    """What is assumed of a patch before its contacts."""

    trend: FloatArray  # (10,) prior variances of its coefficients
    amplitude: float  # standard deviation of g, in spacings


_PRIORS = (
    PatchPrior(_PLANE, min(_AMPLITUDES)),
    *(PatchPrior(_CURVED, amplitude) for amplitude in _AMPLITUDES),
)

# Contacts of a patch that its hyperparameters are fitted to.
_SAMPLE = 100

# Less noise than this (in spacings and rad) makes the equations ill-conditioned.
_LEAST_NOISE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class PatchContacts:
    """Contacts that are divided into patches, and what the equations of all patches share."""

    spacing: float  # of the contacts [m], the unit of length
    noise: tuple[FloatArray, FloatArray]  # (N,) of positions [m] and normals [rad]
    points: FloatArray  # (N, 3) in spacings
    normals: FloatArray  # (N, 3)
    variances: FloatArray  # (N, 4) of value and gradient, in spacings and rad
    residual: FloatArray  # (4N, 4N) prior covariance of g, see `PatchEquations`

    @classmethod
    def of(
        cls,
        points: FloatArray,
        normals: FloatArray,
        spacing: float,
        noise: tuple[FloatArray, FloatArray],
    ) -> PatchContacts:
        """Prepare contacts at points (N, 3) [m] with unit normals (N, 3)."""
        scaled = points / spacing
        residual = gradient_covariance(_KERNEL, scaled)
        return cls(spacing, noise, scaled, normals, _variances(noise, spacing), residual)

    def equations(self, members: IndexArray) -> PatchEquations:
        """Return the equations of one patch through some contacts."""
        rows = (ROWS * members[:, None] + np.arange(ROWS)).ravel()
        nodes = self.points[members]
        nodes = nodes - nodes.mean(axis=0)
        design = design_rows(nodes).reshape(-1, COEFFICIENTS)
        targets = np.zeros((len(nodes), ROWS))
        targets[:, 1:] = self.normals[members]
        return PatchEquations(
            nodes=nodes,
            design=design,
            curved=(design * _CURVED) @ design.T,
            residual=self.residual[rows[:, None], rows],
            targets=targets.ravel(),
            variances=self.variances[members].ravel(),
        )

    def central(self, members: IndexArray) -> IndexArray:
        """Return the members nearest to their centroid, at most 100, ascending.

        Amplitude and noise come from the patch around them: solving for all patches takes too long.
        """
        if len(members) <= _SAMPLE:
            return members
        points = self.points[members]
        distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
        return np.sort(members[np.argsort(distances, kind="stable")[:_SAMPLE]])


def _variances(noise: tuple[FloatArray, FloatArray], spacing: float) -> FloatArray:
    """Return the variances of targets, (N, 4), in spacings and rad."""
    positions, normals = noise
    deviations = np.column_stack([positions / spacing, normals, normals, normals])
    return np.maximum(deviations, _LEAST_NOISE) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class PatchEquations:
    """The equations of one smooth patch through some contacts, before its prior.

    f = quadric + a g, with a normal prior on the quadric's coefficients and a Gaussian process g:
    regression with explicit basis functions (O'Hagan 1978; Rasmussen and Williams 2006, section
    2.7). f is 0 at contacts, and its gradient their normals. Lengths in spacings of the contacts.
    """

    nodes: FloatArray  # (M, 3), relative to their centroid
    design: FloatArray  # (4M, 10), maps the trend's coefficients to values and slopes at nodes
    curved: FloatArray  # (4M, 4M) prior covariance of a curved trend
    residual: FloatArray  # (4M, 4M) prior covariance of g
    targets: FloatArray  # (4M,)
    variances: FloatArray  # (4M,) of the targets' noise

    def log_evidence(self) -> float:
        """Return the logarithm of the marginal likelihood, averaged over priors."""
        logs = [self._log_likelihood(prior) for prior in self._priors()]
        return float(np.logaddexp.reduce(logs) - np.log(len(logs)))

    def likeliest_prior(self) -> PatchPrior:
        """Return the prior of largest marginal likelihood."""
        return max(self._priors(), key=self._log_likelihood)

    def factor(self, prior: PatchPrior) -> FloatArray:
        """Return the lower Cholesky factor of the covariance of targets, (4M, 4M)."""
        of_plane = prior.trend is _PLANE
        trend = (self.design * _PLANE) @ self.design.T if of_plane else self.curved
        return factorize(trend + prior.amplitude**2 * self.residual, self.variances)

    def _priors(self) -> Sequence[PatchPrior]:
        """Return the priors that are compared: no plane of normals that face two ways."""
        normals = self.targets.reshape(-1, ROWS)[:, 1:]
        return _PRIORS if (normals @ normals.sum(axis=0) > 0.0).all() else _PRIORS[1:]

    def _log_likelihood(self, prior: PatchPrior) -> float:
        return log_likelihood(self.factor(prior), self.targets)


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A smooth patch: the posterior of `PatchEquations`, in metres."""

    spacing: float  # of the contacts [m], its unit of length
    center: FloatArray  # (3,) [m], centroid of its contacts
    prior: PatchPrior
    coefficients: FloatArray  # (10,) of the trend, in spacings
    residual: KernelExpansion  # in spacings
    _design: FloatArray  # (4M, 10)
    _factor: FloatArray  # (4M, 4M)

    @classmethod
    def fit(
        cls, contacts: PatchContacts, members: IndexArray, prior: PatchPrior | None = None
    ) -> Patch:
        """Condition a patch on some contacts, (M,). The prior defaults to the likeliest."""
        equations = contacts.equations(members)
        if prior is None:
            some = contacts.central(members)
            subset = equations if some is members else contacts.equations(some)
            prior = subset.likeliest_prior()
        factor = equations.factor(prior)
        weights, _ = dpotrs(factor, equations.targets, lower=1)
        expansion = KernelExpansion(
            _KERNEL, equations.nodes, prior.amplitude**2 * weights.reshape(-1, ROWS)
        )
        return cls(
            spacing=contacts.spacing,
            center=contacts.spacing * contacts.points[members].mean(axis=0),
            prior=prior,
            coefficients=prior.trend * (equations.design.T @ weights),
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
        trend, residual = self.prior.trend, self.prior.amplitude**2
        cross = (rows * trend) @ self._design.T
        cross += residual * cross_covariance(_KERNEL, scaled, self.residual.nodes)
        solved = solve_triangular(self._factor, cross.T, lower=True, check_finite=False)
        before = residual + rows**2 @ trend
        variances = np.maximum(before - np.einsum("np,np->p", solved, solved), 0.0)
        return np.asarray(self.spacing**2 * variances)


@dataclass(frozen=True, slots=True, eq=False)
class JoinedPatches:
    """The functions of K patches in one coordinate system.

    The nodes of all patches belong to one expansion; a patch's value is the sum over its own nodes.
    """

    spacing: float  # [m], the unit of length
    center: FloatArray  # (3,) [m], origin of the coordinates
    coefficients: FloatArray  # (K, 10) of the trends
    residual: KernelExpansion  # of the nodes of all patches, patch by patch
    starts: IndexArray  # (K + 1,): patch k owns the nodes starts[k]:starts[k + 1]

    @classmethod
    def of(cls, patches: Sequence[Patch]) -> JoinedPatches:
        """Join patches of the same spacing; at least one."""
        spacing, center = patches[0].spacing, patches[0].center
        offsets = [(patch.center - center) / spacing for patch in patches]
        pairs = list(zip(patches, offsets, strict=True))
        nodes = np.concatenate([patch.residual.nodes + offset for patch, offset in pairs])
        weights = np.concatenate([patch.residual.weights for patch in patches])
        counts = [len(patch.residual.nodes) for patch in patches]
        return cls(
            spacing,
            center,
            np.stack([about_origin(patch.coefficients, offset) for patch, offset in pairs]),
            KernelExpansion(patches[0].residual.kernel, nodes, weights),
            np.cumsum([0, *counts]),
        )

    def some(self, chosen: IndexArray) -> JoinedPatches:
        """Return some of the patches, (C,)."""
        if len(chosen) == len(self.coefficients):
            return self
        ranges = [np.arange(self.starts[k], self.starts[k + 1]) for k in chosen]
        rows, of_all = np.concatenate(ranges), self.residual
        residual = KernelExpansion(of_all.kernel, of_all.nodes[rows], of_all.weights[rows])
        starts = np.cumsum([0, *map(len, ranges)])
        return JoinedPatches(self.spacing, self.center, self.coefficients[chosen], residual, starts)

    def values(self, points: FloatArray) -> FloatArray:
        """Return the value of each patch (`Patch.value`) at points (P, 3) [m], (K, P) [m]."""
        scaled = (points - self.center) / self.spacing
        values = np.add.reduceat(self.residual.terms(scaled), self.starts[:-1], axis=0)
        values += self.coefficients @ value_rows(scaled).T
        values *= self.spacing
        return np.asarray(values)
