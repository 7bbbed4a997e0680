"""Hermite data: crossings of the surface with grid edges, and its normals there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.meshing._grid import Field, Grid
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# A step this short, in cells, is the last; the crossing is then good to the next order.
_TOLERANCE = 5e-3

# Gradients are taken at least this far from the nodes, in cells.
_ASIDE = 1e-3

# This fraction of the change of f over an edge counts as zero.
_NEGLIGIBLE = 1e-9

# Steps of root finding: a smooth function needs one to three, one with a kink at its zero (LIS: its
# slopes there differ by a factor of a hundred) a dozen; with more it is a jump.
_STEPS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Edges of the grid that the surface crosses, in order of axis, then of their lower node."""

    axes: IndexArray  # (E,) direction of each edge: 0, 1 or 2
    lower: IndexArray  # (E,) number of its lower node
    # (E,) whether the lower node is the inside one: the surface faces along the axis
    leaving: BoolArray
    points: FloatArray  # (E, 3) [m], where the edge is crossed
    normals: FloatArray  # (E, 3) unit, outward; 0 where there is none

    def __len__(self) -> int:
        return len(self.lower)


def find_crossings(field: Field, grid: Grid, values: FloatArray) -> Crossings:
    """Find the crossings of the surface, closed by the bounds, with the edges of the grid.

    On an edge that leaves the bounds the crossing is at the bounds or before; at the bounds the
    surface faces out of the box. `values` are of `sample_band`.
    """
    axes, lower, leaving = _crossed_edges(grid, values)
    strides = np.array(grid.strides)[axes]
    inner = lower + np.where(leaving, 0, strides)
    outer = lower + np.where(leaving, strides, 0)
    starts, ends = grid.positions(inner), grid.positions(outer)
    flat = values.reshape(-1)
    f_starts, f_ends = flat[inner], flat[outer].copy()
    # An edge that leaves the box ends at the bounds.
    clipped = np.clip(ends, *grid.bounds)
    leaves_box = np.flatnonzero((clipped != ends).any(axis=1))
    faces_out = np.sign(ends - starts)[leaves_box]
    ends[leaves_box] = clipped[leaves_box]
    f_ends[leaves_box] = field.values(ends[leaves_box])
    still_inside = f_ends < 0.0
    searched = np.flatnonzero(~still_inside)
    fractions = np.ones(len(lower))
    fractions[searched], jumps = _find_roots(
        field, starts[searched], ends[searched], f_starts[searched], f_ends[searched]
    )
    points = starts + fractions[:, None] * (ends - starts)
    normals = np.zeros_like(points)
    smooth = searched[~jumps]
    # Not at a node itself, which may be on a sharp edge, where the gradient is arbitrary.
    aside = np.clip(fractions[smooth], _ASIDE, 1.0 - _ASIDE)[:, None]
    normals[smooth] = field.normals(starts[smooth] + aside * (ends[smooth] - starts[smooth]))
    on_box = still_inside[leaves_box]
    normals[leaves_box[on_box]] = faces_out[on_box]
    return Crossings(axes, lower, leaving, points, normals)


def _crossed_edges(grid: Grid, values: FloatArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Return axis, lower node and sense of every edge with one end inside and one outside."""
    flat = values.reshape(-1)
    inside = np.flatnonzero(flat < 0.0)
    parts = []
    for axis, stride in enumerate(grid.strides):
        # Nodes inside are never outermost; an unknown neighbour of theirs is inside as well.
        leaving = inside[flat[inside + stride] >= 0.0]
        entering = inside[flat[inside - stride] >= 0.0] - stride
        lower = np.concatenate([leaving, entering])
        order = np.argsort(lower, kind="stable")
        sense = np.arange(len(lower)) < len(leaving)
        parts.append((np.full(len(lower), axis), lower[order], sense[order]))
    axes, lowers, senses = zip(*parts, strict=True)
    return np.concatenate(axes), np.concatenate(lowers), np.concatenate(senses)


def _find_roots(
    field: Field, starts: FloatArray, ends: FloatArray, f_starts: FloatArray, f_ends: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the roots of f on segments (E, 3), as fractions, and which are jumps instead.

    f is negative at starts only. Regula falsi with the Illinois halving (Dowell and Jarratt 1971),
    and bisection after a step that has not halved the bracket. Converged is a root whose next step
    would not move and where f is much smaller than at the ends; the rest are jumps.
    """
    roots = _secant(np.zeros(len(starts)), np.ones(len(starts)), f_starts, f_ends)
    low, high = np.zeros(len(roots)), np.ones(len(roots))
    f_low, f_high = f_starts, f_ends
    negligible = _NEGLIGIBLE * np.nan_to_num(f_ends - f_starts, posinf=0.0)
    side = np.zeros(len(roots))
    pending, tried = np.arange(len(roots)), roots
    for _ in range(_STEPS):
        segments = ends[pending] - starts[pending]
        f = field.values(starts[pending] + tried[:, None] * segments)
        inside = f < 0.0
        width = high - low
        low, high = np.where(inside, tried, low), np.where(inside, high, tried)
        f_low, f_high = np.where(inside, f, f_low), np.where(inside, f_high, f)
        roots[pending] = _secant(low, high, f_low, f_high)
        smaller = 0.1 * np.abs(np.where(inside, f_starts[pending], f_ends[pending]))
        converged = np.abs(roots[pending] - tried) <= _TOLERANCE
        converged &= np.abs(f) <= np.maximum(smaller, negligible[pending])
        # An end that has stayed for two steps pulls half as hard.
        stayed = side == np.where(inside, 1.0, -1.0)
        side = np.where(inside, 1.0, -1.0)
        f_high = np.where(stayed & inside, 0.5 * f_high, f_high)
        f_low = np.where(stayed & ~inside, 0.5 * f_low, f_low)
        slow = stayed & (high - low > 0.5 * width)
        tried = np.where(slow, 0.5 * (low + high), _secant(low, high, f_low, f_high))
        going = ~converged
        pending, tried, side = pending[going], tried[going], side[going]
        low, high, f_low, f_high = low[going], high[going], f_low[going], f_high[going]
        if not len(pending):
            break
    roots[pending] = 0.5 * (low + high)
    jumps = np.zeros(len(roots), dtype=bool)
    jumps[pending] = True
    return roots, jumps


def _secant(low: FloatArray, high: FloatArray, f_low: FloatArray, f_high: FloatArray) -> FloatArray:
    """Return the zero of the straight line through both ends, the middle where it has none."""
    finite = np.isfinite(f_low) & np.isfinite(f_high)
    part = np.full(len(low), 0.5)
    part[finite] = f_low[finite] / (f_low[finite] - f_high[finite])
    return low + part * (high - low)
