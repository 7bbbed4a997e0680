"""Gaussian process regression on values and gradients observed at the same places.

The posterior mean is a weighted sum of a kernel and its derivatives at the places.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.optimize import brentq

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces._kernels import RadialKernel
from lis_grasp.typing import FloatArray, IndexArray

# Value, slopes along x, y and z.
ROWS = 4

# Least amplitude of the search, as a fraction of the amplitude without any noise.
_LEAST_AMPLITUDE = 1e-3


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


def _with_length_noise(covariance: FloatArray, targets: FloatArray, deviation: float) -> FloatArray:
    """Add noise along the gradients of targets (N, 4) to a covariance (4N, 4N), in place."""
    if deviation:
        count, slopes = len(targets), deviation * targets[:, 1:]
        blocks = covariance.reshape(count, ROWS, count, ROWS)
        blocks[range(count), 1:, range(count), 1:] += slopes[:, :, None] * slopes[:, None]
    return covariance


def factorize(covariance: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the lower Cholesky factor of a covariance (M, M) with variances (M,) of noise.

    The covariance is overwritten. Raises `EstimationError` if the equations are singular.
    """
    covariance.reshape(-1)[:: len(covariance) + 1] += variances  # the diagonal
    factor, info = dpotrf(covariance, lower=1, clean=1, overwrite_a=1)
    if info:
        raise EstimationError(
            f"the equations of {len(covariance) // ROWS} contacts are singular: raise misfit, give"
            " their noise, or remove contacts at the same place"
        )
    return np.asarray(factor)


def log_likelihood(factor: FloatArray, targets: FloatArray) -> float:
    """Return the log marginal likelihood of targets (M,), whose covariance has a factor (M, M).

    Rasmussen and Williams 2006, eq. 2.30.
    """
    whitened, _ = dtrtrs(factor, targets, lower=1)
    log_determinant = 2.0 * float(np.log(factor.diagonal()).sum())
    constant = len(targets) * float(np.log(2.0 * np.pi))
    return -0.5 * (float(whitened @ whitened) + log_determinant + constant)


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


@dataclass(frozen=True, slots=True, eq=False)
class GradientRegression:
    """A zero-mean GP conditioned on value and gradient observations at nodes.

    weights = (K + noise)^-1 targets, with value and gradient blocks in K (Rasmussen and Williams
    2006, eq. 2.25 and section 9.4). Rows are ordered node by node, the value before the three
    slopes, so that one node is one block.

    Made by `fit`. Any unit of length; a coordinate system about as large as the nodes keeps the
    equations well scaled.
    """

    kernel: RadialKernel  # covariance of values; 1 at distance 0
    nodes: FloatArray  # (N, 3)
    targets: FloatArray  # (N, 4): value and gradient observed at each node
    noise: FloatArray  # (N, 4): variance of each of them
    cholesky: FloatArray  # (4N, 4N) lower factor of K + noise
    weights: FloatArray  # (N, 4)

    @classmethod
    def fit(
        cls,
        kernel: RadialKernel,
        nodes: FloatArray,
        targets: FloatArray,
        noise: FloatArray,
        *,
        length_noise: float = 0.0,
    ) -> GradientRegression:
        """Factorize the equations and solve them; EstimationError if they are singular.

        `noise` are variances, shape (N, 4), or (4,) where all nodes have the same. `length_noise`
        is the standard deviation of noise along each observed gradient, of unit length.
        """
        covariance = _with_length_noise(gradient_covariance(kernel, nodes), targets, length_noise)
        return cls._solve(kernel, nodes, targets, noise, covariance)

    @classmethod
    def _solve(
        cls,
        kernel: RadialKernel,
        nodes: FloatArray,
        targets: FloatArray,
        noise: FloatArray,
        covariance: FloatArray,
    ) -> GradientRegression:
        """Solve the equations with a prior covariance (4N, 4N), which is overwritten."""
        noise = np.broadcast_to(noise, targets.shape)
        factor = factorize(covariance, noise.ravel())
        weights = cho_solve((factor, True), targets.reshape(-1), check_finite=False)
        return cls(kernel, nodes, targets, noise, factor, weights.reshape(-1, ROWS))

    @classmethod
    def log_prior_amplitude(
        cls,
        kernel: RadialKernel,
        nodes: FloatArray,
        targets: FloatArray,
        *,
        sensor_noise: FloatArray,
        misfit: FloatArray,
        length_noise: float = 0.0,
    ) -> float:
        """Return log a of the prior a^2 k that suits sensor noise known in absolute terms.

        The noise is a^2 misfit + sensor_noise, variances of shape (4,) and (N, 4) or (4,), and that
        of lengths, see `fit`, times a^2. a solves
        targets^T (a^2 (K + misfit) + sensor_noise)^-1 targets = 4N: the targets scatter as
        predicted. The left side falls with a, so the root is unique.
        """
        covariance = _with_length_noise(gradient_covariance(kernel, nodes), targets, length_noise)
        process = cls._solve(kernel, nodes, targets, misfit, covariance.copy())
        # Noise explains some of the scatter: a is lower than without it; 0.1 more for rounding.
        high = float(np.log(process.likeliest_amplitude())) + 0.1
        low = high + float(np.log(_LEAST_AMPLITUDE))

        # Arguments, no closure: SciPy makes a cycle of references that would keep the covariance.
        arguments = (kernel, nodes, targets, sensor_noise, misfit, covariance)
        if cls._excess(low, *arguments) <= 0.0:  # noise explains all of the scatter
            return low
        return float(brentq(cls._excess, low, high, args=arguments, xtol=1e-9))

    @classmethod
    def _excess(
        cls,
        log_amplitude: float,
        kernel: RadialKernel,
        nodes: FloatArray,
        targets: FloatArray,
        sensor_noise: FloatArray,
        misfit: FloatArray,
        covariance: FloatArray,
    ) -> float:
        """Return how much larger the logarithm of the likeliest amplitude is than that assumed."""
        noise = misfit + sensor_noise * np.exp(-2.0 * log_amplitude)
        process = cls._solve(kernel, nodes, targets, noise, covariance.copy())
        return float(np.log(process.likeliest_amplitude())) - log_amplitude

    @property
    def mean(self) -> KernelExpansion:
        """Posterior mean."""
        return KernelExpansion(self.kernel, self.nodes, self.weights)

    def variance(self, queries: FloatArray) -> FloatArray:
        """Return the posterior variance of values at queries (P, 3), shape (P,).

        k(x, x) - k_*^T (K + noise)^-1 k_* (Rasmussen and Williams 2006, eq. 2.26).
        """
        cross = cross_covariance(self.kernel, queries, self.nodes)
        solved = solve_triangular(self.cholesky, cross.T, lower=True, check_finite=False)
        prior = self.kernel.value(np.zeros(1))[0]
        return np.clip(prior - np.einsum("np,np->p", solved, solved), 0.0, prior)

    def leave_groups_out(self, groups: IndexArray) -> FloatArray:
        """Return leave-group-out predictions: means of shape (N, 4), `groups` of shape (N,).

        Each group is predicted from all others, in closed form.
        """
        means = np.empty_like(self.targets)
        for members, residuals, _ in self._leave_out(groups):
            means[members] = self.targets[members] - residuals
        return means

    def leave_groups_out_amplitude(self, groups: IndexArray, nodes: IndexArray) -> float:
        """Return the factor of all standard deviations that fits the leave-group-out residuals.

        Its square is the mean squared standardised residual, r_i^T covariance_i^-1 r_i / 4, of one
        node of each group, predicted without its group: `nodes[k]` represents group k. Where each
        group is one node it maximises the leave-one-out log density (Rasmussen and Williams 2006,
        eq. 5.11).
        """
        squares = []
        for members, residuals, covariance in self._leave_out(groups):
            own = int(np.flatnonzero(members == nodes[groups[members[0]]])[0])
            rows = slice(ROWS * own, ROWS * own + ROWS)
            squares.append(
                residuals[own] @ np.linalg.solve(covariance[rows, rows], residuals[own]) / ROWS
            )
        return float(np.sqrt(np.mean(squares)))

    def likeliest_amplitude(self) -> float:
        """Return the factor of all standard deviations that makes the targets most likely.

        Its square is targets^T (K + noise)^-1 targets / 4N: eq. 5.8 of Rasmussen and Williams 2006
        at its maximum over a common factor of K and noise, which the mean does not depend on.
        """
        return float(np.sqrt(np.mean(self.targets * self.weights)))

    def _leave_out(self, groups: IndexArray) -> Iterator[tuple[IndexArray, FloatArray, FloatArray]]:
        """Yield the members (M,), residuals (M, 4) and covariance (4M, 4M) of each group.

        residuals = B^-1 weights, covariance = B^-1, with B the group's diagonal block of
        (K + noise)^-1 (Rasmussen and Williams 2006, eqs. 5.10 to 5.12, for blocks instead of single
        rows). The covariance includes the noise.
        """
        # L^-1 of K + noise = L L^T.
        identity = np.eye(len(self.cholesky))
        inverse = solve_triangular(self.cholesky, identity, lower=True, check_finite=False)
        for group in np.unique(groups):
            members = np.flatnonzero(groups == group)
            columns = inverse[:, (ROWS * members[:, None] + np.arange(ROWS)).ravel()]
            covariance = np.asarray(np.linalg.inv(columns.T @ columns), np.float64)
            residuals = covariance @ self.weights[members].ravel()
            yield members, residuals.reshape(-1, ROWS), covariance
