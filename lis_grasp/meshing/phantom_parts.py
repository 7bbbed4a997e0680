"""Removal of phantom parts of a mesh: closed parts that no contact supports.

An estimator may be zero far from all contacts. A part of the mesh is dropped if its least
uncertainty exceeds the median of the main body's.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lis_grasp.shapes.winding_number import winding_numbers
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

# The main body is the part with most of the best supported vertices, this fraction of all.
_BEST = 0.1


def supported_faces(vertices: FloatArray, faces: IndexArray, uncertainty: FloatArray) -> BoolArray:
    """Return which triangles (F, 3) of a closed, outward mesh belong to supported parts, (F,).

    A cavity, whose triangles face inward, is kept or dropped like any other part. The solid round
    a kept cavity is kept with it. `uncertainty` (V,) [m] is that of the surface at each vertex.
    """
    count, part = _parts(len(vertices), faces)
    if count == 1:
        return np.ones(len(faces), dtype=bool)
    # method="lower": an uncertainty may be infinite.
    best_supported = uncertainty <= np.quantile(uncertainty, _BEST, method="lower")
    main = int(np.argmax(np.bincount(part[best_supported], minlength=count)))
    lowest = np.full(count, np.inf)
    np.minimum.at(lowest, part, uncertainty)
    supported = lowest <= np.quantile(uncertainty[part == main], 0.5, method="lower")
    if not supported.all():
        supported = _with_their_solids(supported, vertices, faces, part)
    return np.asarray(supported[part[faces[:, 0]]])


def _parts(vertices: int, faces: IndexArray) -> tuple[int, IndexArray]:
    """Return the number of connected parts, and the part of each vertex."""
    first, second = faces.reshape(-1), np.roll(faces, 1, axis=1).reshape(-1)
    links = coo_array(
        (np.ones(len(first), dtype=bool), (first, second)), shape=(vertices, vertices)
    )
    count, part = connected_components(links, directed=False)
    return int(count), part.astype(np.intp)


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
