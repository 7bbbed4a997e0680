"""How patches meet: the formula of maxima and minima that a solid is made of round each contact.

At a convex edge the outside of either patch is outside: the larger function wins. At a concave one
the inside of either is inside: the smaller wins. So round contact i the solid is a union of
intersections, min over pieces of max over patches: its own piece is its patch, cut by the patches
that it meets convexly; further pieces are those of contacts that it meets concavely.

Two tests keep far-off patches from cutting where they have no business. Both contacts of a pair
must lie near the line in which their tangent planes meet. And contacts are witnesses: each is a
point of the surface, so no patch may cut one of its neighbours off, nor a piece bury one.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.patches import REACH, ContactPairs

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

Piece = tuple[int, ...]
"""Patches whose functions' maximum is taken, ascending."""

Formula = tuple[Piece, ...]
"""Pieces whose functions' minimum is taken, the contact's own first."""

# Below this angle between normals two patches have no edge in common [rad].
_LEAST_EDGE = np.deg2rad(21.0)

# Planes this near to parallel (sine of the angle) have no line in common worth looking for.
_PARALLEL = 0.2

# Heights in spacings: what counts as below or above, and how far a witness may be off.
_CLEAR = 0.01
_WITNESS = 0.1

# Formulas of more terms (patches of a piece, pieces of a contact) are no object's, and would take
# minutes: 400 touches of solids have 60 to 190, 2000 so noisy that they make 992 patches 6000.
_MOST_TERMS = 200_000


def meeting_contacts(
    pairs: ContactPairs, patches: IndexArray, spacing: float
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Return contacts i, j of two patches that meet at an edge, and its kind, shape (E,) each.

    The kind is -1 for convex, 1 for concave. Each pair comes in both directions.
    """
    sines = np.sin(pairs.bends)
    parallel = sines < _PARALLEL
    lowest = np.minimum(pairs.heights, pairs.back_heights)
    highest = np.maximum(pairs.heights, pairs.back_heights)
    # In the tangent plane of i, contact i lies |y_j(c_i)| / sin(bend) from the common line.
    to_line = np.maximum(np.abs(lowest), np.abs(highest)) / np.where(parallel, 1.0, sines)
    near = np.where(parallel, pairs.bends > 0.5 * np.pi, to_line < REACH * spacing)
    near &= (patches[pairs.first] != patches[pairs.second]) & (pairs.bends > _LEAST_EDGE)
    # A contact on the very edge is level with the other plane: one of both must be clear of it.
    clear = _CLEAR * spacing
    convex = near & (lowest < -clear) & (highest < clear)
    concave = near & (highest > clear) & (lowest > -clear)
    edge = np.flatnonzero(convex | concave)
    first, second, kind = pairs.first[edge], pairs.second[edge], np.where(convex[edge], -1, 1)
    return (
        np.concatenate([first, second]),
        np.concatenate([second, first]),
        np.concatenate([kind, kind]),
    )


def compose_formulas(
    pairs: ContactPairs,
    patches: IndexArray,
    values: FloatArray,
    spacing: float,
) -> list[Formula]:
    """Return the formula of each contact, N of them.

    Parameters
    ----------
    pairs
        Contacts within reach of each other.
    patches
        Shape (N,), the patch of each contact.
    values
        Shape (N, K) [m], the function of each patch at each contact.
    spacing
        Of the contacts [m].

    Raises
    ------
    EstimationError
        If contacts contradict each other so much that nearly all patches cut nearly all others.
    """
    first, second, kind = meeting_contacts(pairs, patches, spacing)
    witnesses = _same_patch_within_reach(pairs, patches)

    cuts = _convex_cuts(first, second, kind, patches, values, spacing)
    cuts &= ~_any_witness(witnesses, values > _WITNESS * spacing)
    cuts[np.arange(len(patches)), patches] = True
    pieces = [tuple(int(q) for q in np.flatnonzero(row)) for row in cuts]

    distinct = sorted(set(pieces))
    number = {piece: k for k, piece in enumerate(distinct)}
    own = np.array([number[piece] for piece in pieces])
    heights = np.stack([values[:, piece].max(axis=1) for piece in distinct], axis=1)  # (N, pieces)
    joined = np.zeros(heights.shape, dtype=bool)
    joined[first[kind > 0], own[second[kind > 0]]] = True
    joined &= ~_any_witness(witnesses, heights < -_WITNESS * spacing)
    joined[np.arange(len(patches)), own] = False
    terms = int(joined.sum()) + sum(map(len, distinct))
    if terms > _MOST_TERMS:
        raise EstimationError(
            f"{len(patches)} contacts contradict each other: their patches meet in {terms} ways,"
            f" more than {_MOST_TERMS}: see whether each normal belongs to its point, and tell the"
            " noise"
        )
    return [
        (pieces[i], *(distinct[k] for k in np.flatnonzero(joined[i]))) for i in range(len(patches))
    ]


def _convex_cuts(
    first: IndexArray,
    second: IndexArray,
    kind: IndexArray,
    patches: IndexArray,
    values: FloatArray,
    spacing: float,
) -> BoolArray:
    """Return which patches may cut the patch of each contact, shape (N, K).

    Those of convex partners; and those that a contact's patch meets convexly elsewhere, if their
    surface runs below the contact within reach: an edge goes on where nobody touched both sides.
    """
    cuts = np.zeros(values.shape, dtype=bool)
    cuts[first[kind < 0], patches[second[kind < 0]]] = True
    votes = np.zeros((values.shape[1], values.shape[1]))
    np.add.at(votes, (patches[first], patches[second]), -kind)
    within = (values < _CLEAR * spacing) & (values > -REACH * spacing)
    return cuts | ((votes > 0)[patches] & within)


def _same_patch_within_reach(pairs: ContactPairs, patches: IndexArray) -> csr_array:
    """Return who may witness for whom, shape (N, N): oneself, and near contacts of one's patch."""
    same = patches[pairs.first] == patches[pairs.second]
    first, second, own = pairs.first[same], pairs.second[same], np.arange(len(patches))
    rows = np.concatenate([first, second, own])
    columns = np.concatenate([second, first, own])
    count = len(patches)
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))


def _any_witness(witnesses: csr_array, against: BoolArray) -> BoolArray:
    """Return whether any witness of a contact speaks against, shape (N, K) from (N, K)."""
    return np.asarray(witnesses @ against.astype(np.float64)) > 0.0
