"""Local quadrics: a second-order surface fitted to each contact and its neighbours.

The local shape y_i of the paper "can be any signed distance function" (Ottenhaus et al. 2016,
section III), which takes planes. A quadric is exact for planes, spheres and cylinders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.typing import FloatArray, IndexArray

# Prior standard deviation of curvature, in 1/spacing.
_CURVATURE = 2.0

# Departure of a surface from its quadric at one spacing, in spacings; it grows with the third power
# of distance, and that of the normal, three times as large, with the second.
_THIRD_ORDER = 0.01

# Less noise than this (in spacings and rad) makes the equations ill-conditioned.
_LEAST_NOISE = 1e-4

# The quadric's gradient is 0 at its centre or axis, where a distance is undefined.
_MIN_SLOPE = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class LocalQuadrics:
    """y_i(x) = (h + n.d + d'Qd / 2) / |n + Qd|, d = x - c_i.

    A distance to first order (Taubin 1991).
    """

    points: FloatArray  # (N, 3) [m], c_i
    heights: FloatArray  # (N,) [m], h, the value at the contact: its estimated noise
    normals: FloatArray  # (N, 3) n
    curvatures: FloatArray  # (N, 3, 3) [1/m], Q, symmetric
    # (N, 10, 10) of h, n, Qxx, Qyy, Qzz, Qxy, Qxz, Qyz, lengths in spacings
    covariances: FloatArray
    spacing: float  # of the contacts [m]

    @classmethod
    def fit(
        cls,
        points: FloatArray,
        normals: FloatArray,
        pairs: tuple[IndexArray, IndexArray],
        spacing: float,
        *,
        position_noise: float,
        normal_noise: float,
    ) -> LocalQuadrics:
        """Fit each contact's quadric to itself and its neighbours, at maximum posterior.

        Bayesian linear regression with a normal prior on h, n (the contact's own measurement) and Q
        (flat). Each neighbour is an observation that the quadric is 0 there with the neighbour's
        normal, with the variance of noise and of third-order terms. `pairs` are contacts i and
        their neighbours j, each of shape (P,), both directions; noise is [m] and [rad].
        """
        owners, others = pairs
        position_variance = max(position_noise / spacing, _LEAST_NOISE) ** 2
        normal_variance = max(normal_noise, _LEAST_NOISE) ** 2
        # An entry off the diagonal of Q occurs twice: this makes the prior the same in all frames.
        twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
        flat = twice / _CURVATURE**2
        prior = np.diag([1.0 / position_variance, *[1.0 / normal_variance] * 3, *flat])
        offsets = (points[others] - points[owners]) / spacing  # (P, 3), in spacings
        designs = _designs(offsets)  # (P, 4, 10)
        gaps = np.empty((len(owners), 4))
        gaps[:, 0] = -np.einsum("pk,pk->p", offsets, normals[owners])
        gaps[:, 1:] = normals[others] - normals[owners]
        squares = np.sum(offsets**2, axis=1)
        precisions = np.empty((len(owners), 4))
        precisions[:, 0] = 1.0 / (position_variance + _THIRD_ORDER**2 * squares**3)
        slopes = (3.0 * _THIRD_ORDER * squares) ** 2
        precisions[:, 1:] = (1.0 / (normal_variance + slopes))[:, None]

        weighted = np.swapaxes(designs * precisions[:, :, None], 1, 2)  # (P, 10, 4)
        matrices = np.tile(prior, (len(points), 1, 1))
        sides = np.zeros((len(points), 10))
        if len(owners):
            order = np.argsort(owners, kind="stable")
            whose, starts = np.unique(owners[order], return_index=True)
            matrices[whose] += np.add.reduceat((weighted @ designs)[order], starts, axis=0)
            weighted_gaps = (weighted @ gaps[:, :, None])[order, :, 0]
            sides[whose] = np.add.reduceat(weighted_gaps, starts, axis=0)
        covariances = np.linalg.inv(matrices)
        solutions = np.einsum("iab,ib->ia", covariances, sides)
        xx, yy, zz, xy, xz, yz = solutions[:, 4:].T / spacing
        fitted = normals + solutions[:, 1:4]
        scale = np.linalg.norm(fitted, axis=1)
        curvatures = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
        return cls(
            points=points,
            heights=solutions[:, 0] * spacing / scale,
            normals=fitted / scale[:, None],
            curvatures=curvatures / scale[:, None, None],
            covariances=covariances,
            spacing=spacing,
        )

    def evaluate(
        self, i: int, points: FloatArray, *, with_gradient: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return y_i at points, shape (R, 3) [m], and its gradient: (R,) [m] and (R, 3)."""
        offsets = points - self.points[i]
        bent = offsets @ self.curvatures[i]  # Q d
        values = self.heights[i] + offsets @ self.normals[i]
        values += 0.5 * np.einsum("rk,rk->r", offsets, bent)
        gradients = self.normals[i] + bent
        lengths = np.sqrt(np.einsum("rk,rk->r", gradients, gradients))
        slopes = np.maximum(lengths, _MIN_SLOPE)
        values /= slopes
        if not with_gradient:
            return values, gradients
        gradients /= slopes[:, None]
        # d |g| / dx = Q g / |g|, except at the floor of |g|.
        turned = gradients @ self.curvatures[i]
        turned *= (values * (lengths > _MIN_SLOPE) / slopes)[:, None]
        return values, gradients - turned

    def values(self, contacts: IndexArray, points: FloatArray) -> FloatArray:
        """Return y_i at points, shape (Q, 3) [m], each with a contact i of its own, shape (Q,)."""
        offsets = points - self.points[contacts]
        bent = np.einsum("qkl,ql->qk", self.curvatures[contacts], offsets)
        normals = self.normals[contacts]
        values = self.heights[contacts] + np.einsum("qk,qk->q", offsets, normals + 0.5 * bent)
        return values / np.maximum(np.linalg.norm(normals + bent, axis=1), _MIN_SLOPE)

    def variance(self, i: int, points: FloatArray) -> FloatArray:
        """Return the variance of quadric i at points, shape (R, 3) [m]; shape (R,) [m^2].

        That of the fitted coefficients, and of terms of third order, which a quadric leaves out.
        """
        offsets = (points - self.points[i]) / self.spacing
        rows = _value_rows(offsets)
        variances = np.einsum("ra,ra->r", rows @ self.covariances[i], rows)
        variances += _THIRD_ORDER**2 * np.sum(offsets**2, axis=1) ** 3
        return self.spacing**2 * variances


def _value_rows(offsets: FloatArray) -> FloatArray:
    """Return the rows that map h, n, Qxx, Qyy, Qzz, Qxy, Qxz, Qyz to the value, shape (P, 10)."""
    x, y, z = offsets.T
    squares = (0.5 * x * x, 0.5 * y * y, 0.5 * z * z)
    return np.stack([np.ones_like(x), x, y, z, *squares, x * y, x * z, y * z], axis=1)


def _designs(offsets: FloatArray) -> FloatArray:
    """Return the matrices that map them to value and gradient, shape (P, 4, 10)."""
    x, y, z = offsets.T
    rows = np.zeros((len(offsets), 4, 10))
    rows[:, 0] = _value_rows(offsets)
    rows[:, 1:, 1:4] = np.eye(3)
    rows[:, 1, 4], rows[:, 1, 7], rows[:, 1, 8] = x, y, z
    rows[:, 2, 5], rows[:, 2, 7], rows[:, 2, 9] = y, x, z
    rows[:, 3, 6], rows[:, 3, 8], rows[:, 3, 9] = z, x, y
    return rows
