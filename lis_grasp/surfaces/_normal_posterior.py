"""Posterior of unit normals at surface points, under a Gaussian process prior of the surface.

The signed function f is a Gaussian process with a positive mean (far away is outside) and the thin
plate covariance of Williams and Fitzgibbon (2007). Given f = 0 at the points, the prior density of
the unit normals n, taken as gradients of f, is

    p(n) ~ (E / 2N)^-N,    E = t^T K^-1 t,    t_i = (-mean, n_i),

for the most likely amplitude (E / 2N)^(1/2) once the normals are integrated over. K has value and
gradient blocks, as in `GradientRegression`. The smoothest closed function through the points with
unit gradients is the maximum: the idea of Huang, Carr and Ju (2019, Variational implicit point set
surfaces), with evidence about the sides of the surface added as likelihoods. A Laplace
approximation at the maximum gives the standard deviations of the normals.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from scipy.special import log_ndtr

from lis_grasp.geometry import tangent_frame
from lis_grasp.surfaces._gaussian_process_regression import (
    ROWS,
    GradientRegression,
    cross_covariance,
)
from lis_grasp.surfaces._kernels import ThinPlate
from lis_grasp.typing import FloatArray

# Length of the thin plate and prior mean, in largest distances between two points.
_LENGTH, _MEAN = 1.6, 1.0

# Variance of normals about the gradients of a smooth function: edges are not smooth.
_MISFIT = 0.04

_ITERATIONS = 300


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedNormals:
    """Normals at a maximum of the posterior."""

    normals: FloatArray  # (N, 3) unit
    deviations: FloatArray  # (N,) [rad], of each component across the normal
    log_evidence: float  # of the points and all other evidence, for this maximum


@dataclass(frozen=True, slots=True, eq=False)
class NormalPosterior:
    """Density of the normals at N points, to be maximised. Made by `condition`."""

    quadratic: FloatArray  # (3N, 3N): E = n^T quadratic n + 2 linear . n + constant
    linear: FloatArray  # (3N,)
    constant: float
    log_determinant: float  # of K
    inward: FloatArray  # (N, 3), mean direction of the inward normal times its concentration
    free_slopes: FloatArray  # (M, 3N): f at free points = free_slopes n + free_values
    free_values: FloatArray  # (M,)
    free_deviations: FloatArray  # (M,) of f there, for amplitude 1

    @classmethod
    def condition(
        cls,
        points: FloatArray,
        noise: FloatArray,
        inward: FloatArray,
        free_points: FloatArray,
    ) -> NormalPosterior:
        """Condition the process on points (N, 3) about 1 in extent.

        `noise` (N,) are the standard deviations of f at the points for amplitude 1. `inward` (N, 3)
        are the parameters of a von Mises-Fisher distribution of each inward normal, 0 if unknown.
        """
        count = len(points)
        variances = np.column_stack([noise**2, np.full((count, ROWS - 1), _MISFIT)])
        targets = np.zeros((count, ROWS))
        process = GradientRegression.fit(ThinPlate(_LENGTH), points, targets, variances)
        inverse = cho_solve((process.cholesky, True), np.eye(ROWS * count), check_finite=False)
        blocks = inverse.reshape(count, ROWS, count, ROWS)
        quadratic = blocks[:, 1:, :, 1:].reshape(3 * count, 3 * count)
        linear = -_MEAN * blocks[:, 1:, :, 0].sum(axis=2).reshape(-1)
        # f at a free point is linear in the targets: the mean of each unit target.
        maps = cross_covariance(process.kernel, free_points, points) @ inverse  # (M, 4N)
        maps = maps.reshape(len(free_points), count, ROWS)
        return cls(
            quadratic=quadratic,
            linear=linear,
            constant=float(_MEAN**2 * blocks[:, 0, :, 0].sum()),
            log_determinant=float(2.0 * np.log(process.cholesky.diagonal()).sum()),
            inward=inward,
            free_slopes=maps[:, :, 1:].reshape(len(free_points), 3 * count),
            free_values=_MEAN * (1.0 - maps[:, :, 0].sum(axis=1)),
            free_deviations=np.sqrt(np.maximum(process.variance(free_points), 1e-12)),
        )

    def maxima(self, starts: Iterable[FloatArray]) -> list[EstimatedNormals]:
        """Return the maxima that are reached from starts, each (N, 3); the likeliest first."""
        found = [self._approximate(self._climb(start)) for start in starts]
        return sorted(found, key=lambda each: -each.log_evidence)

    def relaxed(self) -> FloatArray:
        """Return the posterior mean of the gradients given f = 0 alone, made unit, (N, 3)."""
        gradients: FloatArray = -np.asarray(
            np.linalg.solve(self.quadratic, self.linear), np.float64
        )
        return _unit(gradients.reshape(-1, 3))

    def _climb(self, start: FloatArray) -> FloatArray:
        """Return normals at a local maximum of the density."""

        def objective(stretched: FloatArray) -> tuple[float, FloatArray]:
            vectors = stretched.reshape(-1, 3)
            lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
            normals = vectors / lengths
            value, gradient = self._negative_log_density(normals)
            across = gradient - np.sum(gradient * normals, axis=1, keepdims=True) * normals
            # The length has no meaning: a weak pull keeps it at 1.
            pull = lengths - 1.0
            return (
                value + 0.5 * float(np.sum(pull**2)),
                (across / lengths + pull * normals).ravel(),
            )

        options = {"maxiter": _ITERATIONS, "maxcor": 20}
        done = minimize(
            objective, _unit(start).ravel(), jac=True, method="L-BFGS-B", options=options
        )
        return _unit(done.x.reshape(-1, 3))

    def _negative_log_density(self, normals: FloatArray) -> tuple[float, FloatArray]:
        count = len(normals)
        flat = normals.ravel()
        half_slope = self.quadratic @ flat + self.linear
        energy = float(flat @ (half_slope + self.linear)) + self.constant
        value = count * np.log(energy)
        gradient = (2.0 * count / energy) * half_slope
        value += np.sum(normals * self.inward)
        gradient = gradient + self.inward.ravel()
        if len(self.free_values):
            scale = np.sqrt(energy / (2.0 * count)) * self.free_deviations
            scores = (self.free_slopes @ flat + self.free_values) / scale  # (M,)
            logs = log_ndtr(scores)
            rates = np.exp(-0.5 * scores**2 - logs) / np.sqrt(2.0 * np.pi)
            value -= np.sum(logs)
            gradient -= (rates / scale) @ self.free_slopes
            gradient += np.sum(rates * scores) / energy * half_slope
        return float(value), gradient.reshape(-1, 3)

    def _approximate(self, normals: FloatArray) -> EstimatedNormals:
        """Return the Laplace approximation at a maximum: deviations and evidence."""
        count = len(normals)
        flat = normals.ravel()
        half_slope = self.quadratic @ flat + self.linear
        variance = (float(flat @ (half_slope + self.linear)) + self.constant) / (2.0 * count)
        frames = tangent_frame(normals)  # (N, 2, 3)
        blocks = self.quadratic.reshape(count, 3, count, 3)
        hessian = np.einsum("ika,iajb->ikjb", frames, blocks, optimize=True)
        hessian = np.einsum("ikjb,jlb->ikjl", hessian, frames, optimize=True) / variance
        hessian = hessian.reshape(2 * count, 2 * count)
        # Curvature of the sphere of unit normals times the slope along the normal.
        slopes = half_slope.reshape(-1, 3) / variance + self.inward
        hessian[np.diag_indices_from(hessian)] -= np.repeat(np.sum(slopes * normals, axis=1), 2)
        values, vectors = np.linalg.eigh(hessian)
        values = np.maximum(values, 1.0)  # a component of a unit vector scatters by 1 at most
        variances = np.sum(vectors**2 / values, axis=1).reshape(-1, 2).mean(axis=1)
        value, _ = self._negative_log_density(normals)
        evidence = -value - count * np.log(variance) - 0.5 * np.sum(np.log(values))
        return EstimatedNormals(
            normals=normals,
            deviations=np.sqrt(variances),
            log_evidence=float(evidence - 0.5 * self.log_determinant),
        )


def _unit(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(lengths > 1e-12, vectors / np.maximum(lengths, 1e-300), [0, 0, 1]))
