"""Setup of a simulated lift: object, hand, grasp, table and options."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.lifting.lift_outcome import LiftOptions
from lis_grasp.typing import FloatArray

_GRAVITY = 9.81  # [m/s^2]


@dataclass(frozen=True, slots=True, eq=False)
class LiftSetup:
    """What is lifted, by what, from where; arguments and errors of `simulate_lift`."""

    mesh: trimesh.Trimesh
    hand: Hand
    grasp: Grasp
    support_height: float
    mass: float
    friction: float
    options: LiftOptions
    X_WO: FloatArray

    def __post_init__(self) -> None:
        if not self.mesh.is_watertight:
            raise InvalidMeshError("a lift needs a watertight mesh: load it with `shapes.load`")
        for name in ("mass", "friction"):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                raise InvalidOptionError.out_of_range(name, value, "a positive number")
        if tuple(self.grasp.joint_names) != tuple(self.hand.joint_names):
            raise InvalidOptionError(
                f"the grasp must be for the joints of '{self.hand.name}'; it is for those of"
                f" '{self.grasp.hand}'",
                option="grasp",
                value=self.grasp.hand,
            )

    @property
    def grip_force(self) -> float:
        """Wanted sum of the fingers' normal forces [N]; see `LiftOptions.grip_margin`."""
        options = self.options
        load = self.mass * (_GRAVITY + max(options.shake_accelerations, default=0.0))
        return max(options.grip_margin * load / self.friction, options.least_grip_force)
