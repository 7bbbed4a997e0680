"""An arm on its base with a hand on its flange: kinematics of the palm in the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from lis_grasp.arms.arm_mount import ArmMount, mount_of
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import cross, inverse_pose, require_pose
from lis_grasp.records import read_only
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.arm_ik import ArmSolutions
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a flat top, on which the object is; the arm's base is on it or beside it."""

    height: float = 0.0  # of the top in W [m]
    half_width: float = 0.75  # along W's x and y from `center` [m]
    center: tuple[float, float] = (0.0, 0.0)  # x and y in W [m]


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class Station:
    """A robot station: arm, base, mount, hand and table.

    Frames: W world, in which the object is estimated and grasps are planned; A the arm's base
    link, F its flange, B the hand's base link, H the palm. J joints of the arm.

    Parameters
    ----------
    arm, hand
        Arm and hand.
    X_WA
        Shape (4, 4): pose of the arm's base.
    mount
        Pose of the hand on the flange.
    table
        The table; None for none.

    Raises
    ------
    InvalidOptionError
        If the base is not a pose, or is inside the table.
    """

    arm: Arm
    hand: Hand
    X_WA: FloatArray
    mount: ArmMount
    table: Table | None = None

    @classmethod
    def make(
        cls, arm: Arm, hand: Hand, X_WA: npt.ArrayLike, *, table: Table | None = None
    ) -> Station:
        """Return the station of an arm and a hand, the hand mounted as by `mount_of`."""
        return cls(arm, hand, np.asarray(X_WA, np.float64), mount_of(arm, hand), table)

    def __post_init__(self) -> None:
        X_WA = require_pose("X_WA", self.X_WA)
        object.__setattr__(self, "X_WA", X_WA)
        table = self.table
        if table is not None:
            aside = np.abs(X_WA[:2, 3] - table.center).max() > table.half_width
            if not aside and X_WA[2, 3] < table.height - 1e-6:
                raise InvalidOptionError(
                    f"the arm's base must be on the table, {table.height:g} m high, or beside it;"
                    f" it is {X_WA[2, 3]:g} m high in its middle",
                    option="base",
                    value=self.X_WA,
                )

    def __repr__(self) -> str:
        place = ", ".join(f"{x:g}" for x in self.X_WA[:3, 3])
        return f"Station({self.arm.name} with {self.hand.name}, base at ({place}))"

    def moved(self, X_WA: npt.ArrayLike) -> Station:
        """Return the same station with its base at another pose (4, 4)."""
        return replace(self, X_WA=np.asarray(X_WA, np.float64))

    @cached_property
    def X_FH(self) -> FloatArray:
        """The palm in the flange frame, shape (4, 4)."""
        return read_only(self.mount.X_FB @ self.hand.X_LH)

    def palm_poses(self, q: npt.ArrayLike) -> FloatArray:
        """Return the palm's poses X_WH, (..., 4, 4), at the arm's positions q (..., J)."""
        return np.asarray(self.X_WA @ self.arm.kinematics.flange_poses(q) @ self.X_FH)

    def jacobians(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the palm's poses X_WH (..., 4, 4) and Jacobians (..., 6, J).

        Rows 0 to 2 are the velocity of the palm's origin along W's axes, 3 to 5 its angular
        velocity, for each joint's rate.
        """
        X_AF, of_flange = self.arm.kinematics.jacobians(q)
        R_WA = self.X_WA[:3, :3]
        linear, angular = R_WA @ of_flange[..., :3, :], R_WA @ of_flange[..., 3:, :]
        # The palm's origin moves with the flange, and about it.
        lever = (R_WA @ X_AF[..., :3, :3] @ self.X_FH[:3, 3])[..., None, :]  # (..., 1, 3)
        about = cross(np.swapaxes(angular, -1, -2), lever)
        linear = linear + np.swapaxes(about, -1, -2)
        return self.X_WA @ X_AF @ self.X_FH, np.concatenate([linear, angular], axis=-2)

    def solve_ik(
        self, X_WH: npt.ArrayLike, *, seeds: int = 8, first: FloatArray | None = None
    ) -> ArmSolutions:
        """Return the arm's positions for palm poses X_WH (N, 4, 4), as `ArmIK.solve`."""
        return self.arm.ik.solve(self._flange_targets(X_WH), seeds=seeds, first=first)

    def follow(self, q: npt.ArrayLike, X_WH: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return positions near q (B, J) for palm poses (B, 4, 4), and which were found, (B,)."""
        return self.arm.ik.follow(np.asarray(q, np.float64), self._flange_targets(X_WH))

    def _flange_targets(self, X_WH: npt.ArrayLike) -> FloatArray:
        to_base, to_flange = inverse_pose(self.X_WA), inverse_pose(self.X_FH)
        return np.asarray(to_base @ np.asarray(X_WH, np.float64) @ to_flange)
