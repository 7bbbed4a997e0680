"""Samples of the zero level set of an implicit surface, without a mesh."""

from __future__ import annotations

import numpy as np

from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

# Each round, a secant and a bisection step, at least halves the bracket.
_ROUNDS = 2


def sample_zero_level_set(
    surface: ImplicitSurface, bounds: FloatArray, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return points of the zero level set in a box, and its outward normals there.

    There is one point on every grid edge across which f changes sign. Where f jumps over zero (as
    piecewise estimates do), there is a point only if the gradient and the jump agree on the outward
    side.

    Returns points and normals, shapes (P, 3) [m] and (P, 3), unit. `bounds`, shape (2, 3) [m], are
    the lowest and highest corner of the box, `cell` is the spacing of the grid [m].
    """
    counts = np.maximum(np.ceil((bounds[1] - bounds[0]) / cell).astype(int), 1) + 1
    axes = [bounds[0, k] + cell * np.arange(counts[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)  # (X, Y, Z, 3)
    values = surface.evaluate(grid)  # (X, Y, Z)
    edges = []
    for axis in range(3):
        first = tuple(slice(0, -1) if k == axis else slice(None) for k in range(3))
        second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
        crossing = (values[first] < 0.0) != (values[second] < 0.0)
        ends = grid[first], grid[second], values[first], values[second]
        edges.append([end[crossing] for end in ends])
    low, high, f_low, f_high = (np.concatenate(ends) for ends in zip(*edges, strict=True))
    if not len(low):
        return np.empty((0, 3)), np.empty((0, 3))
    points = _roots(surface, low, high, f_low, f_high)
    gradients = surface.gradient(points)
    steepness = np.linalg.norm(gradients, axis=1)
    rising = np.einsum("pk,pk->p", gradients, high - low) * np.where(f_high < f_low, -1.0, 1.0)
    consistent = (steepness > 0.0) & (rising > 0.0)
    return points[consistent], gradients[consistent] / steepness[consistent, None]


def _roots(
    surface: ImplicitSurface,
    low: FloatArray,
    high: FloatArray,
    f_low: FloatArray,
    f_high: FloatArray,
) -> FloatArray:
    """Return the sign changes of f between `low` and `high`, shape (P, 3)."""
    a, b = np.zeros(len(low)), np.ones(len(low))  # the bracket along each edge
    f_a, f_b = f_low.copy(), f_high.copy()
    for round_ in range(2 * _ROUNDS):
        secant = a - f_a * (b - a) / np.where(f_b == f_a, 1.0, f_b - f_a)
        t = secant if round_ % 2 == 0 else 0.5 * (a + b)
        f_t = surface.evaluate(low + t[:, None] * (high - low))
        below = (f_t < 0.0) == (f_a < 0.0)
        a, f_a = np.where(below, t, a), np.where(below, f_t, f_a)
        b, f_b = np.where(below, b, t), np.where(below, f_b, f_t)
    t = np.where(np.abs(f_a) < np.abs(f_b), a, b)
    return low + t[:, None] * (high - low)
