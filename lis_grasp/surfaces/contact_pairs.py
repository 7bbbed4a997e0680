"""Pairs of neighbouring contacts: distances, heights above each other's tangent planes, bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.typing import FloatArray, IndexArray

# Largest distance of a pair of contacts, in spacings.
REACH = 2.6

# Contacts nearer than this, in spacings, with normals that agree this well, are at one place.
_SAME_PLACE = 0.3
_LIKE_NORMAL = np.cos(np.deg2rad(30.0))


@dataclass(frozen=True, slots=True, eq=False)
class ContactPairs:
    """Pairs of contacts i < j within reach of each other, P of them, and their relative pose."""

    first: IndexArray  # (P,) index i
    second: IndexArray  # (P,) index j
    weights: FloatArray  # (P,) of their evidence: one over the pairs between the same two places
    distances: FloatArray  # (P,) [m]
    heights: FloatArray  # (P,) [m], y_i(c_j)
    back_heights: FloatArray  # (P,) [m], y_j(c_i)
    bends: FloatArray  # (P,) [rad], the angle between both normals

    @classmethod
    def within(cls, points: FloatArray, normals: FloatArray, spacing: float) -> ContactPairs:
        """Find the pairs within 2.6 spacings [m] of each other, in order of their indices."""
        pairs = cKDTree(points).query_pairs(REACH * spacing, output_type="ndarray")
        first, second = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
        offsets = points[second] - points[first]
        distances = np.linalg.norm(offsets, axis=1)
        crosses = np.linalg.norm(np.cross(normals[first], normals[second]), axis=1)
        cosines = np.einsum("pk,pk->p", normals[first], normals[second])
        # Contacts at one place with like normals repeat each other's evidence.
        alike = (distances < _SAME_PLACE * spacing) & (cosines > _LIKE_NORMAL)
        ends = np.concatenate([first[alike], second[alike]])
        crowd = 1.0 + np.bincount(ends, minlength=len(points))
        return cls(
            first=first,
            second=second,
            weights=1.0 / (crowd[first] * crowd[second]),
            distances=distances,
            heights=np.einsum("pk,pk->p", offsets, normals[first]),
            back_heights=-np.einsum("pk,pk->p", offsets, normals[second]),
            bends=np.arctan2(crosses, cosines),
        )
