"""Test objects that are smooth everywhere: no plane face, no edge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from lis_grasp.typing import FloatArray
from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    star,
    superquadric,
    zero_set,
)

FunctionOfDirection = Callable[[FloatArray], FloatArray]


def lumpy() -> Solid:
    """Return a ball with six random low waves, 0.13 m across."""
    return star(_waves(0.055, 0.16, seed=3, count=6))


def bean() -> Solid:
    """Return an ellipsoid bent along a parabola, 0.15 m long."""

    def bent(points: FloatArray) -> FloatArray:
        moved = np.array(points)
        moved[:, 2] += 6.0 * points[:, 0] ** 2
        return moved

    return star(superquadric((0.075, 0.04, 0.032), 2.0)).warp_batch(bent)


def dumbbell() -> Solid:
    """Return two balls of different size and the soft neck between them, 0.17 m long."""
    neck = [(x, 0, 0.1 * x, 0.011) for x in (-0.02, -0.005, 0.01, 0.025)]
    return _blobs([(-0.05, 0, 0, 0.035), *neck, (0.055, 0, 0.01, 0.026)], 0.03)


def egg() -> Solid:
    """Return an egg, 0.09 m high."""
    return star(lambda d: 0.037 * (1.0 + 0.18 * d[:, 2]) / np.sqrt(1.0 - 0.35 * d[:, 2] ** 2))


def pear() -> Solid:
    """Return a pear that leans, 0.12 m high."""
    return _blobs([(0, 0, -0.022, 0.038), (0.004, 0, 0.022, 0.022), (0.01, 0, 0.042, 0.012)], 0.03)


def banana() -> Solid:
    """Return a bent, tapered body with round ends, 0.2 m long."""
    angles = np.linspace(-0.75, 0.75, 13)
    middle = 0.14 * np.column_stack([np.sin(angles), np.cos(angles) - 1.0, 0.0 * angles])
    radii = 0.006 + 0.014 * np.cos(1.9 * angles)
    return _blobs(np.column_stack([middle, radii]), 0.02)


def potato() -> Solid:
    """Return an oblong ball with nine random waves and a flat side, 0.12 m long."""
    waves = _waves(1.0, 0.1, seed=11, count=9, frequency=3.5)
    return star(lambda d: waves(d) * superquadric((0.06, 0.04, 0.034), 2.3)(d))


def peanut() -> Solid:
    """Return an oval of Cassini revolved and squeezed, 0.15 m long."""

    def field(p: FloatArray) -> FloatArray:
        x, y, z = p.T / 0.05
        radius = y**2 + (1.25 * z) ** 2
        return np.asarray(np.sqrt(((x - 1) ** 2 + radius) * ((x + 1) ** 2 + radius)) - 1.13)

    return zero_set(field, (-0.09, -0.05, -0.05), (0.09, 0.05, 0.05), 0.0025)


def soft_cube() -> Solid:
    """Return a superellipsoid of exponent 3.6, a cube without edges, 0.1 m across."""
    return star(superquadric((0.05, 0.044, 0.038), 3.6))


def toy_duck() -> Solid:
    """Return a duck: body, tail, neck, head and beak, blended, 0.14 m long."""
    body = [(0, 0, 0, 0.04), (-0.04, 0, 0.012, 0.02), (-0.062, 0, 0.028, 0.008)]
    head = [(0.03, 0, 0.045, 0.015), (0.036, 0, 0.068, 0.022), (0.066, 0, 0.064, 0.007)]
    return _blobs([*body, *head], 0.018)


def twisted_pebble() -> Solid:
    """Return a flat ellipsoid twisted by 140 degrees along its length, 0.2 m long."""

    def twisted(points: FloatArray) -> FloatArray:
        angle = np.deg2rad(140.0) * points[:, 2] / 0.2
        x, y = points[:, 0], points[:, 1]
        c, s = np.cos(angle), np.sin(angle)
        return np.column_stack([c * x - s * y, s * x + c * y, points[:, 2]])

    return star(superquadric((0.045, 0.019, 0.1), 2.4)).warp_batch(twisted)


def tripod_knob() -> Solid:
    """Return three arms blended round a hub, 0.12 m across."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    arms = [(0.04 * np.cos(a), 0.04 * np.sin(a), 0.004, 0.015) for a in angles]
    inner = [(0.02 * np.cos(a), 0.02 * np.sin(a), 0.0, 0.013) for a in angles]
    return _blobs([(0, 0, 0, 0.02), *inner, *arms], 0.012)


def _waves(
    radius: float, height: float, *, seed: int, count: int, frequency: float = 2.5
) -> FunctionOfDirection:
    """Return a sphere's radius with random plane waves of relative height, for `star`."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions *= frequency / np.linalg.norm(directions, axis=1, keepdims=True)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    scale = height * np.sqrt(2.0 / count)
    return lambda d: radius * (1.0 + scale * np.cos(d @ directions.T + phases).sum(axis=1))


def _blobs(balls: npt.ArrayLike, softness: float) -> Solid:
    """Return the smooth union of balls, rows (x, y, z, radius) [m]: log-sum-exp of distances.

    Its surface is a little outside the balls: by up to softness / 4 times the logarithm of the
    number of balls that meet.
    """
    rows = np.asarray(balls, dtype=np.float64)
    width = softness / 4.0

    def field(points: FloatArray) -> FloatArray:
        distances = np.linalg.norm(points[:, None] - rows[:, :3], axis=2) - rows[:, 3]  # (P, B)
        least = distances.min(axis=1)
        return np.asarray(
            least - width * np.log(np.exp((least[:, None] - distances) / width).sum(axis=1))
        )

    margin = rows[:, 3:] + softness
    low, high = (rows[:, :3] - margin).min(axis=0), (rows[:, :3] + margin).max(axis=0)
    return zero_set(field, low, high, 0.0025)
