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

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from lis_grasp.exceptions import EstimationError
from lis_grasp.surfaces.patch_segmentation import REACH, ContactPairs
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

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


@dataclass(frozen=True, slots=True, eq=False)
class Meetings:
    """Contacts i, j of two patches that meet at an edge, each pair in both directions.

    Parameters
    ----------
    first, second
        Shape (E,), i and j.
    kind
        Shape (E,): -1 for a convex edge, 1 for a concave one.
    patches
        Shape (N,), the patch of each contact, of K.
    """

    first: IndexArray
    second: IndexArray
    kind: IndexArray
    patches: IndexArray

    @classmethod
    def of(cls, pairs: ContactPairs, patches: IndexArray, spacing: float) -> Meetings:
        """Find them among pairs of contacts."""
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
        first, second = pairs.first[edge], pairs.second[edge]
        kind = np.where(convex[edge], -1, 1)
        return cls(
            np.concatenate([first, second]),
            np.concatenate([second, first]),
            np.concatenate([kind, kind]),
            patches,
        )

    def asked_for(self) -> BoolArray:
        """Return of which patches formulas ask the values at contacts of each patch, shape (K, K).

        Of those that may cut it; and of those that it meets concavely, and what may cut them.
        """
        cutting = self._between(self.kind < 0) | self.mostly_convex()
        concave = self._between(self.kind > 0)
        pieces = concave.astype(np.float32) @ cutting.astype(np.float32)
        return cutting | concave | (pieces > 0.0)

    def mostly_convex(self) -> BoolArray:
        """Return which patches meet at more convex pairs than concave ones, shape (K, K)."""
        votes = np.zeros((self._count, self._count))
        np.add.at(votes, (self.patches[self.first], self.patches[self.second]), -self.kind)
        return votes > 0

    def _between(self, chosen: BoolArray) -> BoolArray:
        between = np.zeros((self._count, self._count), dtype=bool)
        between[self.patches[self.first[chosen]], self.patches[self.second[chosen]]] = True
        return between

    @property
    def _count(self) -> int:
        return int(self.patches.max()) + 1


def compose_formulas(
    pairs: ContactPairs, meetings: Meetings, values: FloatArray, spacing: float
) -> list[Formula]:
    """Return the formula of each contact, N of them.

    Parameters
    ----------
    pairs
        Contacts within reach of each other.
    meetings
        Those at edges.
    values
        Shape (N, K) [m], the function of each patch at each contact, as `Meetings.asked_for`.
    spacing
        Of the contacts [m].

    Raises
    ------
    EstimationError
        If contacts contradict each other so much that nearly all patches cut nearly all others.
    """
    patches = meetings.patches
    contacts = np.arange(len(patches))
    witnesses = _same_patch_within_reach(pairs, patches)

    cuts = _convex_cuts(meetings, values, spacing)
    cuts &= ~_any_witness(witnesses, values > _WITNESS * spacing)
    cuts[contacts, patches] = True
    pieces = [tuple(row) for row in _true_columns(cuts)]

    distinct = sorted(set(pieces))
    number = {piece: k for k, piece in enumerate(distinct)}
    own = np.array([number[piece] for piece in pieces])
    concave = meetings.kind > 0
    joined = np.zeros((len(patches), len(distinct)), dtype=bool)
    joined[meetings.first[concave], own[meetings.second[concave]]] = True
    buried = _below(distinct, joined, patches, values, -_WITNESS * spacing)
    joined &= ~_any_witness(witnesses, buried)
    joined[contacts, own] = False
    terms = int(joined.sum()) + sum(map(len, distinct))
    if terms > _MOST_TERMS:
        raise EstimationError(
            f"{len(patches)} contacts contradict each other: their patches meet in {terms} ways,"
            f" more than {_MOST_TERMS}: see whether each normal belongs to its point, and tell the"
            " noise"
        )
    return [
        (piece, *(distinct[k] for k in others))
        for piece, others in zip(pieces, _true_columns(joined), strict=True)
    ]


def _convex_cuts(meetings: Meetings, values: FloatArray, spacing: float) -> BoolArray:
    """Return which patches may cut the patch of each contact, shape (N, K).

    Those of convex partners; and those that a contact's patch meets convexly elsewhere, if their
    surface runs below the contact within reach: an edge goes on where nobody touched both sides.
    """
    cuts = np.zeros(values.shape, dtype=bool)
    convex = meetings.kind < 0
    cuts[meetings.first[convex], meetings.patches[meetings.second[convex]]] = True
    within = (values < _CLEAR * spacing) & (values > -REACH * spacing)
    return cuts | (meetings.mostly_convex()[meetings.patches] & within)


def _below(
    pieces: list[Piece], joined: BoolArray, patches: IndexArray, values: FloatArray, height: float
) -> BoolArray:
    """Return whether contacts lie lower than a height in pieces, shape (N, pieces).

    Asked where a piece is joined to a contact of the same patch; False elsewhere.
    """
    below = np.zeros(joined.shape, dtype=bool)
    for k in np.flatnonzero(joined.any(axis=0)):
        rows = np.flatnonzero(np.isin(patches, patches[joined[:, k]]))
        below[rows, k] = values[np.ix_(rows, np.array(pieces[k]))].max(axis=1) < height
    return below


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
    spoken = (witnesses @ csr_array(against, dtype=np.float64)) > 0.0
    return np.asarray(spoken.toarray())


def _true_columns(rows: BoolArray) -> list[list[int]]:
    """Return the columns that are true, ascending, of each row."""
    _, columns = np.nonzero(rows)
    ends = np.cumsum(np.count_nonzero(rows, axis=1))
    return [part.tolist() for part in np.split(columns, ends[:-1])]
