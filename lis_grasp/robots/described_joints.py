"""Joints as a robot's description has them, without the meshes of its links."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from lis_grasp.robots._build_model import pose_matrix, unit_axis
from lis_grasp.robots._description import DescriptionEdits, apply_edits, parse_description
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
        return str(self.joint.name if self.joint.mimic is None else self.joint.mimic.joint)

    def poses(self, leader_positions: FloatArray) -> FloatArray:
        """Return poses X_PC (T, 4, 4) at positions (T,) of the leader [rad or m].

        Raises `InvalidHandError` if the joint has no finite pose or no axis.
        """
        with naming(self.description):
            return self._poses(leader_positions)

    def _poses(self, positions: FloatArray) -> FloatArray:
        mimic, X_PJ = self.joint.mimic, pose_matrix(self.joint.origin)
        if mimic is not None:
            ratio = 1.0 if mimic.multiplier is None else mimic.multiplier
            positions = ratio * positions + (mimic.offset or 0.0)
        X_JC = np.tile(np.eye(4), (len(positions), 1, 1))
        if not self.is_fixed:
            along = positions[:, None] * unit_axis(self.joint)  # (T, 3)
            if self.joint.type == "prismatic":
                X_JC[:, :3, 3] = along
            else:
                X_JC[:, :3, :3] = Rotation.from_rotvec(along).as_matrix()
        return np.asarray(X_PJ @ X_JC)


def read_joints(description: Path) -> tuple[DescribedJoint, ...]:
    """Return the joints of a URDF, SDF or MJCF in the order of the file.

    Raises `InvalidFileError` or `InvalidHandError` if the description cannot be read.
    """
    with naming(description):
        robot = apply_edits(parse_description(description), DescriptionEdits())
    return tuple(DescribedJoint(joint, description) for joint in robot.joints)
