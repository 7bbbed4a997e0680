"""Means over nodes, weighted by a normalised Gaussian kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray, IndexArray

# Terms below exp(-30) = 1e-13 of the largest one vanish in a sum by rounding and are left out.
NEGLIGIBLE = 30.0
LEAST_WEIGHT = np.exp(-NEGLIGIBLE)


@dataclass(frozen=True, slots=True, eq=False)
class KernelMean:
    """Normalised weights s_i(x) = w_i k(x, c_i) / sum_j w_j k(x, c_j) of nodes c_i.

    They are finite at any distance from the nodes.
    """

    nodes: FloatArray  # (N, 3) [m]
    sigma: float  # width of the kernel [m] (Ottenhaus et al. 2016, eq. 6)
    log_weights: FloatArray  # (N,) log w_i
    _tree: cKDTree

    @classmethod
    def of(cls, nodes: FloatArray, sigma: float, weights: FloatArray | None = None) -> KernelMean:
        """Prepare the mean over nodes, shape (N, 3) [m]; the weights w_i default to 1."""
        log_weights = np.zeros(len(nodes)) if weights is None else np.log(weights)
        return cls(nodes, sigma, log_weights, cKDTree(nodes))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance from points, shape (P, 3), to their nearest node, shape (P,) [m]."""
        return self._tree.query(points)[0]

    def weights(self, points: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Return the M nodes with weight at some points, ascending, and normalised weights (M, P).

        The closer together the points (P, 3) [m], the fewer nodes.
        """
        near, exponents = self._exponents(points)
        np.exp(exponents, out=exponents)
        exponents /= exponents.sum(axis=0)
        return near, exponents

    def sparse_weights(self, points: FloatArray) -> tuple[IndexArray, IndexArray, FloatArray]:
        """Return node, point and normalised weight of each pair that is not negligible, (R,).

        The closer together the points (P, 3) [m], the faster.
        """
        near, exponents = self._exponents(points)
        kept = np.flatnonzero(exponents > -NEGLIGIBLE)
        row, point = np.divmod(kept, len(points))
        weights = np.exp(exponents.ravel()[kept])
        weights /= np.bincount(point, weights, len(points))[point]
        return near[row], point, weights

    def _exponents(self, points: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Return the nodes with weight at some points, and the logarithms, 0 at most, (M, P)."""
        near = self._near(points)
        origin = points[0]
        nodes, points = self.nodes[near] - origin, points - origin
        # Of eq. 6, but for a term that is common to all i.
        offsets = self.log_weights[near] - 0.5 * np.sum(nodes**2, axis=1) / self.sigma**2
        exponents = (nodes / self.sigma**2) @ points.T  # (M, P)
        exponents += offsets[:, None]
        exponents -= exponents.max(axis=0)
        return near, exponents

    def _near(self, points: FloatArray) -> IndexArray:
        """Return the nodes whose kernel is not negligible at some of the points."""
        coordinates = np.ascontiguousarray(points.T)
        low, high = coordinates.min(axis=1), coordinates.max(axis=1)
        center, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
        distance, nearest = self._tree.query(center)
        # A point at a distance d from some node needs those within sqrt(d^2 + reach^2).
        spread = float(np.ptp(self.log_weights))
        reach = self.sigma * np.sqrt(2.0 * (NEGLIGIBLE + spread))
        far = radius + np.hypot(distance + radius, reach)
        near = np.asarray(
            self._tree.query_ball_point(center, far * (1.0 + 1e-9), return_sorted=True), np.intp
        )
        # The difference of squared distances to two nodes is linear: its least value in the box.
        nodes = self.nodes[near]
        beyond = np.sum((nodes - center) ** 2, axis=1) - distance**2
        beyond -= np.abs(nodes - self.nodes[nearest]) @ (high - low)
        return near[beyond <= reach**2 + 1e-9 * far**2]

    def pulls(self, points: FloatArray, near: IndexArray, terms: FloatArray) -> FloatArray:
        """Return sum_i t_i (c_i - x) / sigma^2 over some nodes at points, shape (P, 3).

        `terms` t_i have shape (M, P). The gradient of a mean sum_i s_i(x) f_i is that of its terms'
        functions plus the pulls of s_i f_i, less f times the pulls of s_i.
        """
        origin = points[0]
        towards = terms.T @ (self.nodes[near] - origin)
        towards -= terms.sum(axis=0)[:, None] * (points - origin)
        return np.asarray(towards / self.sigma**2)


def density_weights(points: FloatArray, sigma: float) -> FloatArray:
    """Return one over the kernel density of contacts at each, 1 / sum_j k(c_i, c_j), shape (N,).

    A cheap substitute for the Voronoi volumes of eq. 9 (Ottenhaus et al. 2016): crowded contacts
    weigh less, and contacts at the same place have the weight of one, exactly.
    """
    tree = cKDTree(points)
    distances = tree.sparse_distance_matrix(tree, 8.0 * sigma, output_type="coo_matrix")
    kernel = np.exp(-0.5 * (distances.data / sigma) ** 2)
    # Pairs at distance 0, each contact with itself among them, are stored as explicit zeros.
    return 1.0 / np.bincount(distances.row, kernel, minlength=len(points))
