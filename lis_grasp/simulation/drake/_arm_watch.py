"""Checks of a simulated arm at every step: effort and speed limits, and unwanted contacts."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactResults

from lis_grasp.lifting.arm_use import EFFORT_LIMIT, TABLE, ArmUse
from lis_grasp.lifting.scene import ArmStoppedError
from lis_grasp.motion import OBJECT
from lis_grasp.simulation.drake._plant_scene import PlantScene
from lis_grasp.simulation.drake.arm_plant import ArmInPlant, ignore_mounting

# A joint that is at its limit for so long [s] no longer follows.
_SATURATED = 0.05


class ArmWatch:
    """Records how an arm's limits are used, and every unwanted contact, at each time step.

    Wanted are contacts of the object with fingertips and pads: links that carry a pad or lead in a
    probe posture, and those fixed to them. No other link of the hand should touch the object, none
    the table, and a link of the arm nothing at all. While the hand is to be `free` of the object,
    even pads should not touch it. A contact of the arm ends the motion, and, where `object_ends`
    it, an unwanted one of the object.
    """

    def __init__(
        self,
        scene: PlantScene,
        arm: ArmInPlant,
        *,
        use: ArmUse | None = None,
        object_ends: bool = False,
    ) -> None:
        plant = scene.plant
        self.use = ArmUse() if use is None else use
        self.free = object_ends
        self._wanted = arm.hand.hand.fingertip_links
        self._plant, self._context, self._arm = plant, scene.context, arm
        self._table, self._object_ends = scene.table, object_ends
        ignore_mounting(scene.filters, arm, scene.table)
        self._longest = round(_SATURATED / plant.time_step())
        self._saturated = np.zeros(len(arm.arm.joint_names), dtype=int)
        self._efforts = plant.get_net_actuation_output_port(arm.links.instance)
        self._results = plant.get_contact_results_output_port()

    def check(self) -> None:
        """Record the step that was just taken; raise `ArmStoppedError` if the motion must end."""
        use, arm = self.use, self._arm.arm
        use.steps += 1
        effort = np.abs(self._efforts.Eval(self._context)) / arm.effort_limits
        rates = self._plant.GetVelocities(self._context, self._arm.links.instance)
        speed = np.abs(rates) / arm.velocity_limits
        if effort.max() > use.effort:
            use.effort = float(effort.max())
            use.effort_joint = arm.joint_names[int(effort.argmax())]
        if speed.max() > use.speed:
            use.speed = float(speed.max())
            use.speed_joint = arm.joint_names[int(speed.argmax())]
        self._saturated = np.where(effort > EFFORT_LIMIT, self._saturated + 1, 0)
        if self._collides():
            raise ArmStoppedError("arm_collision")
        if self._saturated.max() >= self._longest:
            raise ArmStoppedError("torque_limit")

    def _collides(self) -> bool:
        """Count unwanted contacts; return whether one of them ends the motion."""
        results: ContactResults = self._results.Eval(self._context)
        hand, ends = self._arm.hand.link_of_geometry, False
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            surface = info.contact_surface()
            pair = surface.id_M(), surface.id_N()
            if self._table not in pair and (pair[0] in hand or pair[1] in hand):
                force = float(np.linalg.norm(info.F_Ac_W().translational()))
                self.use.contact_force = max(self.use.contact_force, force)
            ends |= self._count(*pair)
        for i in range(results.num_point_pair_contacts()):
            points = results.point_pair_contact_info(i).point_pair()
            ends |= self._count(points.id_A, points.id_B)
        return ends

    def _count(self, first: GeometryId, second: GeometryId) -> bool:
        """Count a contact if it is unwanted; return whether it ends the motion."""
        arm, hand = self._arm.link_of_geometry, self._arm.hand.link_of_geometry
        of_arm = first in arm or second in arm
        if not of_arm and first not in hand and second not in hand:
            return False
        # The arm or the hand is named first.
        names = sorted(map(self._name, (first, second)), key=lambda n: (n in (TABLE, OBJECT), n))
        if not of_arm and names[1] == OBJECT and names[0] in self._wanted and not self.free:
            return False
        together = " with ".join(names)
        self.use.contacts[together] = self.use.contacts.get(together, 0) + 1
        return of_arm or (self._object_ends and OBJECT in names)

    def _name(self, geometry: GeometryId) -> str:
        if geometry == self._table:
            return TABLE
        arm, hand = self._arm.link_of_geometry, self._arm.hand.link_of_geometry
        if geometry in arm:
            return f"arm's {arm[geometry]}"
        return hand.get(geometry, OBJECT)
