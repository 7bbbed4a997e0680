"""The robot arm: links, joints, limits, flange and home posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from lis_grasp.robots.kinematics import ArmKinematics, Kinematics, link_kinematics
from lis_grasp.robots.pose_ik import ArmIK
from lis_grasp.robots.robot_model import RobotModel, joints_before, links_fixed_to
from lis_grasp.robots.yaml_files import read_arm_file
from lis_grasp.typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Arm(RobotModel):
    """A robot arm, read by `Arm.load` from a URDF, SDF or MJCF and one YAML file.

    Frames: A the base link, L a link, F the flange, whose +z points out of it. J joints, from the
    base to the flange. A gripper or anything else beyond the flange is left out.

    For the fields of the model see `Hand`.
    """

    name: str
    path: Path  #: of the URDF or SDF
    flange: str  #: the link that carries the hand
    X_LF: FloatArray  #: (4, 4), the flange frame in that link
    home: FloatArray  #: (J,), a posture with the flange above the table, pointing down
    velocity_limits: FloatArray  #: (J,) [rad/s or m/s]
    acceleration_limits: FloatArray  #: (J,) [rad/s^2 or m/s^2]
    rotor_inertias: FloatArray  #: (J,) [kg m^2 or kg], reflected to the joints; 0 if unknown
    damping: FloatArray  #: (J,) [N m s/rad or N s/m], of the joints themselves
    stiffness: FloatArray  #: (J,) [N m/rad or N/m], of the joint control
    speed_fraction: float  #: of the velocity and acceleration limits that motions use
    self_collision_exclusions: frozenset[tuple[str, str]]  #: sorted pairs of links that may touch

    @classmethod
    def load(cls, path_or_name: str | Path) -> Arm:
        """Read an arm: one of `READY_ARMS`, or a YAML file by its path.

        Raises `InvalidArmError` if there is no such arm, or its YAML or URDF is incomplete or
        contradicts itself.
        """
        return cls(**read_arm_file(path_or_name))

    def __repr__(self) -> str:
        return f"Arm({self.name!r}, {len(self.joint_names)} joints, flange: {self.flange})"

    @property
    def base_link(self) -> str:
        """Name of the link that is fixed to the world."""
        return self.links[0]

    @property
    def fixed_links(self) -> frozenset[str]:
        """The base link, and the links fixed to it."""
        return links_fixed_to(self, self.base_link)

    @property
    def flange_links(self) -> frozenset[str]:
        """The last moving link, and the links fixed to it: the hand is mounted on them."""
        return links_fixed_to(self, self.flange)

    @property
    def mass(self) -> float:
        """Mass of the moving links [kg]."""
        still = self.fixed_links
        return float(sum(i.mass for link, i in self.inertials.items() if link not in still))

    def forward_kinematics(self, X_WA: npt.ArrayLike, q: npt.ArrayLike) -> dict[str, FloatArray]:
        """Return the pose X_WL of every link by name, (..., 4, 4), in the order of `links`.

        `X_WA` (..., 4, 4) are poses of the base link, `q` (..., J) joint positions [rad or m].
        """
        return self._links_kinematics.poses(X_WA, q)

    @cached_property
    def kinematics(self) -> ArmKinematics:
        """Poses and Jacobians of the flange in the base link's frame."""
        return ArmKinematics(self.joints, self.flange, self.X_LF)

    @cached_property
    def joints_before(self) -> Mapping[str, int]:
        """Number of joints that move each link, by its name: 0 for the base link."""
        return joints_before(self)

    @cached_property
    def ik(self) -> ArmIK:
        """Inverse kinematics of the flange in the base link's frame."""
        return ArmIK(self.kinematics, self.lower, self.upper)

    @cached_property
    def _links_kinematics(self) -> Kinematics:
        return link_kinematics(self)

    def clipped(self, q: npt.ArrayLike) -> FloatArray:
        """Return joint positions (..., J), each moved to the nearest within its limits."""
        return np.clip(np.asarray(q, np.float64), self.lower, self.upper)

    def within_limits(self, q: npt.ArrayLike) -> BoolArray:
        """Return whether joint positions (..., J) are within the limits, shape (...)."""
        positions = np.asarray(q, np.float64)
        return np.asarray(((positions >= self.lower) & (positions <= self.upper)).all(axis=-1))
