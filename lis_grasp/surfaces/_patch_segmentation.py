"""Segmentation of contacts into smooth patches, by marginal likelihood.

Every patch is a Gaussian process of its own. Two neighbouring patches are one if one process
explains the contacts of both better than two do: its marginal likelihood is larger than the product
of theirs (Bayes factor; Kass and Raftery 1995).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.surfaces._patch import PatchContacts
from lis_grasp.surfaces.contact_pairs import ContactPairs
from lis_grasp.surfaces.pair_clustering import cluster_pairs
from lis_grasp.typing import IndexArray

# Contacts of a patch that are compared across a border, those nearest to the other patch.
_COMPARED = 24


def segment(contacts: PatchContacts, pairs: ContactPairs) -> tuple[IndexArray, float]:
    """Return the patch of each contact, (N,), and the log marginal likelihood of all patches.

    Patches are numbered by their first contacts.
    """
    evidence = _Evidence(contacts)
    patch_of = _merge(cluster_pairs(pairs, *contacts.noise), pairs, evidence)
    members = (np.flatnonzero(patch_of == p) for p in range(int(patch_of.max()) + 1))
    return patch_of, sum(evidence.of(contacts.central(each)) for each in members)


@dataclass(slots=True, eq=False)
class _Evidence:
    """Log marginal likelihoods of sets of contacts as one patch each, remembered."""

    contacts: PatchContacts
    _known: dict[bytes, float] = field(default_factory=dict)

    def of(self, members: IndexArray) -> float:
        """Return the log marginal likelihood of contacts on one patch; `members` ascend."""
        key = members.tobytes()
        if key not in self._known:
            self._known[key] = self.contacts.equations(members).log_evidence()
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
        distances, _ = cKDTree(self.contacts.points[others]).query(self.contacts.points[members])
        return np.sort(members[np.argsort(distances, kind="stable")[:_COMPARED]])


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
