"""Wrist trajectories of a lift: minimum-jerk lines and shakes."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from lis_grasp.typing import FloatArray

# Time [s] -> displacement (6,) and its rate (6,): x, y, z [m], roll, pitch, yaw [rad], in W.
WristPath = Callable[[float], tuple[FloatArray, FloatArray]]


def rest_at(place: FloatArray) -> WristPath:
    """Return a path that stays at a displacement, shape (6,)."""
    return lambda time: (place, np.zeros(6))


def line(start: FloatArray, end: FloatArray, duration: float) -> WristPath:
    """Return a straight path from rest at `start` to rest at `end`, shapes (6,)."""

    def path(time: float) -> tuple[FloatArray, FloatArray]:
        part, rate = minimum_jerk(time / duration)
        return start + part * (end - start), rate / duration * (end - start)

    return path


def minimum_jerk(phase: float) -> tuple[float, float]:
    """Return the minimum-jerk path from 0 to 1 at `phase`, and its derivative; at rest outside.

    Formula: ``s = 10 u^3 - 15 u^4 + 6 u^5`` (Flash and Hogan 1985), at rest at both ends. A path
    of length d in time T accelerates by at most ``5.77 d / T^2``.
    """
    u = min(max(phase, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2


def shake_about(
    place: FloatArray, direction: FloatArray, acceleration: float, *, frequency: float, cycles: int
) -> WristPath:
    """Return a path that shakes about a displacement (6,) along a direction (6,).

    A sine of the given frequency [Hz], faded in and out over one period each: it is at rest before
    time 0 and after `cycles / frequency`. Scaled so that its peak acceleration along the direction
    is `acceleration`: [m/s^2] along a unit axis; for a rotation, a tangential acceleration if the
    direction is a unit axis over an arm [1/m]. There are at least 2 cycles.
    """
    amplitude = acceleration / (_unit_shake_acceleration(cycles) * frequency**2)

    def path(time: float) -> tuple[FloatArray, FloatArray]:
        displacement, velocity = _unit_shake(time * frequency, cycles)
        return (
            place + amplitude * displacement * direction,
            amplitude * frequency * velocity * direction,
        )

    return path


def _unit_shake(turns: float, cycles: int) -> tuple[float, float]:
    if not 0.0 < turns < cycles:
        return 0.0, 0.0
    rising = turns <= cycles / 2.0
    window, slope = minimum_jerk(turns if rising else cycles - turns)
    slope = slope if rising else -slope
    angle = 2.0 * np.pi * turns
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))
    return window * sine, slope * sine + 2.0 * np.pi * window * cosine


@lru_cache
def _unit_shake_acceleration(cycles: int) -> float:
    """Return the peak acceleration of the unit shake, by differences of its velocity."""
    turns = np.linspace(0.0, cycles, 2000 * cycles + 1)
    velocity = np.array([_unit_shake(float(u), cycles)[1] for u in turns])
    return float(np.abs(np.gradient(velocity, turns)).max())
