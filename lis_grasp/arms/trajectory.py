"""Joint trajectories, and the time-optimal timing of joint paths within limits (TOPP-RA)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lis_grasp.records import Record, short_repr
from lis_grasp.robots.arm import Arm
from lis_grasp.typing import FloatArray

TIME_STEP = 0.01
"""Between two points of a trajectory [s]."""

_POINTS = 60  # of the path's grid for each corner, and at least
_ROUNDING = 0.3  # largest length of a corner's sides that is rounded [rad or m]
_TINY = 1e-9  # of a length that counts as none [rad or m]


@dataclass(frozen=True, slots=True, eq=False)
class JointTrajectory(Record):
    """A motion of J joints from rest to rest, at T times."""

    joint_names: tuple[str, ...]
    times: FloatArray  # (T,) [s], from 0, increasing
    positions: FloatArray  # (T, J) [rad or m]
    velocities: FloatArray  # (T, J) [rad/s or m/s]
    accelerations: FloatArray  # (T, J) [rad/s^2 or m/s^2]

    __repr__ = short_repr

    @property
    def duration(self) -> float:
        """Time of the motion [s]."""
        return float(self.times[-1])

    def reversed(self) -> JointTrajectory:
        """Return the same motion backwards."""
        return JointTrajectory(
            self.joint_names,
            self.times,
            self.positions[::-1],
            -self.velocities[::-1],
            self.accelerations[::-1],
        )


def time_path(
    arm: Arm,
    corners: FloatArray,
    *,
    is_free: Callable[[FloatArray], bool] | None = None,
    fraction: float | None = None,
    step: float = TIME_STEP,
) -> JointTrajectory:
    """Return the fastest motion along a path from rest to rest within the arm's limits.

    The path has corners (W, J) [rad or m], which are rounded by parabolas. If it is then not free,
    as `is_free` says of a densely sampled path (N, J), the arm stops at each corner. A `fraction`
    of the arm's limits is used, `Arm.speed_fraction` for None; points are a `step` [s] apart.
    """
    corners = without_repeats(np.asarray(corners, np.float64))
    fraction = arm.speed_fraction if fraction is None else fraction
    limits = fraction * arm.velocity_limits, fraction * arm.acceleration_limits
    if len(corners) == 1:
        rest = np.zeros((1, len(arm.joint_names)))
        return JointTrajectory(arm.joint_names, np.zeros(1), corners, rest, rest)
    if len(corners) > 2:
        path = _rounded(corners, _ROUNDING)
        if is_free is None or is_free(path[0]):
            return _sampled(arm, path, limits, step)
    pairs = (corners[k : k + 2] for k in range(len(corners) - 1))
    return joined([_sampled(arm, _rounded(pair, 0.0), limits, step) for pair in pairs])


def joined(legs: list[JointTrajectory]) -> JointTrajectory:
    """Return trajectories one after the other, each from rest where the one before ends."""
    starts = np.cumsum([0.0, *(leg.duration for leg in legs[:-1])])
    parts = [
        (leg, start, slice(1 if n else 0, None))
        for n, (leg, start) in enumerate(zip(legs, starts, strict=True))
    ]
    return JointTrajectory(
        legs[0].joint_names,
        np.concatenate([start + leg.times[kept] for leg, start, kept in parts]),
        *(
            np.concatenate([getattr(leg, name)[kept] for leg, _, kept in parts])
            for name in ("positions", "velocities", "accelerations")
        ),
    )


def without_repeats(path: FloatArray) -> FloatArray:
    """Return a path (W, J) without points that repeat the one before."""
    moved = np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0) > _TINY
    return np.asarray(path[np.concatenate([[True], moved])])


# Positions, first and second derivatives by path length on a grid, each (N, J), and the grid (N,).
_Path = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def _rounded(corners: FloatArray, rounding: float) -> _Path:
    """Return a path of lines and parabolas along corners (W, J).

    A parabola replaces the last `rounding` of one line and the first of the next, or half of the
    lines where they are shorter. The first derivative is continuous.
    """
    sides = np.diff(corners, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    directions = sides / lengths[:, None]
    cut = np.minimum(np.minimum(lengths[:-1], lengths[1:]) / 2.0, rounding)  # (W - 2,)
    before, after = np.concatenate([[0.0], cut]), np.concatenate([cut, [0.0]])
    grids, values, firsts, seconds = [], [], [], []
    place = 0.0
    for k, direction in enumerate(directions):
        straight = lengths[k] - before[k] - after[k]
        if straight > _TINY:
            count = max(int(np.ceil(_POINTS * straight / lengths.sum())), 3)
            s = np.linspace(0.0, straight, count)
            values.append(corners[k] + (before[k] + s)[:, None] * direction)
            firsts.append(np.repeat(direction[None], len(s), axis=0))
            seconds.append(np.zeros((len(s), len(direction))))
            grids.append(place + s)
            place += straight
        if k < len(cut):
            s = np.linspace(0.0, 2.0 * cut[k], 12)
            bend = (directions[k + 1] - direction) / (2.0 * cut[k])
            enter = corners[k + 1] - cut[k] * direction
            values.append(enter + s[:, None] * direction + 0.5 * (s**2)[:, None] * bend)
            firsts.append(direction + s[:, None] * bend)
            seconds.append(np.repeat(bend[None], len(s), axis=0))
            grids.append(place + s)
            place += 2.0 * cut[k]
    return (
        np.concatenate(values),
        np.concatenate(firsts),
        np.concatenate(seconds),
        np.concatenate(grids),
    )


def _sampled(
    arm: Arm, path: _Path, limits: tuple[FloatArray, FloatArray], step: float
) -> JointTrajectory:
    """Return the fastest trajectory along a path, at times `step` apart."""
    squares = _squared_speeds(*path[1:], *limits)
    trajectory = _with_speeds(arm, path, squares, step)
    # Within a cell a joint may be faster than at its ends: slow down by as much.
    while (over := float((np.abs(trajectory.velocities) / limits[0]).max())) > 1.0 + 1e-9:
        squares = squares / over**2
        trajectory = _with_speeds(arm, path, squares, step)
    return trajectory


def _with_speeds(arm: Arm, path: _Path, squares: FloatArray, step: float) -> JointTrajectory:
    """Return the trajectory with squared speeds along a path at its grid points."""
    positions, first, second, grid = path
    # Between grid points the path's acceleration is constant: times of a uniformly changing speed.
    speeds = np.sqrt(squares)
    gaps = np.diff(grid)
    moving = gaps > _TINY
    spans = np.where(moving, 2.0 * gaps / np.maximum(speeds[1:] + speeds[:-1], _TINY), 0.0)
    times = np.concatenate([[0.0], np.cumsum(spans)])
    count = max(int(np.ceil(times[-1] / step)), 1)
    # The last step is as long as the others: the whole motion takes that little longer.
    slower = count * step / max(times[-1], _TINY)
    wanted = np.arange(count + 1) * step / slower
    cell = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(gaps) - 1)
    cell = np.where(spans[cell] > 0.0, cell, np.maximum(cell - 1, 0))
    elapsed = wanted - times[cell]
    pull = np.where(moving, np.diff(squares) / (2.0 * np.maximum(gaps, _TINY)), 0.0)[cell]
    speed = np.maximum(speeds[cell] + pull * elapsed, 0.0)
    along = np.clip(speeds[cell] * elapsed + 0.5 * pull * elapsed**2, 0.0, gaps[cell])
    along = along[:, None]
    # Within a cell the path is a line or a parabola.
    q = positions[cell] + along * first[cell] + 0.5 * along**2 * second[cell]
    tangent = first[cell] + along * second[cell]
    velocities = speed[:, None] * tangent / slower
    accelerations = (pull[:, None] * tangent + (speed**2)[:, None] * second[cell]) / slower**2
    q[-1], velocities[-1] = positions[-1], 0.0
    return JointTrajectory(
        arm.joint_names, step * np.arange(count + 1, dtype=np.float64), q, velocities, accelerations
    )


def _squared_speeds(
    first: FloatArray,
    second: FloatArray,
    grid: FloatArray,
    speed_limits: FloatArray,
    acceleration_limits: FloatArray,
) -> FloatArray:
    """Return the largest squared speeds along a path, shape (N,), from rest to rest.

    TOPP-RA (Pham and Pham, 2018): with x the squared speed and u the acceleration along the path,
    the joints' accelerations are ``q' u + q'' x``. Going backwards, the largest x from which the
    next grid point can be reached is found; then, forwards, u is as large as permitted.
    """
    with np.errstate(divide="ignore"):
        most = ((speed_limits / np.abs(first)) ** 2).min(axis=1)
    most = np.minimum(most, 1e6)
    most[0] = most[-1] = 0.0
    gaps = np.diff(grid)
    # Upper bounds of a u + b x, for the acceleration at both ends of a cell, (4 J,) each.
    bounds = np.tile(acceleration_limits, 4)
    highest = np.zeros(len(grid))
    rows = [
        (np.concatenate([f, -f, g, -g]), np.concatenate([s, -s, t, -t]))
        for f, g, s, t in zip(first[:-1], first[1:], second[:-1], second[1:], strict=True)
    ]
    for i in range(len(gaps) - 1, -1, -1):
        if gaps[i] <= _TINY:
            highest[i] = min(highest[i + 1], most[i])
            continue
        a, b, c = _constraints(rows[i], bounds, gaps[i], highest[i + 1])
        highest[i] = min(_largest_x(a, b, c), most[i])
    squares = np.zeros(len(grid))
    for i, gap in enumerate(gaps):
        if gap <= _TINY:
            squares[i + 1] = min(squares[i], highest[i + 1])
            continue
        a, b, c = _constraints(rows[i], bounds, gap, highest[i + 1])
        rest = c - b * squares[i]
        up = a > _TINY
        u = float((rest[up] / a[up]).min())
        squares[i + 1] = min(max(squares[i] + 2.0 * gap * u, 0.0), highest[i + 1])
    return squares


def _constraints(
    row: tuple[FloatArray, FloatArray], bounds: FloatArray, gap: float, next_most: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a, b, c of all constraints ``a u + b x <= c`` of a cell.

    At the cell's end the squared speed is x + 2 gap u: at least 0, at most `next_most`.
    """
    a, b = row
    quarter = len(a) // 2
    a = a.copy()
    a[quarter:] += 2.0 * gap * b[quarter:]
    ends = np.array([2.0 * gap, -2.0 * gap])
    return (
        np.concatenate([a, ends]),
        np.concatenate([b, [1.0, -1.0]]),
        np.concatenate([bounds, [next_most, 0.0]]),
    )


def _largest_x(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Return the largest x >= 0 for which some u has ``a u + b x <= c`` in every row."""
    up, down = a > _TINY, a < -_TINY
    # u <= (c - b x) / a where a > 0, u >= that where a < 0: every upper bound above every lower.
    high, low = (c[up] / a[up], b[up] / a[up]), (c[down] / a[down], b[down] / a[down])
    spare = high[0][:, None] - low[0]
    slope = high[1][:, None] - low[1]
    rising = slope > _TINY
    largest = float((spare[rising] / slope[rising]).min(initial=np.inf))
    flat = ~up & ~down & (b > _TINY)
    largest = min(largest, float((c[flat] / b[flat]).min(initial=np.inf)))
    return max(largest, 0.0)


def minimum_jerk(phase: float) -> tuple[float, float]:
    """Return the minimum-jerk path from 0 to 1 at `phase`, and its derivative; at rest outside.

    Formula: ``s = 10 u^3 - 15 u^4 + 6 u^5`` (Flash and Hogan 1985), at rest at both ends. A path
    of length d in time T accelerates by at most ``5.77 d / T^2``.
    """
    u = min(max(phase, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2
