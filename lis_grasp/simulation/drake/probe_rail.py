"""Carriers of a hand on a probe's straight motion: the protocol, and a rail without an arm."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from pydrake.geometry import CollisionFilterManager, GeometryId
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    PdControllerGains,
    PrismaticJoint,
    QuaternionFloatingJoint,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from lis_grasp.geometry import inverse_pose, make_pose
from lis_grasp.probing.approach_planner import rotation_to_x
from lis_grasp.simulation.drake.hand_plant import HandInPlant
from lis_grasp.typing import FloatArray

# The rail that carries the hand: stiff to follow the motion, limited in force to stop at a touch.
_STIFFNESS, _DAMPING, _FORCE = 20_000.0, 600.0, 60.0  # [N/m], [N s/m], [N]


class ProbeCarrier(Protocol):
    """Carries the hand's base link along a straight line, without turning."""

    def connect(
        self, plant_context: Context, filters: CollisionFilterManager, table: GeometryId | None
    ) -> None:
        """Take the context of the finalized plant, its collision filters and the table, if any."""
        ...

    def place(self, X_WB: FloatArray, direction: FloatArray, q: FloatArray | None) -> None:
        """Begin at a pose X_WB (4, 4) of the base link, to move along a direction (3,) in W.

        `q` (J,) are an arm's joint positions there.
        """
        ...

    def start(self, travelled: float, speed: float) -> None:
        """Set the hand `travelled` [m] along its motion, at a speed [m/s], without lag."""
        ...

    def command(self, travelled: float, speed: float) -> None:
        """Command a position [m] along the motion and a speed [m/s]."""
        ...

    def check(self) -> None:
        """Check the time step that was just taken; raise `ArmStoppedError` if the motion ends."""
        ...


class ProbeRail:
    """A rail that carries the hand anywhere; the plant is not finalized yet."""

    def __init__(self, plant: MultibodyPlant, added: HandInPlant) -> None:
        self._plant = plant
        self._instance = plant.AddModelInstance("arm")
        rail, carriage = (
            plant.AddRigidBody(
                name,
                self._instance,
                SpatialInertia(0.5, np.zeros(3), UnitInertia.SolidSphere(0.05)),
            )
            for name in ("rail", "carriage")
        )
        self._rail = plant.AddJoint(
            QuaternionFloatingJoint("rail", plant.world_frame(), rail.body_frame())
        )
        self._slider = plant.AddJoint(
            PrismaticJoint("slider", rail.body_frame(), carriage.body_frame(), np.eye(3)[0])
        )
        plant.AddJointActuator("slider", self._slider, _FORCE).set_controller_gains(
            PdControllerGains(p=_STIFFNESS, d=_DAMPING)
        )
        base = added.bodies[added.hand.base_link]
        self._mount = plant.AddJoint(
            QuaternionFloatingJoint("mount", carriage.body_frame(), base.body_frame())
        )
        plant.set_gravity_enabled(self._instance, False)

    def connect(
        self, plant_context: Context, filters: CollisionFilterManager, table: GeometryId | None
    ) -> None:
        """Take the context of the finalized plant."""
        self._context = plant_context
        self._port = self._plant.get_desired_state_input_port(self._instance)

    def place(self, X_WB: FloatArray, direction: FloatArray, q: FloatArray | None) -> None:
        """Begin at a pose X_WB (4, 4) of the base link, to move along a direction (3,) in W."""
        context = self._context
        for joint in (self._rail, self._mount):
            joint.Unlock(context)
        self._slider.set_translation(context, 0.0)
        X_WR = make_pose(rotation_to_x(direction).T)
        self._rail.SetPose(context, _rigid(X_WR))
        self._mount.SetPose(context, _rigid(inverse_pose(X_WR) @ X_WB))
        self._rail.Lock(context)
        self._mount.Lock(context)

    def start(self, travelled: float, speed: float) -> None:
        """Set the hand `travelled` [m] along its motion, at a speed [m/s], without lag."""
        self._slider.set_translation(self._context, travelled)
        self._slider.set_translation_rate(self._context, speed)
        self.command(travelled, speed)

    def command(self, travelled: float, speed: float) -> None:
        """Command a position [m] along the motion and a speed [m/s]."""
        self._port.FixValue(self._context, [travelled, speed])

    def check(self) -> None:
        """Do nothing: a rail has no limits to exceed."""


def _rigid(X: FloatArray) -> RigidTransform:
    return RigidTransform(RotationMatrix(X[:3, :3]), X[:3, 3])
