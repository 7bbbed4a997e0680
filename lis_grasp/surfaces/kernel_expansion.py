"""Weighted sums of a kernel and its derivatives at nodes, and their covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.surfaces._kernels import RadialKernel
from lis_grasp.typing import FloatArray

# Value, slopes along x, y and z.
ROWS = 4


@dataclass(frozen=True, slots=True, eq=False)
class KernelExpansion:
    """f(x) = sum_i w_i k(x, x_i) + g_i . dk(x, x_i) / dx_i: the mean of a Gaussian process.

    Conditioned on values and gradients at its nodes (Rasmussen and Williams 2006, section 9.4).
    """

    kernel: RadialKernel  # covariance of values; 1 at distance 0
    nodes: FloatArray  # (N, 3)
    weights: FloatArray  # (N, 4): of the value and the three slopes at each node

    def value(self, queries: FloatArray) -> FloatArray:
        """Return f at queries (P, 3), shape (P,)."""
        return np.asarray(self.terms(queries).sum(axis=0))

    def terms(self, queries: FloatArray) -> FloatArray:
        """Return the term of each node at queries (P, 3), shape (N, P)."""
        count, values, gammas = len(self.nodes), self.weights[:, :1], self.weights[:, 1:]
        slopes = np.zeros((count, 5))  # maps the columns to (x - x_i) . g_i
        slopes[:, :3] = gammas
        slopes[:, 3] = -np.einsum("nk,nk->n", self.nodes, gammas)
        both = np.vstack([_distance_rows(self.nodes), slopes]) @ _columns(queries)
        squares = np.maximum(both[:count], 0.0, out=both[:count])
        return self.kernel.combined(squares, values, both[count:])

    def gradient(self, queries: FloatArray) -> FloatArray:
        """Return the gradient of f at queries (P, 3), shape (P, 3)."""
        # A sum over nodes of factors times d = x - x_i is x sum(factors) - factors @ x_i.
        r = _distances(queries, self.nodes)
        first = self.kernel.first(r)
        factors = first * self.weights[:, 0] + self.kernel.second(r) * self._slopes(queries)
        pulls = queries * factors.sum(axis=1)[:, None] - factors @ self.nodes
        return first @ self.weights[:, 1:] - pulls

    def _slopes(self, queries: FloatArray) -> FloatArray:
        """Return (x - x_i) . (weights of the gradient at i), shape (P, N)."""
        gammas = self.weights[:, 1:]
        slopes = queries @ gammas.T
        slopes -= np.einsum("nk,nk->n", self.nodes, gammas)
        return slopes


def cross_covariance(kernel: RadialKernel, queries: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return covariances of values at queries (P, 3) with the rows of nodes (N, 3), (P, 4N)."""
    r = _distances(queries, nodes)
    cross = np.empty((*r.shape, ROWS))  # (P, N, 4)
    cross[:, :, 0], first = kernel.value_and_first(r)
    for k in range(3):
        cross[:, :, k + 1] = first * (queries[:, k, None] - nodes[:, k])
    return cross.reshape(len(queries), ROWS * len(nodes))


def gradient_covariance(kernel: RadialKernel, nodes: FloatArray) -> FloatArray:
    """Return the covariance matrix of values and slopes at nodes (N, 3), shape (4N, 4N).

    Rows are ordered node by node, the value before the three slopes.
    """
    offsets = nodes[:, None, :] - nodes  # (N, N, 3)
    r = np.linalg.norm(offsets, axis=2)
    bend = kernel.second(r)
    blocks = np.empty((len(nodes), ROWS, len(nodes), ROWS))
    blocks[:, 0, :, 0], slope = kernel.value_and_first(r)
    for a in range(3):
        mixed = slope * offsets[:, :, a]
        blocks[:, 0, :, a + 1] = mixed
        blocks[:, a + 1, :, 0] = -mixed
        for b in range(3):
            block = -bend * offsets[:, :, a] * offsets[:, :, b]
            blocks[:, a + 1, :, b + 1] = block + slope if a == b else block
    return blocks.reshape(ROWS * len(nodes), ROWS * len(nodes))


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return distances between rows, shape (P, N)."""
    squares = squared_distances(first, second)
    return np.sqrt(squares, out=squares)


def squared_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return squares of distances between rows, shape (N, P), to rounding of coordinates."""
    squares = _distance_rows(first) @ _columns(second)
    return np.maximum(squares, 0.0, out=squares)


def _distance_rows(points: FloatArray) -> FloatArray:
    """Return rows (N, 5) that map `_columns` to squares of distances from points (N, 3)."""
    rows = np.ones((len(points), 5))
    rows[:, :3] = -2.0 * points
    rows[:, 3] = np.einsum("nk,nk->n", points, points)
    return rows


def _columns(points: FloatArray) -> FloatArray:
    """Return x, y, z, 1 and the squared norm of points (P, 3), shape (5, P)."""
    columns = np.ones((5, len(points)))
    columns[:3] = points.T
    np.einsum("kp,kp->p", columns[:3], columns[:3], out=columns[4])
    return columns
