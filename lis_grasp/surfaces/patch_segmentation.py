"""Segmentation of contacts into smooth patches, and their noise, by marginal likelihood.

Every patch is a Gaussian process of its own. Two neighbouring patches are one if one process
explains the contacts of both better than two do: its marginal likelihood is larger than the product
of theirs (Bayes factor; Kass and Raftery 1995). Noise that is not known is that of the largest
likelihood (empirical Bayes).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.surfaces.contact_pairs import ContactPairs
from lis_grasp.surfaces.pair_clustering import cluster_pairs
from lis_grasp.surfaces.patch import PatchEquations, central, noise_variances
from lis_grasp.typing import FloatArray, IndexArray

# Noise levels that are tried where none is known: position in spacings, normal [rad]; the one of
# the first segmentation; and the mean of an exponential prior on that of the normals [rad], without
# which few contacts on a rough surface look noisy.
_LEVELS = ((0.003, 0.015), (0.01, 0.05), (0.03, 0.1), (0.06, 0.15), (0.12, 0.25))
_FIRST_LEVEL = 1
_TYPICAL_NORMAL_NOISE = 0.025

# Contacts of a patch that are compared across a border, those nearest to the other patch.
_COMPARED = 24


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The patch of each contact, and the noise that the contacts show."""

    patch_of: IndexArray  # (N,), 0 for the first contact's, and so on
    position_noise: FloatArray  # (N,) [m]
    normal_noise: FloatArray  # (N,) [rad]


def segment(
    points: FloatArray,
    normals: FloatArray,
    pairs: ContactPairs,
    spacing: float,
    position_noise: FloatArray,
    normal_noise: FloatArray,
) -> Segmentation:
    """Divide contacts, shapes (N, 3), into smooth patches; noise (N,) is NaN where unknown."""
    equations: dict[bytes, PatchEquations] = {}

    def level(position: float, normal: float) -> _Level:
        positions = np.where(np.isnan(position_noise), position * spacing, position_noise)
        turns = np.where(np.isnan(normal_noise), normal, normal_noise)
        variances = noise_variances(positions / spacing, turns)
        evidence = _Evidence(points / spacing, normals, variances, equations)
        return _Level(positions, turns, evidence, -normal / _TYPICAL_NORMAL_NOISE)

    def merged(level: _Level) -> IndexArray:
        patch_of = cluster_pairs(pairs, level.position_noise, level.normal_noise)
        return _merge(patch_of, pairs, level.evidence)

    known = not (np.isnan(position_noise).any() or np.isnan(normal_noise).any())
    levels = [level(*noise) for noise in (_LEVELS[:1] if known else _LEVELS)]
    best = levels[min(_FIRST_LEVEL, len(levels) - 1)]
    patch_of = merged(best)
    likeliest = max(levels, key=lambda candidate: candidate.log_posterior(patch_of))
    if likeliest is not best:
        other = merged(likeliest)
        if likeliest.log_posterior(other) > best.log_posterior(patch_of):
            best, patch_of = likeliest, other
    return Segmentation(patch_of, best.position_noise, best.normal_noise)


@dataclass(slots=True, eq=False)
class _Evidence:
    """Log marginal likelihoods of sets of contacts as one patch each, remembered."""

    points: FloatArray  # (N, 3) in spacings
    normals: FloatArray  # (N, 3)
    variances: FloatArray  # (4N,)
    equations: dict[bytes, PatchEquations]  # of sets of contacts; they do not depend on noise
    _known: dict[bytes, float] = field(default_factory=dict)

    def of(self, members: IndexArray) -> float:
        """Return the log marginal likelihood of contacts on one patch; `members` ascend."""
        key = members.tobytes()
        if key not in self._known:
            if key not in self.equations:
                chosen = self.points[members], self.normals[members]
                self.equations[key] = PatchEquations.of(*chosen)
            variances = self.variances.reshape(-1, 4)[members].ravel()
            self._known[key] = self.equations[key].log_evidence(variances)
        return self._known[key]

    def of_union(self, first: IndexArray, second: IndexArray) -> float:
        """Return the log Bayes factor of one patch against two."""
        near_first, near_second = self._nearest(first, second), self._nearest(second, first)
        union = np.sort(np.concatenate([near_first, near_second]))
        return self.of(union) - self.of(near_first) - self.of(near_second)

    def _nearest(self, members: IndexArray, others: IndexArray) -> IndexArray:
        """Return the members nearest to the others, ascending."""
        if len(members) <= _COMPARED:
            return members
        distances, _ = cKDTree(self.points[others]).query(self.points[members])
        return np.sort(members[np.argsort(distances, kind="stable")[:_COMPARED]])


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """A level of noise, and the evidence of patches at that level."""

    position_noise: FloatArray  # (N,) [m]
    normal_noise: FloatArray  # (N,) [rad]
    evidence: _Evidence
    log_prior: float

    def log_posterior(self, patch_of: IndexArray) -> float:
        """Return the log posterior of the level, up to a constant, given the patches."""
        members = (np.flatnonzero(patch_of == p) for p in range(int(patch_of.max()) + 1))
        points = self.evidence.points
        return self.log_prior + sum(self.evidence.of(m[central(points[m])]) for m in members)


def _merge(patch_of: IndexArray, pairs: ContactPairs, evidence: _Evidence) -> IndexArray:
    """Merge neighbouring patches, the likeliest first, while one is likelier than two."""
    members = {p: np.flatnonzero(patch_of == p) for p in range(int(patch_of.max()) + 1)}
    low = np.minimum(patch_of[pairs.first], patch_of[pairs.second])
    high = np.maximum(patch_of[pairs.first], patch_of[pairs.second])
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
