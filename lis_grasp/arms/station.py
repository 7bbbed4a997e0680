"""A robot station: an arm with its hand, which grasps are checked against."""

from __future__ import annotations

from dataclasses import dataclass

import trimesh

from lis_grasp.arms.mounted_hand import MountedHand
from lis_grasp.arms.reach import ReachFilter
from lis_grasp.grasping.grasps import ReachCheck
from lis_grasp.world import Table as Table


@dataclass(frozen=True, eq=False, repr=False)  # no slots: for cached_property
class Station(MountedHand):
    """A robot station: arm, base, mount, hand and table, in whose reach grasps are planned."""

    def reach_check(self, mesh: trimesh.Trimesh) -> ReachCheck:
        """Return the check of grasps of an object's mesh in W, `ReachFilter.rejections`."""
        return ReachFilter(self, mesh).rejections
