"""Narrow band of grid values near the surface.

Coarse cells are evaluated first; those near the surface are halved, twice. Then the band grows
along the surface until all four cells round every crossed edge are known. So the coarse pass may
miss a whole component smaller than a coarse cell, but it cannot tear a hole.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from lis_grasp.meshing._grid import Field, Grid
from lis_grasp.typing import BoolArray, FloatArray

COARSE = 4
"""Side of a coarse cell, in cells."""

# A coarse cell without a change of sign may hold a thin sheet. It is refined if the surface is, by
# the typical slope, nearer to a corner than this fraction of its side.
_NEARNESS = 0.5


def sample_band(field: Field, grid: Grid) -> FloatArray:
    """Return f at the nodes of every cell that the surface passes, shape `grid.nodes`.

    NaN where it was not evaluated. Nodes outside the bounds are outside the object, +inf.
    """
    values = sample_near_surface(field, grid, COARSE)
    _grow_along_surface(field, grid, values)
    return values


def sample_near_surface(field: Field, grid: Grid, step: int) -> FloatArray:
    """Return f at the nodes near the surface, shape `grid.nodes`, NaN at others, +inf outside.

    Coarse cells are `step` cells wide, a power of two. Of sheets thinner than half of one, parts
    may be missed.
    """
    values = np.full(grid.nodes, np.nan)
    wanted = np.zeros(grid.nodes, dtype=bool)
    wanted[::step, ::step, ::step] = True
    values[~grid.within_bounds()] = np.inf
    _evaluate(field, grid, values, wanted)
    # Here the magnitude of f is used, not only its sign.
    nearness = _NEARNESS * _typical_slope(values[::step, ::step, ::step])
    while step > 1:
        active = _cells_near_surface(values[::step, ::step, ::step], nearness)
        # While no inside is found, it may be anywhere.
        active |= not (values < 0.0).any()
        _evaluate(field, grid, values, _nodes_of_halved_cells(active, step, grid.nodes))
        nearness = 0.0
        step //= 2
    return values


def _evaluate(field: Field, grid: Grid, values: FloatArray, wanted: BoolArray) -> None:
    """Fill in the unknown values at the wanted nodes."""
    numbers = np.flatnonzero(wanted & np.isnan(values))
    values.reshape(-1)[numbers] = field.values(grid.positions(numbers))


def _typical_slope(values: FloatArray) -> float:
    """Return the median change of f along a cell's side near the surface."""
    crossing, other = [], []
    for axis in range(3):
        moved = np.moveaxis(values, axis, 0)
        low, high = moved[:-1], moved[1:]
        known = np.isfinite(low) & np.isfinite(high)
        changes, crosses = np.abs(high[known] - low[known]), (low < 0.0) != (high < 0.0)
        crossing.append(changes[crosses[known]])
        other.append(changes[~crosses[known]])
    chosen = np.concatenate(crossing)
    if not len(chosen):
        chosen = np.concatenate(other)
    return float(np.median(chosen)) if len(chosen) else 0.0


def _corners(values: FloatArray) -> list[FloatArray]:
    """Return views of the eight corners of every cell."""
    ends = (slice(None, -1), slice(1, None))
    return [values[ends[x], ends[y], ends[z]] for x, y, z in product((0, 1), repeat=3)]


def _cells_near_surface(values: FloatArray, nearness: float) -> BoolArray:
    """Return which cells with known corners change sign or have a value below `nearness`."""
    corners = _corners(values)
    known, some, every = (np.ones(corners[0].shape, dtype=bool) for _ in range(3))
    some[:] = False
    smallest = np.full(corners[0].shape, np.inf)
    for corner in corners:
        inside = corner < 0.0
        known &= ~np.isnan(corner)
        some |= inside
        every &= inside
        np.fmin(smallest, np.abs(corner), out=smallest)
    return known & ((some & ~every) | (smallest < nearness))


def _nodes_of_halved_cells(active: BoolArray, step: int, nodes: tuple[int, int, int]) -> BoolArray:
    """Return the nodes of the active cells, of side `step`, when each is cut into eight."""
    wanted = np.zeros(nodes, dtype=bool)
    half = step // 2
    for offset in product((0, half, step), repeat=3):
        region = tuple(
            slice(o, o + step * n, step) for o, n in zip(offset, active.shape, strict=True)
        )
        wanted[region] |= active
    return wanted


def _grow_along_surface(field: Field, grid: Grid, values: FloatArray) -> None:
    """Evaluate until all four cells round every edge that changes sign are known."""
    strides = grid.strides
    flat = values.reshape(-1)
    fresh = np.flatnonzero(grid.within_bounds() & ~np.isnan(values))
    while len(fresh):
        unknown = []
        for axis, stride in enumerate(strides):
            # Edges with at least one fresh end; the outermost nodes are outside, never fresh.
            low = np.unique(np.concatenate([fresh, fresh - stride]))
            crosses = (flat[low] < 0.0) != (flat[low + stride] < 0.0)
            low = low[crosses & ~np.isnan(flat[low]) & ~np.isnan(flat[low + stride])]
            b, c = strides[(axis + 1) % 3], strides[(axis + 2) % 3]
            for u, v, w in product((-1, 0, 1), (-1, 0, 1), (0, 1)):
                around = low + u * b + v * c + w * stride
                unknown.append(around[np.isnan(flat[around])])
        fresh = np.unique(np.concatenate(unknown))
        flat[fresh] = field.values(grid.positions(fresh))
