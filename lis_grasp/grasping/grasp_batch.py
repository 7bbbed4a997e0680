"""Batch of grasps of one hand as arrays: contacts, postures and qualities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.records import fields_of, short_repr
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True, slots=True, eq=False)
class GraspBatch:
    """B grasps, or sets of contacts to grasp at, of a hand with F pads and J joints."""

    points: FloatArray  #: (B, F, 3) [m], in O; zeros where a pad has no contact
    normals: FloatArray  #: (B, F, 3), unit, outward; likewise
    used: BoolArray  #: (B, F): which pads have a contact
    X_OH: FloatArray  #: (B, 4, 4): palm poses, or the initial guess of the inverse kinematics
    q: FloatArray  #: (B, J) [rad or m]: joint positions in contact; likewise
    #: (B, F, 3) [m]: of the pads' points in contact from their centres, in the frames of the links
    offsets: FloatArray | None = None
    position_error: FloatArray | None = None  #: (B,) [m]: of the farthest pad from its target
    axis_error: FloatArray | None = None  #: (B,) [rad]: of the contact farthest beyond its pad
    opened: FloatArray | None = None  #: (B, J): with every used pad off its contact
    clearance: FloatArray | None = None  #: (B,) [m]: of links but fingertips from the object
    quality: dict[str, FloatArray] = field(default_factory=dict)  #: values (B,) by name

    __repr__ = short_repr

    @classmethod
    def of_grasps(cls, grasps: Sequence[Grasp], hand: Hand) -> GraspBatch:
        """Return grasps by a hand, at least one, as a batch."""
        points, normals = np.zeros((2, len(grasps), len(hand.pads), 3))
        used = np.zeros((len(grasps), len(hand.pads)), dtype=bool)
        for g, grasp in enumerate(grasps):
            pads = [hand.fingers.index(finger) for finger in grasp.contact_fingers]
            points[g, pads], normals[g, pads] = grasp.contact_points, grasp.contact_normals
            used[g, pads] = True
        names = set.intersection(*(set(grasp.quality) for grasp in grasps))
        return cls(
            points,
            normals,
            used,
            np.array([grasp.X_OH for grasp in grasps]),
            np.array([grasp.joint_positions for grasp in grasps]),
            opened=np.array([grasp.pregrasp_positions for grasp in grasps]),
            quality={
                name: np.array([grasp.quality[name] for grasp in grasps])
                for name in grasps[0].quality
                if name in names
            },
        )

    @classmethod
    def empty(cls, hand: Hand) -> GraspBatch:
        """Return no sets of contacts of a hand."""
        contacts = np.zeros((0, len(hand.pads), 3))
        used, q = np.zeros((0, len(hand.pads)), bool), np.zeros((0, len(hand.joint_names)))
        return cls(contacts, contacts, used, np.zeros((0, 4, 4)), q)

    def __len__(self) -> int:
        return len(self.points)

    def contacts(self) -> tuple[FloatArray, FloatArray]:
        """Return points and normals (B, F, 3); pads without a contact repeat one that has."""
        return fill_unused(self.points, self.used), fill_unused(self.normals, self.used)

    def subset(self, index: IndexArray) -> GraspBatch:
        """Return some of the grasps."""
        arrays = {name: a[index] for name, a in self._arrays().items()}
        return GraspBatch(**arrays, quality={name: v[index] for name, v in self.quality.items()})

    def joined(self, other: GraspBatch) -> GraspBatch:
        """Return these grasps followed by others, which have the same arrays and qualities."""
        others = other._arrays()
        return GraspBatch(
            **{name: np.concatenate([a, others[name]]) for name, a in self._arrays().items()},
            quality={
                name: np.concatenate([v, other.quality[name]]) for name, v in self.quality.items()
            },
        )

    def with_quality(self, **values: FloatArray) -> GraspBatch:
        """Return the grasps with more qualities, each of shape (B,)."""
        return replace(self, quality={**self.quality, **values})

    def _arrays(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in fields_of(self).items()
            if value is not None and name != "quality"
        }


def fill_unused(values: FloatArray, used: BoolArray) -> FloatArray:
    """Return the values (B, F, 3) of pads; unused pads get the values of the first used one.

    Repeated contacts do not change a hull of wrenches, so grasps by any number of pads have arrays
    of one shape.
    """
    first = values[np.arange(len(used)), used.argmax(axis=1)]
    return np.where(used[..., None], values, first[:, None])
