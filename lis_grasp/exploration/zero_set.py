"""Points of an estimated surface, quickly and roughly: enough to choose targets by, no mesh."""

from __future__ import annotations

import numpy as np

from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

# Each round, a secant and a halving step, at least halves the bracket.
_ROUNDS = 2


def sample_zero_set(
    surface: ImplicitSurface, bounds: FloatArray, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return points of the zero set in a box, and its outward normals there.

    One point on every edge of a grid across which f changes sign. Where f jumps over zero instead
    of passing through it (estimators that are pieced together do), there is a point only if the
    gradient says outward the same way that the jump does.

    Parameters
    ----------
    surface
        What was estimated.
    bounds
        Shape (2, 3) [m], lowest and highest corner of the box.
    cell
        Spacing of the grid [m].

    Returns
    -------
    points, normals
        Shapes (P, 3) [m] and (P, 3), unit.
    """
    counts = np.maximum(np.ceil((bounds[1] - bounds[0]) / cell).astype(int), 1) + 1
    axes = [bounds[0, k] + cell * np.arange(counts[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)  # (X, Y, Z, 3)
    values = surface.evaluate(grid)  # (X, Y, Z)
    lows, highs, at_low, at_high = [], [], [], []
    for axis in range(3):
        first = tuple(slice(0, -1) if k == axis else slice(None) for k in range(3))
        second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
        crossing = (values[first] < 0.0) != (values[second] < 0.0)
        lows.append(grid[first][crossing])
        highs.append(grid[second][crossing])
        at_low.append(values[first][crossing])
        at_high.append(values[second][crossing])
    low, high = np.concatenate(lows), np.concatenate(highs)
    if not len(low):
        return np.empty((0, 3)), np.empty((0, 3))
    f_low, f_high = np.concatenate(at_low), np.concatenate(at_high)
    points = _narrow(surface, low, high, f_low, f_high)
    gradients = surface.gradient(points)
    steepness = np.linalg.norm(gradients, axis=1)
    rising = np.einsum("pk,pk->p", gradients, high - low) * np.where(f_high < f_low, -1.0, 1.0)
    sound = (steepness > 0.0) & (rising > 0.0)
    return points[sound], gradients[sound] / steepness[sound, None]


def _narrow(
    surface: ImplicitSurface,
    low: FloatArray,
    high: FloatArray,
    f_low: FloatArray,
    f_high: FloatArray,
) -> FloatArray:
    """Return where f changes sign between `low` and `high`, shape (P, 3)."""
    a, b = np.zeros(len(low)), np.ones(len(low))  # positions of the bracket along each edge
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
