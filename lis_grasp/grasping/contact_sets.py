"""Sets of contacts, one contact per pad, from which grasp candidates are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lis_grasp.records import subset_of
from lis_grasp.typing import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class ContactSets:
    """B sets of contacts for the F pads of a hand."""

    points: FloatArray  # (B, F, 3) [m], in O; anything finite where a pad is not used
    normals: FloatArray  # (B, F, 3), unit, outward; likewise
    used: BoolArray  # (B, F): which pads have a contact
    # (B, F, 3) [m]: of the pads' points in contact from their centres, in the frames of the links
    offsets: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def by_count(self) -> Iterator[tuple[IndexArray, FloatArray, FloatArray]]:
        """Yield sets of equally many contacts: their indices (b,), points and normals (b, C, 3)."""
        counts = self.used.sum(axis=1)
        for count in np.unique(counts):
            alike = np.flatnonzero(counts == count)
            used = self.used[alike]
            points, normals = self.points[alike][used], self.normals[alike][used]
            yield alike, points.reshape(-1, count, 3), normals.reshape(-1, count, 3)

    def subset(self, index: IndexArray) -> ContactSets:
        """Return some of the sets."""
        return subset_of(self, index)
