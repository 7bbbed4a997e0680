"""Gaussian process regression on values and gradients told at the same places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.kernels import RadialKernel
from lis_grasp.typing import FloatArray, IndexArray

# Value, slopes along x, y and z.
ROWS = 4


@dataclass(frozen=True, slots=True, eq=False)
class GradientRegression:
    """A zero-mean Gaussian process that was told its value and gradient at nodes.

    weights = (K + noise)^-1 targets, with value and gradient blocks in K (Rasmussen and Williams
    2006, eq. 2.25 and section 9.4). Rows are ordered node by node, the value before the three
    slopes, so that a node more appends rows, and one node is one block.

    Made by `fit`. Any unit of length; a coordinate system about as large as the nodes keeps the
    equations well scaled.

    Parameters
    ----------
    kernel
        Covariance of values; 1 at distance 0.
    nodes
        Shape (N, 3).
    targets
        Shape (N, 4): value and gradient told at each node.
    noise
        Shape (4,): variance of each of the four.
    cholesky
        Shape (4N, 4N), lower factor of K + noise.
    weights
        Shape (N, 4).
    """

    kernel: RadialKernel
    nodes: FloatArray
    targets: FloatArray
    noise: FloatArray
    cholesky: FloatArray
    weights: FloatArray

    @classmethod
    def fit(
        cls, kernel: RadialKernel, nodes: FloatArray, targets: FloatArray, noise: FloatArray
    ) -> GradientRegression:
        """Factorize the equations and solve them; EstimationError if they are singular."""
        factor = _lower_cholesky(_noisy_covariance(kernel, nodes, noise))
        return cls._solved(kernel, nodes, targets, noise, factor)

    @classmethod
    def _solved(
        cls,
        kernel: RadialKernel,
        nodes: FloatArray,
        targets: FloatArray,
        noise: FloatArray,
        factor: FloatArray,
    ) -> GradientRegression:
        weights = cho_solve((factor, True), targets.reshape(-1), check_finite=False)
        return cls(kernel, nodes, targets, noise, factor, weights.reshape(-1, ROWS))

    def extended(self, nodes: FloatArray, targets: FloatArray) -> GradientRegression:
        """Return the same process, told M more nodes (M, 3) and targets (M, 4) too.

        The factor of [[A, B^T], [B, C]] is [[L, 0], [S, chol(C - S S^T)]] with S = B L^-T: all
        that is new are 4M rows.
        """
        before = len(self.cholesky)
        cross = _covariance(self.kernel, nodes, self.nodes)  # (4M, 4N)
        solved = solve_triangular(self.cholesky, cross.T, lower=True, check_finite=False)
        corner = _noisy_covariance(self.kernel, nodes, self.noise) - solved.T @ solved
        factor = np.zeros((before + len(corner), before + len(corner)))
        factor[:before, :before] = self.cholesky
        factor[before:, :before] = solved.T
        factor[before:, before:] = _lower_cholesky(corner)
        return self._solved(
            self.kernel,
            np.vstack([self.nodes, nodes]),
            np.vstack([self.targets, targets]),
            self.noise,
            factor,
        )

    def mean(self, queries: FloatArray) -> FloatArray:
        """Return the posterior mean at queries (P, 3), shape (P,)."""
        r = _distances(queries, self.nodes)  # (P, N)
        values = self.kernel.value(r) @ self.weights[:, 0]
        return values + np.einsum("pn,pn->p", self.kernel.first(r), self._slopes(queries))

    def mean_gradient(self, queries: FloatArray) -> FloatArray:
        """Return the gradient of the posterior mean at queries (P, 3), shape (P, 3)."""
        # A sum over nodes of factors times d = x - x_i is x sum(factors) - factors @ x_i.
        r = _distances(queries, self.nodes)
        first = self.kernel.first(r)
        factors = first * self.weights[:, 0] + self.kernel.second(r) * self._slopes(queries)
        pulls = queries * factors.sum(axis=1)[:, None] - factors @ self.nodes
        return first @ self.weights[:, 1:] - pulls

    def variance(self, queries: FloatArray) -> FloatArray:
        """Return the posterior variance of values at queries (P, 3), shape (P,).

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26).
        """
        r = _distances(queries, self.nodes)
        cross = np.empty((*r.shape, ROWS))  # (P, N, 4)
        cross[:, :, 0] = self.kernel.value(r)
        first = self.kernel.first(r)
        for k in range(3):
            cross[:, :, k + 1] = first * (queries[:, k, None] - self.nodes[:, k])
        cross = cross.reshape(len(queries), ROWS * len(self.nodes))
        solved = solve_triangular(self.cholesky, cross.T, lower=True, check_finite=False)
        prior = self.kernel.value(np.zeros(1))[0]
        return np.clip(prior - np.einsum("np,np->p", solved, solved), 0.0, prior)

    def leave_groups_out(self, groups: IndexArray) -> FloatArray:
        """Return what the nodes of all other groups foretell at each, means of shape (N, 4).

        As `leave_one_out`, with blocks of all rows of a group; `groups` is of shape (N,).
        """
        inverse = solve_triangular(
            self.cholesky, np.eye(len(self.cholesky)), lower=True, check_finite=False
        )
        means = np.empty_like(self.targets)
        for group in np.unique(groups):
            members = np.flatnonzero(groups == group)
            columns = inverse[:, (ROWS * members[:, None] + np.arange(ROWS)).ravel()]
            shifts = np.linalg.solve(columns.T @ columns, self.weights[members].ravel())
            means[members] = self.targets[members] - shifts.reshape(-1, ROWS)
        return means

    def leave_one_out(self) -> tuple[FloatArray, FloatArray]:
        """Return what all other nodes foretell at each: means (N, 4), covariances (N, 4, 4).

        mean_i = targets_i - B_i^-1 weights_i, covariance_i = B_i^-1, with B_i the 4 x 4 diagonal
        block of (K + noise)^-1 (Rasmussen and Williams 2006, eqs. 5.10 to 5.12, for blocks instead
        of single rows). The covariance includes the noise.
        """
        inverse = solve_triangular(
            self.cholesky, np.eye(len(self.cholesky)), lower=True, check_finite=False
        )
        columns = inverse.reshape(-1, len(self.nodes), ROWS).transpose(1, 2, 0)  # (N, 4, 4N)
        covariances = np.linalg.inv(columns @ columns.transpose(0, 2, 1))  # (N, 4, 4)
        means = self.targets - np.einsum("nij,nj->ni", covariances, self.weights)
        return means, covariances

    def likeliest_amplitude(self) -> float:
        """Return the factor of all standard deviations that makes the targets most likely.

        Its square is targets^T (K + noise)^-1 targets / 4N: eq. 5.8 of Rasmussen and Williams 2006
        at its maximum over a common factor of K and noise, which the mean does not depend on.
        """
        return float(np.sqrt(np.mean(self.targets * self.weights)))

    def leave_one_out_amplitude(self) -> float:
        """Return the factor of all standard deviations that fits what leaving out one node shows.

        Its square is the mean squared standardised residual, r_i^T covariance_i^-1 r_i / 4 with
        r_i = targets_i - mean_i: it maximises the `leave_one_out_log_density`.
        """
        return self._leave_one_out_scatter()[0]

    def log_marginal_likelihood(self) -> float:
        """Return log p(targets) at the likeliest amplitude.

        Rasmussen and Williams 2006, eq. 5.8.
        """
        half_log_determinant = float(np.log(np.diag(self.cholesky)).sum())
        return _log_density(self.likeliest_amplitude(), half_log_determinant, self.targets.size)

    def leave_one_out_log_density(self) -> float:
        """Return sum_i log p(targets_i | all others), at the amplitude that maximises it.

        Rasmussen and Williams 2006, eqs. 5.10 and 5.11, for blocks of one value and three slopes.
        """
        amplitude, half_log_determinant = self._leave_one_out_scatter()
        return _log_density(amplitude, half_log_determinant, self.targets.size)

    def _leave_one_out_scatter(self) -> tuple[float, float]:
        """Return the root mean square of standardised residuals and half their log determinants."""
        means, covariances = self.leave_one_out()
        residuals = self.targets - means  # (N, 4)
        solved = np.linalg.solve(covariances, residuals[:, :, None])[:, :, 0]
        _, log_determinants = np.linalg.slogdet(covariances)
        return float(np.sqrt(np.mean(residuals * solved))), 0.5 * float(log_determinants.sum())

    def _slopes(self, queries: FloatArray) -> FloatArray:
        """Return (x - x_i) . (weights of the gradient at i), shape (P, N)."""
        gammas = self.weights[:, 1:]
        slopes = queries @ gammas.T
        slopes -= np.einsum("nk,nk->n", self.nodes, gammas)
        return slopes


def _log_density(amplitude: float, half_log_determinant: float, count: int) -> float:
    """Return a normal log density of `count` numbers whose mean square is just as told."""
    return -count * (np.log(amplitude) + 0.5 * (1.0 + np.log(2.0 * np.pi))) - half_log_determinant


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return distances between rows, shape (P, N)."""
    squares = np.sum(first**2, axis=1)[:, None] + np.sum(second**2, axis=1) - 2.0 * first @ second.T
    return np.sqrt(np.maximum(squares, 0.0))


def _covariance(kernel: RadialKernel, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the covariance of values and slopes at (M, 3) with those at (N, 3): (4M, 4N)."""
    offsets = first[:, None, :] - second  # (M, N, 3)
    r = np.linalg.norm(offsets, axis=2)
    slope, bend = kernel.first(r), kernel.second(r)
    blocks = np.empty((len(first), ROWS, len(second), ROWS))
    blocks[:, 0, :, 0] = kernel.value(r)
    for a in range(3):
        lean = slope * offsets[:, :, a]
        blocks[:, 0, :, a + 1] = lean
        blocks[:, a + 1, :, 0] = -lean
        for b in range(3):
            block = -bend * offsets[:, :, a] * offsets[:, :, b]
            blocks[:, a + 1, :, b + 1] = block + slope if a == b else block
    return blocks.reshape(ROWS * len(first), ROWS * len(second))


def _noisy_covariance(kernel: RadialKernel, nodes: FloatArray, noise: FloatArray) -> FloatArray:
    matrix = _covariance(kernel, nodes, nodes)
    matrix[np.diag_indices_from(matrix)] += np.tile(noise, len(nodes))
    return matrix


def _lower_cholesky(matrix: FloatArray) -> FloatArray:
    try:
        return cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError as error:
        raise EstimationError(
            f"the Gaussian process' equations are singular ({error}): raise misfit,"
            " or remove contacts at the same place"
        ) from None
