"""First segmentation of contacts into smooth patches, from the evidence of pairs.

Two contacts i, j on one circular arc are equally deep below each other's tangent planes: the
asymmetry |y_i(c_j) - y_j(c_i)| / |c_j - c_i| is 0 on planes, spheres and cylinders, whatever the
angle between the normals, and small where curvature changes slowly. Across an edge it is 0 only if
both contacts are by chance equally far from it. One pair does not distinguish a bend from an edge;
all pairs between two groups of contacts nearly always do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp.surfaces.contact_merging import SMALLEST
from lis_grasp.surfaces.contact_pairs import ContactPairs
from lis_grasp.typing import FloatArray, IndexArray

# Asymmetry of pairs on one smooth surface and across an edge (one standard deviation, without
# noise), and the limit of a pair's log odds: neighbouring pairs are not independent.
_ASYMMETRY = 0.08
_EDGE_ASYMMETRY = 0.6
_PAIR_LIMIT = 2.0

# Prior log odds of one patch for neighbours, and their slope with the angle of normals [1/rad].
_PRIOR = 2.5
_PRIOR_SLOPE = 12.0 / np.pi

# Normals that differ by more give no evidence of a common arc: contacts placed symmetrically about
# an edge have no asymmetry either. Patches that this leaves apart may still merge by evidence.
_MAX_BEND = np.deg2rad(60.0)


def cluster_pairs(
    pairs: ContactPairs, position_noise: FloatArray, normal_noise: FloatArray
) -> IndexArray:
    """Return the patch of each contact, shape (N,): 0 for the first contact's, and so on.

    Agglomerative clustering: the likeliest pairs of patches merge first, as long as one smooth
    surface is likelier than an edge between them. The log odds of a pair are those of its
    asymmetry, normally distributed in both cases, but several times wider across an edge. Noise,
    (N,), is one standard deviation of contacts along their normals [m] and of the normals [rad].
    """
    count = len(position_noise)
    apart = pairs.distances > SMALLEST
    distances = np.where(apart, pairs.distances, 1.0)
    asymmetry = np.abs(pairs.heights - pairs.back_heights) / distances
    # Both heights of a pair err by its normals, and by its positions with opposite signs.
    positions = position_noise[pairs.first] ** 2 + position_noise[pairs.second] ** 2
    turns = normal_noise[pairs.first] ** 2 + normal_noise[pairs.second] ** 2
    variance = _ASYMMETRY**2 + turns + 4.0 * positions / distances**2
    across = variance + _EDGE_ASYMMETRY**2
    odds = 0.5 * np.log(across / variance) - 0.5 * asymmetry**2 * (1.0 / variance - 1.0 / across)
    odds = pairs.weights * np.clip(odds, -_PAIR_LIMIT, _PAIR_LIMIT)
    usable = apart & (pairs.bends < _MAX_BEND)
    borders = _Borders(pairs.first[usable], pairs.second[usable], odds[usable], pairs.bends[usable])
    patches = np.arange(count)
    while True:
        borders = borders.between_patches(count)
        renamed = borders.mutual_mergers(count)
        if renamed is None:
            _, starts, inverse = np.unique(patches, return_index=True, return_inverse=True)
            return np.argsort(np.argsort(starts))[inverse]
        patches = renamed[patches]
        borders = _Borders(renamed[borders.low], renamed[borders.high], borders.odds, borders.bends)


@dataclass(frozen=True, slots=True, eq=False)
class _Borders:
    """Borders between patches, with the evidence of the pairs across each."""

    low: IndexArray  # (B,) one patch of each border
    high: IndexArray  # (B,) the other
    odds: FloatArray  # (B,) log odds of its pairs, added up
    bends: FloatArray  # (B,) [rad], the least angle between normals of a pair

    def between_patches(self, count: int) -> _Borders:
        """Return each border once, with the sum of its evidence, without those within a patch."""
        low, high = np.minimum(self.low, self.high), np.maximum(self.low, self.high)
        apart = low < high
        keys = (low * count + high)[apart]
        if not len(keys):
            return _Borders(keys, keys, np.empty(0), np.empty(0))
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
        return _Borders(
            keys[starts] // count,
            keys[starts] % count,
            np.add.reduceat(self.odds[apart][order], starts),
            np.minimum.reduceat(self.bends[apart][order], starts),
        )

    def mutual_mergers(self, count: int) -> IndexArray | None:
        """Merge patches that are each other's likeliest partner; return new numbers, (count,).

        None if no two patches should be merged.
        """
        totals = self.odds + _PRIOR - _PRIOR_SLOPE * self.bends
        best = np.zeros(count)
        np.maximum.at(best, self.low, totals)
        np.maximum.at(best, self.high, totals)
        mutual = (totals > 0.0) & (totals == best[self.low]) & (totals == best[self.high])
        if not mutual.any():
            return None
        # Ties: a patch merges once a round, with the partner of lowest index.
        renamed = np.arange(count)
        taken = np.zeros(count, dtype=bool)
        for a, b in zip(self.low[mutual], self.high[mutual], strict=True):
            if not taken[a] and not taken[b]:
                taken[a] = taken[b] = True
                renamed[b] = a
        return renamed
