"""CSG expressions of patches: the union (min) of intersections (max) round each contact.

A convex edge is an intersection of two solids, the maximum of both patches' functions. A concave
edge is a union, the minimum. So the solid round contact i is a union of intersections: the minimum
over terms of the maximum over patches. The contact's own term is its patch, cut by the patches that
it meets at convex edges. Further terms come from contacts across concave edges.

Two tests exclude distant patches. Both contacts of a pair must be near the line in which their
tangent planes meet. And every contact is a point of the surface: no patch may cut off a supporting
contact (a neighbour on the same patch), and no term may bury one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces._patch_segmentation import REACH, ContactPairs
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

Float32Array = npt.NDArray[np.float32]

Intersection = tuple[int, ...]
"""Patches whose functions' maximum is taken, ascending."""

Expression = tuple[Intersection, ...]
"""Intersections whose minimum is taken, the contact's own first."""

# Heights in spacings: what counts as below or above, and the error of a supporting contact.
_CLEAR = 0.01
_SUPPORT_ERROR = 0.1

# More terms fit no object and take minutes. 400 touches of solids make 60 to 190, 2000 noisy 6000.
_MOST_TERMS = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class EdgePairs:
    """Pairs of contacts of two patches, on either side of an edge, in both directions."""

    first: IndexArray  # (E,) i
    second: IndexArray  # (E,) j
    kind: IndexArray  # (E,): -1 for a convex edge, 1 for a concave one
    patches: IndexArray  # (N,) the patch of each contact, of K

    @classmethod
    def of(cls, pairs: ContactPairs, patches: IndexArray, spacing: float) -> EdgePairs:
        """Return the pairs of contacts that are on either side of a convex or concave edge."""
        lowest = np.minimum(pairs.heights, pairs.back_heights)
        highest = np.maximum(pairs.heights, pairs.back_heights)
        # In the tangent plane of i, contact i is |y_j(c_i)| / sin(bend) away from the common line.
        heights = np.maximum(np.abs(lowest), np.abs(highest))
        near = heights < REACH * spacing * np.sin(pairs.bends)
        near |= np.isclose(pairs.bends, np.pi)  # the two sides of a plate have no such line
        near &= patches[pairs.first] != patches[pairs.second]
        # A contact on the very edge is level with the other plane: one of both must be clear of it.
        clear = _CLEAR * spacing
        convex = near & (lowest < -clear) & (highest < clear)
        concave = near & (highest > clear) & (lowest > -clear)
        edge = np.flatnonzero(convex | concave)
        first, second = pairs.first[edge], pairs.second[edge]
        kind = np.where(convex[edge], -1, 1)
        return cls(
            np.concatenate([first, second]),
            np.concatenate([second, first]),
            np.concatenate([kind, kind]),
            patches,
        )

    def mostly_convex(self) -> BoolArray:
        """Return which patches meet at more convex pairs than concave ones, shape (K, K)."""
        votes = np.zeros((self._count, self._count))
        np.add.at(votes, (self.patches[self.first], self.patches[self.second]), -self.kind)
        return votes > 0

    @property
    def _count(self) -> int:
        return int(self.patches.max()) + 1


def build_expressions(
    pairs: ContactPairs, edges: EdgePairs, values: FloatArray, spacing: float
) -> list[Expression]:
    """Return the CSG expression of each contact, N of them.

    `values` (N, K) [m] are the functions of patches at contacts. EstimationError if contacts
    contradict each other so much that nearly all patches cut nearly all others.
    """
    patches = edges.patches
    contacts = np.arange(len(patches))
    support = _same_patch_within_reach(pairs, patches)

    cuts = _convex_cuts(edges, values, spacing)
    cuts &= ~_any_supporting(support, values > _SUPPORT_ERROR * spacing)
    cuts[contacts, patches] = True
    own_terms = [tuple(row) for row in _true_columns(cuts)]

    distinct = sorted(set(own_terms))
    number = {term: k for k, term in enumerate(distinct)}
    own = np.array([number[term] for term in own_terms])
    concave = edges.kind > 0
    joined = np.zeros((len(patches), len(distinct)), dtype=bool)
    joined[edges.first[concave], own[edges.second[concave]]] = True
    buried = _below(distinct, joined, patches, values, -_SUPPORT_ERROR * spacing)
    joined &= ~_any_supporting(support, buried)
    joined[contacts, own] = False
    size = int(joined.sum()) + sum(map(len, distinct))
    if size > _MOST_TERMS:
        raise EstimationError(
            f"{len(patches)} contacts contradict each other: their patches meet in {size} ways,"
            f" more than {_MOST_TERMS}: check whether each normal belongs to its point, and give"
            " the noise"
        )
    return [
        (term, *(distinct[k] for k in others))
        for term, others in zip(own_terms, _true_columns(joined), strict=True)
    ]


def _convex_cuts(edges: EdgePairs, values: FloatArray, spacing: float) -> BoolArray:
    """Return which patches may cut the patch of each contact, shape (N, K).

    Those of its convex pairs; and those that its patch meets at convex edges elsewhere, if their
    surface is below the contact and within reach.
    """
    cuts = np.zeros(values.shape, dtype=bool)
    convex = edges.kind < 0
    cuts[edges.first[convex], edges.patches[edges.second[convex]]] = True
    within = (values < _CLEAR * spacing) & (values > -REACH * spacing)
    return cuts | (edges.mostly_convex()[edges.patches] & within)


def _below(
    terms: list[Intersection],
    joined: BoolArray,
    patches: IndexArray,
    values: FloatArray,
    height: float,
) -> BoolArray:
    """Return which contacts are below a height in terms joined to their patch, (N, terms)."""
    below = np.zeros(joined.shape, dtype=bool)
    for k in np.flatnonzero(joined.any(axis=0)):
        rows = np.flatnonzero(np.isin(patches, patches[joined[:, k]]))
        below[rows, k] = values[np.ix_(rows, np.array(terms[k]))].max(axis=1) < height
    return below


def _same_patch_within_reach(pairs: ContactPairs, patches: IndexArray) -> Float32Array:
    """Return 1 for the supporting contacts of each, (N, N): itself, neighbours on its patch."""
    same = patches[pairs.first] == patches[pairs.second]
    first, second = pairs.first[same], pairs.second[same]
    support = np.eye(len(patches), dtype=np.float32)
    support[first, second] = support[second, first] = 1.0
    return support


def _any_supporting(support: Float32Array, flags: BoolArray) -> BoolArray:
    """Return where any supporting contact of a contact is True in `flags`, shape (N, K) both."""
    found = np.zeros_like(flags)
    some = np.flatnonzero(flags.any(axis=0))
    found[:, some] = support @ flags[:, some].astype(np.float32) > 0.0
    return found


def _true_columns(rows: BoolArray) -> list[list[int]]:
    """Return the columns that are true, ascending, of each row."""
    _, columns = np.nonzero(rows)
    ends = np.cumsum(np.count_nonzero(rows, axis=1))
    return [part.tolist() for part in np.split(columns, ends[:-1])]


def solid_values(expressions: Sequence[Expression], values: FloatArray) -> FloatArray:
    """Return the value of each of E expressions at P points, (E, P), from patches' values (K, P).

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
