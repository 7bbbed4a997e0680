"""Arm that carries a hand on a probe's straight motion."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import CollisionFilterManager, GeometryId
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from lis_grasp.arms.station import Station
from lis_grasp.lifting.arm_use import ArmUse
from lis_grasp.lifting.joint_path import joint_rates, posture_near
from lis_grasp.simulation.drake.arm_dynamics import ArmDynamics
from lis_grasp.simulation.drake.arm_plant import add_arm, ignore_mounting
from lis_grasp.simulation.drake.arm_watch import ArmStoppedError, ArmWatch
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

# A reversal at a touch accelerates the palm by this [m/s^2]; more exceeds effort limits.
_ACCELERATION = 4.0
# Largest fraction of a joint's speed limit that is commanded.
_LARGEST_SPEED = 0.9
# Spacing of the postures by which the arm comes to where its simulation starts [m].
_SPACING = 0.01


class ProbeArm:
    """An arm that carries the hand on probes; see `ProbeCarrier`.

    Differential inverse kinematics: in each step the joints get the positions and rates of the
    palm's line, and the efforts of inverse dynamics. The arm stops where the line began: what is
    behind is not known to be free. The plant is not finalized yet. What is demanded of the arm is
    added to `use`.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        added: HandInPlant,
        station: Station,
        use: ArmUse | None = None,
    ) -> None:
        self._use = ArmUse() if use is None else use
        hand, X_FB = station.hand, station.mount.X_FB
        posture = next(iter(hand.probe_postures.values())).joint_positions
        self._plant = plant
        self._dynamics = ArmDynamics(station.arm, hand, station.X_WA, X_FB, posture)
        self._arm = add_arm(
            plant, station.arm, added, X_WA=station.X_WA, X_FB=X_FB, dynamics=self._dynamics
        )

    def connect(
        self, plant_context: Context, filters: CollisionFilterManager, table: GeometryId | None
    ) -> None:
        """Take the context of the finalized plant, its collision filters and the table, if any."""
        plant, instance = self._plant, self._arm.instance
        self._context = plant_context
        self._states = plant.get_desired_state_input_port(instance)
        self._efforts = plant.get_actuation_input_port(instance)
        self._fingers = plant.get_actuation_input_port(self._arm.hand.instance)
        ignore_mounting(filters, self._arm, table)
        self._watch = ArmWatch(plant, plant_context, self._arm, table=table, use=self._use)

    def place(self, X_WB: FloatArray, direction: FloatArray, q: FloatArray | None) -> None:
        """Begin at a pose X_WB (4, 4) of the base link, with the joints near q (J,)."""
        assert q is not None
        self._X_WH = X_WB @ self._arm.hand.hand.X_LH
        self._direction = direction
        self._q = self._posture(q, 0.0)

    def start(self, travelled: float, speed: float) -> None:
        """Set the arm to where the hand has travelled so far [m], at a speed [m/s]."""
        for part in np.linspace(0.0, travelled, int(np.ceil(travelled / _SPACING)) + 1)[1:]:
            self._q = self._posture(self._q, float(part))
        self._travelled, self._speed = travelled, speed
        self._qd = self._rates(self._q, speed)
        plant, context, arm = self._plant, self._context, self._arm
        plant.SetPositions(context, arm.instance, self._q)
        plant.SetVelocities(context, arm.instance, self._qd)
        self._fingers.FixValue(context, arm.hand.weight_efforts(plant, context))

    def command(self, travelled: float, speed: float) -> None:
        """Command the next step of a motion at a speed [m/s]; the arm reverses within its means.

        It stops where the line began.
        """
        step = self._plant.time_step()
        change = _ACCELERATION * step
        speed = float(np.clip(speed, self._speed - change, self._speed + change))
        speed = max(speed, -float(np.sqrt(2.0 * _ACCELERATION * max(self._travelled, 0.0))))
        # Nearly stretched, a joint moves fast for a slow palm.
        rates = np.abs(self._rates(self._q, 1.0)) / self._arm.arm.velocity_limits
        fastest = _LARGEST_SPEED / float(rates.max())
        speed = float(np.clip(speed, -fastest, fastest))
        self._travelled, self._speed = self._travelled + step * speed, speed
        self._q = self._posture(self._q, self._travelled)
        before, self._qd = self._qd, self._rates(self._q, speed)
        self._states.FixValue(self._context, np.concatenate([self._q, self._qd]))
        efforts = self._dynamics.efforts(self._q, self._qd, (self._qd - before) / step)
        self._efforts.FixValue(self._context, efforts)

    def check(self) -> None:
        """Check the time step that was just taken; raise `ArmStoppedError` if the motion ends."""
        self._watch.check()

    def _posture(self, q: FloatArray, travelled: float) -> FloatArray:
        X_WH = self._X_WH.copy()
        X_WH[:3, 3] += travelled * self._direction
        found = posture_near(self._dynamics, q, X_WH)
        if found is None or not self._arm.arm.within_limits(found):
            raise ArmStoppedError("out_of_arm_reach")
        return found

    def _rates(self, q: FloatArray, speed: float) -> FloatArray:
        velocity = np.append(speed * self._direction, np.zeros(3))
        return joint_rates(self._dynamics, q, velocity)
