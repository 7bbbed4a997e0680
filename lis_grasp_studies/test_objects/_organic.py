"""Test objects that are smooth everywhere: no edge.

Development shapes are stars of waves, bent ellipsoids and blended balls. Evaluation shapes have
other generators: round sections swept along a line, and subdivided random polycubes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.shapes.solids import solid_of
from lis_grasp.typing import FloatArray
from lis_grasp_studies.test_objects.solid_modelling import (
    Solid,
    curve,
    star,
    superquadric,
    tube,
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


def _swept(knots: npt.ArrayLike, flatness: float = 1.0) -> Solid:
    """Return the solid swept by an ellipse along a smooth line, with round ends.

    The line and the radius pass through `knots`, rows (x, y, z, radius) [mm]. `flatness` is the
    height of the ellipse over its width.
    """
    line = 1e-3 * curve(knots, 400)
    steps = np.linalg.norm(np.diff(line[:, :3], axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(steps)])
    length = passed[-1]
    # Rings are dense at the ends, and begin and end beside the poles.
    places = 0.5 * length * (1.0 - np.cos(np.linspace(0.06, np.pi - 0.06, 90)))
    *path, radii = (np.interp(places, passed, column) for column in line.T)
    for beside, radius in ((places, line[0, 3]), (length - places, line[-1, 3])):
        # At a pole the radius of curvature is 0.8 of the knot's radius.
        radii = radii * np.sqrt(1.0 - (1.0 - beside / length) ** (1.6 * length / radius))
    return tube(np.column_stack(path), radii, sides=64, flatness=flatness)


def _grown(cells: int, cell: float, seed: int) -> Solid:
    """Return a random polycube of so many cells with sides of `cell` [mm], made smooth.

    Its corners are displaced by up to a quarter of a cell along each axis, then its surface is
    subdivided (Loop 1987).
    """
    rng = np.random.default_rng(seed)
    axes = np.eye(3, dtype=np.int64)
    body = [(0, 0, 0)]
    while len(body) < cells:
        step = rng.choice([-1, 1]) * axes[rng.integers(3)]
        place = tuple((body[rng.integers(len(body))] + step).tolist())
        body += [place] if place not in body else []
    squares = []
    for place in body:
        for axis, u, v in zip(axes, axes[[1, 2, 0]], axes[[2, 0, 1]], strict=True):
            for side in (0, 1):
                if tuple((place + (2 * side - 1) * axis).tolist()) not in body:
                    corner = place + side * axis
                    square = [corner, corner + u, corner + u + v, corner + v]
                    squares.append(square[:: 2 * side - 1])
    corners, index = np.unique(np.reshape(squares, (-1, 3)), axis=0, return_inverse=True)
    faces = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    vertices = 1e-3 * cell * (corners + rng.uniform(-0.25, 0.25, corners.shape))
    smooth = trimesh.remesh.subdivide_loop(vertices, faces, 4)
    return solid_of(trimesh.Trimesh(*smooth, process=False))


_LINES: Mapping[str, tuple[list[tuple[float, float, float, float]], float]] = MappingProxyType(
    {
        "avocado": ([(0, 0, 0, 26), (2, 0, 25, 37), (4, 0, 60, 30), (9, 0, 100, 15)], 1.0),
        "aubergine": (
            [(0, 0, 0, 22), (0, 0, 40, 30), (10, 0, 85, 25), (32, 0, 130, 18), (58, 0, 160, 12)],
            1.0,
        ),
        "bottle_gourd": (
            [
                *[(0, 0, 0, 30), (0, 0, 35, 40), (2, 0, 75, 24)],
                *[(5, 2, 105, 14), (16, 4, 130, 20), (32, 4, 150, 15)],
            ],
            1.0,
        ),
        "cashew": (
            [(36, 0, -36, 15), (8, 0, -30, 19), (-8, 0, 0, 20), (4, 0, 34, 21), (38, 0, 48, 18)],
            0.85,
        ),
        "bone": (
            [
                *[(0, 0, -80, 20), (0, 2, -55, 17), (0, 6, -10, 11)],
                *[(0, 5, 25, 12), (0, 2, 58, 18), (0, 0, 80, 22)],
            ],
            0.8,
        ),
        "chilli": ([(0, 0, 0, 16), (8, 4, 50, 15), (4, 10, 100, 12), (-20, 6, 150, 8)], 1.0),
        "croissant": (
            [
                (-62, 0, -40, 12),
                (-44, 0, -2, 18),
                (0, 0, 22, 25),
                (44, 0, -2, 18),
                (62, 0, -40, 12),
            ],
            0.9,
        ),
        "mussel": ([(-45, 0, 0, 18), (-15, 0, 6, 29), (15, 0, 8, 28), (45, 0, 0, 16)], 0.55),
    }
)

_POLYCUBES = MappingProxyType(
    {
        "pebble": (2, 46, 7),
        "tooth": (4, 40, 37),
        "elbow": (4, 40, 16),
        "knuckle": (5, 33, 38),
        "coral": (6, 33, 25),
        "root": (7, 33, 40),
        "antler": (8, 33, 13),
        "ginger": (8, 33, 20),
    }
)

EVALUATION: Mapping[str, Callable[[], Solid]] = MappingProxyType(
    {name: partial(_swept, *values) for name, values in _LINES.items()}
    | {name: partial(_grown, *values) for name, values in _POLYCUBES.items()}
)
"""Evaluation shapes: eight swept bodies of 0.09 to 0.16 m, eight polycubes of 0.07 to 0.16 m."""
