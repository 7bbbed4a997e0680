"""Analytic implicit surfaces for tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.typing import FloatArray

Function = Callable[[FloatArray], FloatArray]

# Central differences of a function of lengths about 0.1 m.
_DIFFERENCE = 1e-6

_UPRIGHT = np.eye(3)


def _nowhere(points: FloatArray) -> FloatArray:
    return np.zeros(points.shape[:-1])


@dataclass(frozen=True)
class Analytic:
    """The surface of a function, with a record of the number of points evaluated."""

    function: Function
    bounds: FloatArray
    doubt: Function = _nowhere
    difference: float = _DIFFERENCE
    asked: list[int] = field(default_factory=list)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        array = np.asarray(points, dtype=np.float64)
        self.asked.append(array[..., 0].size)
        return self.function(array)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        array = np.asarray(points, dtype=np.float64)
        steps = self.difference * np.eye(3)
        with np.errstate(invalid="ignore"):  # infinity less infinity
            slopes = [self.function(array + s) - self.function(array - s) for s in steps]
        return np.stack(slopes, axis=-1) / (2.0 * self.difference)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        return self.doubt(np.asarray(points, dtype=np.float64))


@dataclass(frozen=True)
class Ball:
    """An exact ball."""

    radius: float
    center: npt.ArrayLike = (0.0, 0.0, 0.0)
    doubt: Function = _nowhere

    @property
    def bounds(self) -> FloatArray:
        return self.center + cube_bounds(self.radius)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        return sphere(self.radius, self.center)(np.asarray(points))

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        away = np.asarray(points) - self.center
        return away / np.linalg.norm(away, axis=-1, keepdims=True)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        return self.doubt(np.asarray(points))


def differences(surface: ImplicitSurface, points: FloatArray, step: float) -> FloatArray:
    """Return central differences of a surface's function at points (N, 3), shape (N, 3)."""
    moves = step * np.eye(3)
    rises = [surface.evaluate(points + m) - surface.evaluate(points - m) for m in moves]
    return np.stack(rises, axis=-1) / (2.0 * step)


def cube_bounds(half: float) -> FloatArray:
    return half * np.array([[-1.0] * 3, [1.0] * 3])


def sphere(radius: float, center: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Function:
    return lambda p: np.linalg.norm(p - np.asarray(center), axis=-1) - radius


def torus(ring: float, tube: float) -> Function:
    return lambda p: np.hypot(np.hypot(p[..., 0], p[..., 1]) - ring, p[..., 2]) - tube


def box(
    half: npt.ArrayLike,
    rotation: npt.ArrayLike = _UPRIGHT,
    center: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> Function:
    """Largest distance outside of a face's plane; columns of the rotation are the box's axes."""
    return lambda p: (np.abs((p - np.asarray(center)) @ np.asarray(rotation)) - half).max(axis=-1)


def union(*functions: Function) -> Function:
    return lambda p: np.min([f(p) for f in functions], axis=0)


def difference(first: Function, second: Function) -> Function:
    return lambda p: np.maximum(first(p), -second(p))
