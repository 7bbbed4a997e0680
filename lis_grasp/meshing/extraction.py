"""Mesh extraction from implicit surfaces by manifold dual contouring."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree
from trimesh.graph import connected_component_labels

from lis_grasp.exceptions import EstimationError, InvalidOptionError
from lis_grasp.guesses import with_advice
from lis_grasp.meshing._band import COARSE, sample_band
from lis_grasp.meshing._dual_contouring import contour
from lis_grasp.meshing._grid import Field, Grid
from lis_grasp.meshing._hermite import find_crossings
from lis_grasp.shapes.mesh_distance import winding_numbers
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp.underflow import underflows

# Default number of cells along the largest extent.
CELLS = 64

# A gigabyte of values.
_MAX_NODES = 2**27

# The main body is the part with most of the best supported vertices, this fraction of all.
_BEST = 0.1

# A part whose surface is known to this fraction of a cell has contacts of its own.
_KNOWN = 0.25


@underflows
@with_advice
def extract_mesh(
    surface: ImplicitSurface,
    *,
    bounds: npt.ArrayLike | None = None,
    resolution: float | None = None,
    touched: npt.ArrayLike | None = None,
) -> trimesh.Trimesh:
    """Mesh the zero set of an implicit surface: closed, manifold, outward, sharp edges kept.

    Manifold dual contouring of Hermite data (Ju, Losasso, Schaefer and Warren 2002; Schaefer, Ju
    and Warren 2007). The bounds close a surface that reaches them. Self-intersections are possible
    where sheets are closer together than a cell. A feature thinner than four cells may be missed.

    Parameters
    ----------
    surface
        The estimate.
    bounds
        Shape (2, 3) [m], lowest and highest corner of the box to mesh in, in O; None takes the
        surface's own.
    resolution
        Side of a cell [m]; None takes 1/64 of the largest extent of the bounds.
    touched
        Positions of the contacts, shape (N, 3) [m]: closed parts that are nearest to no contact are
        dropped. None judges by uncertainty alone.

    Returns
    -------
    trimesh.Trimesh
        In O [m], with `vertex_attributes["uncertainty"]`, shape (V,) [m]. `metadata` counts the
        "evaluations" and "gradients", "grid_nodes" of a full grid, and "dropped" closed parts.
        Where the bounds cut the estimate, its depth there is part of the uncertainty.

    Raises
    ------
    InvalidOptionError
        If bounds or resolution are not usable.
    EstimationError
        If there is no surface within the bounds, or none as large as a cell, or the function is not
        a number somewhere.

    Examples
    --------
    >>> mesh = extract_mesh(estimate(contacts, "gpis"), resolution=0.004)
    >>> mesh.is_watertight
    True
    """
    if not hasattr(surface, "evaluate"):
        required = "surface must be an ImplicitSurface, such as estimate(contacts)"
        raise TypeError(f"{required}; it is of type {type(surface).__name__}")
    box = _checked_bounds(surface.bounds if bounds is None else bounds)
    grid = _checked_grid(box, resolution)
    field = Field(surface)
    values = sample_band(field, grid)
    _require_surface(field, grid, values)
    vertices, faces = contour(values < 0.0, find_crossings(field, grid, values), grid)
    uncertainty = field.uncertainty(vertices)
    part = connected_component_labels(np.concatenate([faces[:, :2], faces[:, 1:]]), len(vertices))
    kept = _supported_parts(vertices, part, uncertainty, grid.cell)
    if touched is not None and len(kept) > 1:
        nearest = cKDTree(vertices).query(np.asarray(touched, dtype=np.float64).reshape(-1, 3))[1]
        own = kept & np.isin(np.arange(len(kept)), part[nearest])
        kept = own if own.any() else kept
    if not kept.all():
        kept = _with_their_solids(kept, vertices, faces, part)
    cut = np.flatnonzero(np.isclose(vertices, box[:, None]).any(axis=(0, 2)))
    if len(cut):
        depths = np.zeros(len(vertices))
        depths[cut] = np.minimum(field.values(vertices[cut]), 0.0)
        uncertainty = np.hypot(uncertainty, depths)
    faces = faces[kept[part[faces[:, 0]]]]
    if np.linalg.det(vertices[faces] - vertices[faces].mean(axis=(0, 1))).sum() <= 0.0:
        raise EstimationError(
            f"the inside is smaller than the cells of {grid.cell:g} m: mesh with smaller cells,"
            " or touch the object more"
        )
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    faces = (np.cumsum(used) - 1)[faces]
    # process=False: vertices stay in their order and are not merged.
    return trimesh.Trimesh(
        vertices[used],
        faces,
        process=False,
        vertex_attributes={"uncertainty": uncertainty[used]},
        metadata={
            "evaluations": field.evaluations,
            "gradients": field.gradients,
            "grid_nodes": values.size,
            "dropped": int(len(kept) - kept.sum()),
        },
    )


def _checked_bounds(bounds: npt.ArrayLike) -> FloatArray:
    box = np.array(bounds, dtype=np.float64)
    if box.shape != (2, 3) or not np.isfinite(box).all() or not (box[0] < box[1]).all():
        raise InvalidOptionError(
            "bounds must be the lowest and the highest corner of a box, finite, shape (2, 3);"
            f" they are {box.tolist()}",
            option="bounds",
            value=bounds,
        )
    return box


def _checked_grid(box: FloatArray, resolution: float | None) -> Grid:
    extent = box[1] - box[0]
    cell = float(extent.max()) / CELLS if resolution is None else float(resolution)
    if not (np.isfinite(cell) and cell > 0.0):
        raise InvalidOptionError.out_of_range("resolution", resolution, "above 0 and finite [m]")
    if np.prod(extent / cell + 2.0 + COARSE) > _MAX_NODES:
        least = float(np.cbrt(np.prod(extent) / _MAX_NODES))
        required = f"above about {least:.2g} m in bounds of {extent} m, to fit in memory"
        raise InvalidOptionError.out_of_range("resolution", cell, required)
    return Grid.cover(box, cell, multiple=COARSE)


def _corners(grid: Grid) -> str:
    """Return the corners of a grid's bounds in words."""
    return " to ".join(f"({', '.join(f'{x:.3g}' for x in corner)}) m" for corner in grid.bounds)


def _require_surface(field: Field, grid: Grid, values: FloatArray) -> None:
    """Refuse a function that has one sign only, within the bounds and beside them."""
    if not (values < 0.0).any():
        raise EstimationError(
            f"the surface has no inside within the bounds {_corners(grid)} at cells of"
            f" {grid.cell:.3g} m: mesh other bounds or smaller cells, or touch the object more"
        )
    within = grid.within_bounds()
    if (values[within] >= 0.0).any():
        return
    beside = np.zeros_like(within)
    beside[::COARSE, ::COARSE, ::COARSE] = True
    if (field.values(grid.positions(np.flatnonzero(beside & ~within))) < 0.0).all():
        raise EstimationError(
            f"the surface has no outside within the bounds {_corners(grid)}: mesh larger"
            " bounds, or check that the contacts' normals point out of the object"
        )


def _supported_parts(
    vertices: FloatArray, part: IndexArray, uncertainty: FloatArray, cell: float
) -> BoolArray:
    """Return which parts of a closed, outward mesh are supported, (P,).

    A phantom part, far from all contacts, is not: its least uncertainty exceeds a quarter of a cell
    [m], and the median of the main body's. `part` and `uncertainty` are of vertices, (V,).
    """
    count = int(part.max()) + 1
    # method="lower": an uncertainty may be infinite.
    best_supported = uncertainty <= np.quantile(uncertainty, _BEST, method="lower")
    main = int(np.argmax(np.bincount(part[best_supported], minlength=count)))
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, part, uncertainty)
    typical = np.quantile(uncertainty[part == main], 0.5, method="lower")
    return np.asarray(lowest <= max(typical, _KNOWN * cell))


def _with_their_solids(
    supported: BoolArray, vertices: FloatArray, faces: IndexArray, part: IndexArray
) -> BoolArray:
    """Return the supported parts, and the solids round supported cavities."""
    corners = vertices[faces]  # (F, 3, 3)
    owner = part[faces[:, 0]]
    volumes = np.bincount(owner, np.linalg.det(corners - vertices.mean(axis=0)) / 6.0)
    low, high = np.full((len(volumes), 3), np.inf), np.full((len(volumes), 3), -np.inf)
    np.minimum.at(low, part, vertices)
    np.maximum.at(high, part, vertices)
    kept = supported.copy()
    by_size = np.argsort(-np.abs(volumes), kind="stable")
    for this in by_size[supported[by_size]]:
        # The parts round this one, the outermost first: those round a point are nested.
        probe = vertices[np.argmax(part == this)]
        boxed = ((low < probe) & (probe < high)).all(axis=1)
        boxed[this] = False
        around = [
            other
            for other in by_size[boxed[by_size]]
            if abs(winding_numbers(probe[None], vertices, faces[owner == other])[0]) > 0.5
        ]
        outer = [other for other in around if kept[other]]
        in_material = bool(outer) and volumes[outer[-1]] > 0.0
        faces_out = volumes[this] > 0.0
        if faces_out == in_material and around:
            kept[around[-1]] = True
    return kept
