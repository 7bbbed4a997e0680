"""Quadric functions: the trend of a patch's Gaussian process.

A quadric h + n.x + x'Qx / 2 has ten coefficients, in the order h, n, Qxx, Qyy, Qzz, Qxy, Qxz, Qyz.
It describes planes, spheres and cylinders exactly.
"""

from __future__ import annotations

import numpy as np

from lis_grasp.typing import FloatArray

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
