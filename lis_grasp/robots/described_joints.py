"""Joints as a robot's description has them, without the meshes of its links."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.robots._build_model import pose_matrix, unit_axis
from lis_grasp.robots._description import (
    NO_EDITS,
    apply_edits,
    mimicked,
    parse_description,
)
from lis_grasp.robots._urdf import naming
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class DescribedJoint:
    """A joint between its parent link P and its child link C. Made by `read_joints`."""

    joint: yourdfpy.Joint
    description: Path

    @property
    def ends(self) -> tuple[str, str]:
        """Names of the parent and the child link."""
        return self.joint.parent, self.joint.child

    @property
    def is_fixed(self) -> bool:
        """Whether the links never move with each other."""
        return bool(self.joint.type == "fixed")

    @property
    def leader(self) -> str:
        """Name of the joint that this one mimics; its own if it mimics none."""
        return mimicked(self.joint)[0]

    @property
    def longest(self) -> float:
        """Largest distance of the child's origin from the parent's [m]; infinite if unlimited."""
        offset = float(np.linalg.norm(pose_matrix(self.joint.origin)[:3, 3]))
        if self.is_fixed or self.joint.type in ("revolute", "continuous"):
            return offset
        limit = self.joint.limit
        if self.joint.type != "prismatic" or limit is None or None in (limit.lower, limit.upper):
            return math.inf
        return offset + max(abs(limit.lower), abs(limit.upper))

    def poses(self, leader_positions: FloatArray) -> FloatArray:
        """Return poses X_PC (T, 4, 4) at positions (T,) of the leader [rad or m].

        Raises `InvalidHandError` if the joint has no finite pose or no axis.
        """
        _, ratio, offset = mimicked(self.joint)
        positions = ratio * leader_positions + offset
        X_JC = np.tile(np.eye(4), (len(positions), 1, 1))
        with naming(self.description):
            X_PJ = pose_matrix(self.joint.origin)
            axis = np.zeros(3) if self.is_fixed else unit_axis(self.joint)
        along = positions[:, None] * axis  # (T, 3)
        if self.joint.type == "prismatic":
            X_JC[:, :3, 3] = along
        else:
            X_JC[:, :3, :3] = Rotation.from_rotvec(along).as_matrix()
        return np.asarray(X_PJ @ X_JC)


def read_joints(
    description: Path, xacro_args: Mapping[str, str] = MappingProxyType({})
) -> tuple[DescribedJoint, ...]:
    """Return the joints of a URDF, SDF or MJCF in the order of the file.

    `xacro_args` are the arguments of a xacro file.

    Raises `InvalidFileError` or `InvalidHandError` if the description cannot be read.
    """
    with naming(description):
        robot = apply_edits(parse_description(description, xacro_args), NO_EDITS)
    return tuple(DescribedJoint(joint, description) for joint in robot.joints)


def reach_of(joints: Sequence[DescribedJoint]) -> float:
    """Return a bound of the distance of a link's origin from the root's [m].

    It is the largest sum, along a chain of joints, of their offsets and travels: a turn does not
    lengthen an offset. Infinite if a joint slides without limits or floats.
    """
    reaches: dict[str, float] = {}
    by_child = {joint.joint.child: joint for joint in joints}

    def distance(link: str) -> float:
        joint = by_child.get(link)
        if joint is None:
            return 0.0
        if link not in reaches:
            reaches[link] = math.inf  # of a loop
            reaches[link] = distance(joint.joint.parent) + joint.longest
        return reaches[link]

    return max(map(distance, by_child), default=0.0)
