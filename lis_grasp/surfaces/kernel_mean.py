"""Means weighted by a Gaussian kernel: who counts at a point, and how much."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray, IndexArray

# Terms below exp(-30) = 1e-13 of the largest one cannot be seen in a sum and are left out.
NEGLIGIBLE = 30.0
LEAST_SHARE = np.exp(-NEGLIGIBLE)

LocalFunction = Callable[[int, IndexArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, eq=False)
class KernelMean:
    """Shares s_i(x) = w_i k(x, c_i) / sum_j w_j k(x, c_j) of nodes c_i, at any distance from them.

    Parameters
    ----------
    nodes
        Shape (N, 3) [m].
    sigma
        Width of the kernel [m] (Ottenhaus et al. 2016, eq. 6).
    log_weights
        Shape (N,), log w_i.
    """

    nodes: FloatArray
    sigma: float
    log_weights: FloatArray
    _tree: cKDTree

    @classmethod
    def of(cls, nodes: FloatArray, sigma: float, weights: FloatArray | None = None) -> KernelMean:
        """Prepare the mean over nodes, shape (N, 3) [m]; weights default to 1."""
        log_weights = np.zeros(len(nodes)) if weights is None else np.log(weights)
        return cls(nodes, sigma, log_weights, cKDTree(nodes))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance from points, shape (P, 3), to their nearest node, shape (P,) [m]."""
        return self._tree.query(points)[0]

    def shares(self, points: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Return the nodes that count at some of the points, and the shares of each.

        Parameters
        ----------
        points
            Shape (P, 3) [m], close together, or else all nodes are looked at.

        Returns
        -------
        nodes
            Shape (M,), ascending.
        shares
            Shape (M, P), each column adds to 1.
        """
        near = self._near(points)
        origin = points[0]
        nodes, points = self.nodes[near] - origin, points - origin
        exponents = nodes @ points.T  # (M, P): of eq. 6, but for a term that is common to all i
        exponents -= 0.5 * np.sum(nodes**2, axis=1)[:, None]
        exponents /= self.sigma**2
        exponents += self.log_weights[near][:, None]
        exponents -= exponents.max(axis=0)
        np.exp(exponents, out=exponents)
        exponents /= exponents.sum(axis=0)
        return near, exponents

    def _near(self, points: FloatArray) -> IndexArray:
        """Return the nodes whose kernel can be seen at some of the points, beside the nearest's.

        At a distance d from its nearest node a point sees those up to sqrt(d^2 + reach^2).
        """
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
        radius = np.linalg.norm(points - center, axis=1).max()
        nearest = self._tree.query(center)[0] + radius
        spread = np.ptp(self.log_weights)
        reach = self.sigma * np.sqrt(2.0 * (NEGLIGIBLE + spread))
        far = radius + np.hypot(nearest, reach)
        near = self._tree.query_ball_point(center, far * (1.0 + 1e-9), return_sorted=True)
        return np.asarray(near, dtype=np.intp)

    def superpose(
        self,
        points: FloatArray,
        near: IndexArray,
        shares: FloatArray,
        local: LocalFunction,
        *,
        with_gradient: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the mean of the nodes' functions at points, shape (P,), and its gradient, (P, 3).

        Parameters
        ----------
        points
            Shape (P, 3) [m].
        near, shares
            As returned by `shares`.
        local
            Given a node and which of the points it is asked at, shape (R,), returns its function
            there, shape (R,), and the gradient, shape (R, 3).
        with_gradient
            Whether gradients are wanted; if not, they are neither read nor meaningful.
        """
        values = np.zeros(len(points))
        gradients, pulls = np.zeros((len(points), 3)), np.zeros((len(points), 3))
        for node, share in zip(near, shares, strict=True):
            seen = np.flatnonzero(share > LEAST_SHARE)
            if not len(seen):
                continue
            share = share[seen]
            value, gradient = local(node, seen)
            values[seen] += share * value
            if with_gradient:
                # Shares move too: grad s_i = s_i (a_i - sum_j s_j a_j), a_i = (c_i - x) / sigma^2.
                aims = (self.nodes[node] - points[seen]) / self.sigma**2
                gradients[seen] += share[:, None] * (gradient + value[:, None] * aims)
                pulls[seen] += share[:, None] * aims
        return values, gradients - values[:, None] * pulls
