"""Values of CSG expressions, and the patches that make them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lis_grasp.surfaces._patch_csg import Expression, Intersection
from lis_grasp.typing import FloatArray, IndexArray


def solid_values(expressions: Sequence[Expression], values: FloatArray) -> FloatArray:
    """Return the value of each of E expressions at P points, (E, P), from those of patches (K, P).

    The smallest over the expression's intersections of the largest over their patches.
    """
    heights = _heights(expressions, values)
    return np.stack(
        [_extreme(np.minimum, [heights[term] for term in each]) for each in expressions]
    )


def active_patches(expressions: Sequence[Expression], values: FloatArray) -> IndexArray:
    """Return the patch that makes each of E expressions at P points, (E, P); ties to the first.

    It is the largest patch of the smallest intersection. Patches have the values (K, P).
    """
    heights = _heights(expressions, values)
    largest = {term: _first(term, values[list(term)], height) for term, height in heights.items()}
    active = np.empty((len(expressions), values.shape[1]), dtype=np.intp)
    for row, each in enumerate(expressions):
        lowest = _extreme(np.minimum, [heights[term] for term in each])
        active[row] = largest[each[-1]]
        for term in reversed(each[:-1]):
            np.copyto(active[row], largest[term], where=heights[term] == lowest)
    return active


def _heights(
    expressions: Sequence[Expression], values: FloatArray
) -> dict[Intersection, FloatArray]:
    """Return the value of each intersection, (P,)."""
    terms = {term for each in expressions for term in each}
    return {term: _extreme(np.maximum, [values[p] for p in term]) for term in terms}


def _extreme(function: np.ufunc, rows: list[FloatArray]) -> FloatArray:
    """Return the extreme of rows, (P,)."""
    return rows[0] if len(rows) == 1 else np.asarray(function.reduce(rows))


def _first(patches: Intersection, rows: FloatArray, height: FloatArray) -> IndexArray:
    """Return the first of patches whose row has the height, (P,)."""
    found = np.full(len(height), patches[-1])
    for p, row in reversed(list(zip(patches[:-1], rows[:-1], strict=True))):
        found[row == height] = p
    return found
