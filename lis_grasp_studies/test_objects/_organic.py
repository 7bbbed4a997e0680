"""Test objects that are smooth everywhere: no edge.

Development shapes are stars of waves, bent ellipsoids and blended balls. Evaluation shapes have
other generators: round sections swept along a line, and subdivided random polycubes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.io.yaml_files import read_yaml
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


def lumpy() -> Solid:
    """Return a ball with six random plane waves, 0.13 m across."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(6, 3))
    waves *= 2.5 / np.linalg.norm(waves, axis=1, keepdims=True)
    phases = rng.uniform(0.0, 2.0 * np.pi, 6)
    scale = 0.16 * np.sqrt(2.0 / 6)
    return star(lambda d: 0.055 * (1.0 + scale * np.cos(d @ waves.T + phases).sum(axis=1)))


def bean() -> Solid:
    """Return an ellipsoid bent along a parabola, 0.15 m long."""

    def bent(points: FloatArray) -> FloatArray:
        moved = np.array(points)
        moved[:, 2] += 6.0 * points[:, 0] ** 2
        return moved

    return star(superquadric((0.075, 0.04, 0.032), 2.0)).warp_batch(bent)


def dumbbell() -> Solid:
    """Return two balls of different size and the soft neck between them, 0.17 m long.

    A smooth union: log-sum-exp of distances. Its surface is a little outside the balls.
    """
    neck = [(x, 0, 0.1 * x, 0.011) for x in (-0.02, -0.005, 0.01, 0.025)]
    balls = np.array([(-0.05, 0, 0, 0.035), *neck, (0.055, 0, 0.01, 0.026)])
    softness = 0.03
    width = softness / 4.0

    def field(points: FloatArray) -> FloatArray:
        distances = np.linalg.norm(points[:, None] - balls[:, :3], axis=2) - balls[:, 3]  # (P, B)
        least = distances.min(axis=1)
        return np.asarray(
            least - width * np.log(np.exp((least[:, None] - distances) / width).sum(axis=1))
        )

    margin = balls[:, 3:] + softness
    low, high = (balls[:, :3] - margin).min(axis=0), (balls[:, :3] + margin).max(axis=0)
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


_EVALUATION = read_yaml(Path(__file__).with_name("organic.yaml"))

EVALUATION: Mapping[str, Callable[[], Solid]] = MappingProxyType(
    {name: partial(_swept, **values) for name, values in _EVALUATION["swept"].items()}
    | {name: partial(_grown, **values) for name, values in _EVALUATION["grown"].items()}
)
"""Evaluation shapes: eight swept bodies of 0.09 to 0.16 m, eight polycubes of 0.07 to 0.16 m."""
