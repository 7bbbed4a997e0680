"""Wrist of a floating hand in the user's Diagram: forces that pull it to a desired pose."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem

# Critical damping at this angular frequency [rad/s]: the hand lags by 50 ms.
_FREQUENCY = 40.0
# Radius of gyration of a hand about its base link's frame [m].
_GYRATION = 0.07


class PdWrist(LeafSystem):
    """Pulls a floating body of a mass [kg] to a desired pose: a critically damped spring.

    Input ports ``X_WG`` (the desired pose), ``body_poses`` and ``body_spatial_velocities``; the
    output port is for the plant's ``applied_spatial_force``.
    """

    def __init__(self, body: BodyIndex, mass: float) -> None:
        super().__init__()
        make = AbstractValue.Make
        self._body, self._inertia = body, mass * np.repeat([_GYRATION**2, 1.0], 3)
        self._goal = self.DeclareAbstractInputPort("X_WG", make(RigidTransform()))
        self._poses = self.DeclareAbstractInputPort("body_poses", make([RigidTransform()]))
        self._velocities = self.DeclareAbstractInputPort(
            "body_spatial_velocities", make([SpatialVelocity()])
        )
        force = ExternallyAppliedSpatialForce()
        self.DeclareAbstractOutputPort("forces", lambda: make([force]), self._pull)

    def _pull(self, context: Context, output: AbstractValue) -> None:
        goal, X = self._goal.Eval(context), self._poses.Eval(context)[self._body]
        V = self._velocities.Eval(context)[self._body]
        turn = (goal.rotation() @ X.rotation().inverse()).ToAngleAxis()
        error = np.append(turn.angle() * turn.axis(), goal.translation() - X.translation())
        velocity = np.append(V.rotational(), V.translational())
        pull = self._inertia * (_FREQUENCY**2 * error - 2.0 * _FREQUENCY * velocity)
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body
        force.F_Bq_W = SpatialForce(tau=pull[:3], f=pull[3:])
        output.set_value([force])
