"""Checks of a simulated arm at every step: effort and speed limits, and unwanted contacts."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import Context

from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.lift_outcome import Reason
from lis_grasp.simulation.arm_plant import ArmInPlant

# A joint is at its limit from this fraction of its effort on.
_AT_LIMIT = 0.999
# A joint that is at its limit for so long [s] no longer follows.
_SATURATED = 0.05


class ArmStoppedError(Exception):
    """The arm cannot go on, for a reason that ends the trial."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason: Reason = reason


class ArmWatch:
    """Records how an arm's limits are used, and which unwanted contacts there are.

    A link of the arm must touch nothing. The hand's links should not touch the table either; that
    is recorded, and ends nothing.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        plant_context: Context,
        arm: ArmInPlant,
        *,
        table: GeometryId | None,
        use: ArmUse | None = None,
    ) -> None:
        self.use = ArmUse() if use is None else use
        self._plant, self._context, self._arm = plant, plant_context, arm
        self._table = table
        self._longest = round(_SATURATED / plant.time_step())
        self._saturated = np.zeros(len(arm.arm.joint_names), dtype=int)
        self._efforts = plant.get_net_actuation_output_port(arm.instance)
        self._results = plant.get_contact_results_output_port()

    def check(self) -> None:
        """Record the step that was just taken; raise `ArmStoppedError` if the motion must end."""
        use, arm = self.use, self._arm.arm
        use.steps += 1
        effort = np.abs(self._efforts.Eval(self._context)) / arm.effort_limits
        rates = self._plant.GetVelocities(self._context, self._arm.instance)
        speed = np.abs(rates) / arm.velocity_limits
        if effort.max() > use.effort:
            use.effort = float(effort.max())
            use.effort_joint = arm.joint_names[int(effort.argmax())]
        if speed.max() > use.speed:
            use.speed = float(speed.max())
            use.speed_joint = arm.joint_names[int(speed.argmax())]
        self._saturated = np.where(effort > _AT_LIMIT, self._saturated + 1, 0)
        if self._collides():
            raise ArmStoppedError("arm_collision")
        if self._saturated.max() >= self._longest:
            raise ArmStoppedError("torque_limit")

    def _collides(self) -> bool:
        """Count unwanted contacts; return whether a link of the arm is part of one."""
        results: ContactResults = self._results.Eval(self._context)
        pairs = []
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            surface = info.contact_surface()
            pairs.append((surface.id_M(), surface.id_N()))
            if self._table not in pairs[-1]:
                force = float(np.linalg.norm(info.F_Ac_W().translational()))
                self.use.contact_force = max(self.use.contact_force, force)
        for i in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(i).point_pair()
            pairs.append((pair.id_A, pair.id_B))
        arm, collides = self._arm.link_of_geometry, False
        for first, second in pairs:
            of_arm = first in arm or second in arm
            if not of_arm and self._table not in (first, second):
                continue  # hand and object
            names = sorted(map(self._name, (first, second)))
            if "object" in names and "table" in names:
                continue
            together = " with ".join(names)
            self.use.contacts[together] = self.use.contacts.get(together, 0) + 1
            collides |= of_arm
        return collides

    def _name(self, geometry: GeometryId) -> str:
        if geometry == self._table:
            return "table"
        arm, hand = self._arm.link_of_geometry, self._arm.hand.link_of_geometry
        return arm.get(geometry) or hand.get(geometry) or "object"
