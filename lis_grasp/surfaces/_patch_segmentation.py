"""Segmentation of contacts into smooth patches, by marginal likelihood.

Pairs of neighbouring contacts give a first segmentation. Two contacts i, j on one circular arc are
equally deep below each other's tangent planes: the asymmetry |y_i(c_j) - y_j(c_i)| / |c_j - c_i| is
0 on planes, spheres and cylinders, whatever the angle between the normals, and small where
curvature changes slowly. Across an edge it is 0 only if both contacts are by chance equally far
from it. One pair does not distinguish a bend from an edge; all pairs between two groups of contacts
nearly always do.

Then every patch is a plane or a Gaussian process. Bends through few noisy contacts hide edges: a
patch is divided where planes, of contacts that agree within their noise, explain it better. Two
patches that are neighbours or on one plane are one if one explains the contacts of both better than
two do: its marginal likelihood is larger than the product of theirs (Bayes factor; Kass and Raftery
1995).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree
from scipy.spatial.distance import squareform

from lis_grasp.surfaces._patch import PatchContacts
from lis_grasp.surfaces.contact_places import SMALLEST
from lis_grasp.typing import FloatArray, IndexArray

# Largest distance of a pair of contacts, in spacings.
REACH = 2.6

# Contacts nearer than this, in spacings, with normals that agree this well, are at one place.
_SAME_PLACE = 0.3
_LIKE_NORMAL = np.cos(np.deg2rad(30.0))

# Asymmetry of pairs on one smooth surface and across an edge (one standard deviation, without
# noise).
_ASYMMETRY = 0.08
_EDGE_ASYMMETRY = 0.6

# Prior log odds of one patch for neighbours, and their slope with the angle of normals [1/rad].
_PRIOR = 2.5
_PRIOR_SLOPE = 12.0 / np.pi

# Normals that differ by more give no evidence of a common arc: contacts placed symmetrically about
# an edge have no asymmetry either. Patches that this leaves apart may still merge by evidence.
_MAX_BEND = np.deg2rad(60.0)

# Standard deviations by which two contacts on one plane may differ.
_ON_PLANE = 3.0

# Contacts on one plane that show that an object has faces: any fewer are on some plane.
_FACE = 4

# Contacts of a patch that are compared across a border, those nearest to the other patch.
_COMPARED = 24


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


def cluster_pairs(
    pairs: ContactPairs, position_noise: FloatArray, normal_noise: FloatArray
) -> IndexArray:
    """Return the patch of each contact, shape (N,): 0 for the first contact's, and so on.

    Agglomerative clustering: the likeliest pairs of patches merge first, as long as one smooth
    surface is likelier than an edge between them. The log odds of a pair belong to its asymmetry,
    normally distributed in both cases, but several times wider across an edge. Noise, (N,), is one
    standard deviation of contacts along their normals [m] and of the normals [rad].
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
    odds *= pairs.weights
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


def segment(contacts: PatchContacts, pairs: ContactPairs) -> tuple[IndexArray, float]:
    """Return the patch of each contact, (N,), and the log marginal likelihood of all patches.

    Patches are numbered by their first contacts.
    """
    evidence = _Evidence(contacts, _planes(contacts))
    patch_of = _divide(cluster_pairs(pairs, *contacts.noise), evidence)
    patch_of = _merge(patch_of, pairs, evidence)
    members = (np.flatnonzero(patch_of == p) for p in range(int(patch_of.max()) + 1))
    return patch_of, sum(evidence.of(contacts.central(patch)) for patch in members)


@dataclass(slots=True, eq=False)
class _Evidence:
    """Log marginal likelihoods of sets of contacts as one patch each, remembered."""

    contacts: PatchContacts
    planes: IndexArray  # (N,) see `_planes`
    _known: dict[bytes, float] = field(default_factory=dict)

    def of(self, members: IndexArray) -> float:
        """Return the log marginal likelihood of contacts on one patch; `members` ascend."""
        key = members.tobytes()
        if key not in self._known:
            self._known[key] = self.contacts.equations(members).log_evidence()
        return self._known[key]

    def of_union(self, first: IndexArray, second: IndexArray) -> float:
        """Return the log Bayes factor of one patch against two.

        It is -inf for two lone contacts that differ by more than a bend shows, on an object that
        has faces: these are two more of them.
        """
        if len(first) == len(second) == 1 and np.bincount(self.planes).max() >= _FACE:
            normals = self.contacts.normals
            if normals[first[0]] @ normals[second[0]] < np.cos(_MAX_BEND):
                return -np.inf
        near_first, near_second = self._nearest(first, second), self._nearest(second, first)
        union = np.sort(np.concatenate([near_first, near_second]))
        return self.of(union) - self.of(near_first) - self.of(near_second)

    def _nearest(self, members: IndexArray, others: IndexArray) -> IndexArray:
        """Return the members nearest to the others, ascending."""
        if len(members) <= _COMPARED:
            return members
        distances, _ = cKDTree(self.contacts.points[others]).query(self.contacts.points[members])
        return np.sort(members[np.argsort(distances, kind="stable")[:_COMPARED]])


def _planes(contacts: PatchContacts) -> IndexArray:
    """Return the plane of each contact, (N,): any two contacts on it agree within their noise.

    Each is level with the other's tangent plane, and their normals are parallel. No plane has two
    contacts that do not agree (complete linkage).
    """
    points, normals = contacts.points, contacts.normals
    if len(points) < 2:
        return np.zeros(len(points), dtype=np.intp)
    position, turn = contacts.variances[:, :2].T
    offsets = points - points[:, None]  # (N, N, 3), from each contact to each
    squares = np.einsum("ijk,ijk->ij", offsets, offsets)
    heights = np.einsum("ijk,ik->ij", offsets, normals) ** 2
    heights /= position + position[:, None] + turn[:, None] * squares
    bends = np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)) ** 2
    bends /= turn + turn[:, None]
    apart = np.sqrt(np.maximum(np.maximum(heights, heights.T), bends))
    tree = linkage(squareform(apart, checks=False), "complete")
    return np.asarray(fcluster(tree, _ON_PLANE, "distance") - 1, dtype=np.intp)


def _divide(patch_of: IndexArray, evidence: _Evidence) -> IndexArray:
    """Divide each patch into its parts on planes where these are likelier than it."""
    divided, planes = patch_of.copy(), evidence.planes
    for patch in range(int(patch_of.max()) + 1):
        members = np.flatnonzero(patch_of == patch)
        parts = [members[planes[members] == plane] for plane in np.unique(planes[members])]
        if len(parts) > 1:
            central = evidence.contacts.central(members)
            whole = evidence.of(central) * len(members) / len(central)
            if sum(evidence.of(part) for part in parts) > whole:
                divided[members] = divided.max() + 1 + planes[members]
    return np.unique(divided, return_inverse=True)[1].astype(np.intp)


def _merge(patch_of: IndexArray, pairs: ContactPairs, evidence: _Evidence) -> IndexArray:
    """Merge patches that are neighbours or share a plane, the likeliest first.

    That ends when two are likelier than one.
    """
    members = {p: np.flatnonzero(patch_of == p) for p in range(int(patch_of.max()) + 1)}
    order = np.argsort(evidence.planes, kind="stable")
    level = np.diff(evidence.planes[order]) == 0
    first = np.concatenate([pairs.first, order[:-1][level]])
    second = np.concatenate([pairs.second, order[1:][level]])
    low = np.minimum(patch_of[first], patch_of[second])
    high = np.maximum(patch_of[first], patch_of[second])
    gains = {
        (int(a), int(b)): evidence.of_union(members[a], members[b])
        for a, b in np.unique(np.column_stack([low, high])[low < high], axis=0)
    }
    while gains:
        kept, gone = max(gains, key=lambda border: (gains[border], -border[0], -border[1]))
        if gains[kept, gone] <= 0.0:
            break
        members[kept] = np.sort(np.concatenate([members[kept], members.pop(gone)]))
        touching = [border for border in gains if kept in border or gone in border]
        others = {p for border in touching for p in border} - {kept, gone}
        for border in touching:
            del gains[border]
        for other in others:
            border = (min(kept, other), max(kept, other))
            gains[border] = evidence.of_union(members[border[0]], members[border[1]])
    merged = np.empty(len(patch_of), dtype=np.intp)
    for number, patch in enumerate(sorted(members.values(), key=lambda m: int(m[0]))):
        merged[patch] = number
    return merged
