"""Setup of a simulated lift: object, hand, grasp, table and options."""

from __future__ import annotations

from dataclasses import dataclass

import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError, require_positive
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.grasping.load_capacity import GRAVITY
from lis_grasp.lifting.arm_lift import ArmLift
from lis_grasp.lifting.lift_outcome import LiftOptions
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LiftSetup:
    """Object, hand, grasp, table and options; arguments and errors of `simulate_lift`."""

    mesh: trimesh.Trimesh
    hand: Hand
    grasp: Grasp
    support_height: float
    mass: float
    friction: float
    options: LiftOptions
    X_WO: FloatArray
    arm: ArmLift | None = None

    def __post_init__(self) -> None:
        if not self.mesh.is_watertight:
            raise InvalidMeshError("a lift needs a watertight mesh: load it with `shapes.load`")
        require_positive(mass=self.mass, friction=self.friction)
        if tuple(self.grasp.joint_names) != tuple(self.hand.joint_names):
            raise InvalidOptionError(
                f"the grasp must be for the joints of '{self.hand.name}'; it is for those of"
                f" '{self.grasp.hand}'",
                option="grasp",
                value=self.grasp.hand,
            )

    @property
    def grip_friction(self) -> float:
        """Coulomb coefficient with which the grip forces are planned."""
        return self.options.assumed_friction or self.friction

    def grip_force(self, mass: float) -> float:
        """Return the wanted sum of normal forces [N] for a mass [kg]; see `LiftOptions`."""
        options = self.options
        load = mass * (GRAVITY + max(options.shake_accelerations, default=0.0))
        return max(
            options.grip_margin * load / self.grip_friction,
            self._force_to_accelerate(load),
            options.least_grip_force,
        )

    def _force_to_accelerate(self, load: float) -> float:
        """Return the sum of normal forces [N] with which the planned grasp carries a load [N].

        Levers to the centre of mass and the inertia of long objects are part of the load that was
        planned; 0 for a grasp that names none.
        """
        per_grip = self.grasp.quality.get("load_per_grip")
        if per_grip is None:
            return 0.0
        largest = 2.0 * self.hand.max_contact_force
        return float(min(largest, self.options.grip_margin * load / max(per_grip, 1e-9)))
