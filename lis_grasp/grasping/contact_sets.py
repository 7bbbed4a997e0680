"""Sets of contacts, one contact per pad, from which grasp candidates are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.records import subset_of
from lis_grasp.robots.hand import Hand
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

    def filled(self) -> tuple[FloatArray, FloatArray]:
        """Return points and normals (B, F, 3); pads that are not used repeat one that is."""
        return fill_unused(self.points, self.used), fill_unused(self.normals, self.used)

    def subset(self, index: IndexArray) -> ContactSets:
        """Return some of the sets."""
        return subset_of(self, index)


def fill_unused(values: FloatArray, used: BoolArray) -> FloatArray:
    """Return the values (B, F, 3) of pads, those of unused pads replaced by the first used one's.

    Contacts that occur twice change no hull of wrenches: so grasps by any number of the pads have
    arrays of one shape.
    """
    first = values[np.arange(len(used)), used.argmax(axis=1)]
    return np.where(used[..., None], values, first[:, None])


def contacts_of(grasps: Sequence[Grasp], hand: Hand) -> ContactSets:
    """Return the contacts of grasps by a hand, at least one, as sets."""
    points, normals = np.zeros((2, len(grasps), len(hand.pads), 3))
    used = np.zeros((len(grasps), len(hand.pads)), dtype=bool)
    for g, grasp in enumerate(grasps):
        pads = [hand.fingers.index(finger) for finger in grasp.contact_fingers]
        points[g, pads], normals[g, pads] = grasp.contact_points, grasp.contact_normals
        used[g, pads] = True
    return ContactSets(points, normals, used)
