"""Free wrist: a Drake system that pulls a floating hand to a pose by implicit PD control."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, LeafSystem

from lis_grasp.geometry import cross_matrix
from lis_grasp.typing import FloatArray

# Critical damping at this angular frequency [rad/s]: the hand lags by 50 ms.
_FREQUENCY = 40.0


class PdWrist(LeafSystem):
    """Pulls a floating body, and all that it carries, to a desired pose: a critically damped PD.

    Input ports ``X_WG`` (the desired pose), ``body_poses`` and ``body_spatial_velocities``; the
    output port is for the plant's ``applied_spatial_force``.

    With the spatial inertia M about the body's frame, error e and velocity V, a spring of frequency
    w pulls with ``M (w^2 e - 2 w V)``. Drake applies that force through a whole time step h, and an
    explicit spring is unstable at long ones. The force here is the one at the end of the step,
    where ``V' = V + h F / M`` and ``e' = e - h V'``::

        F = M (w^2 e - w (2 + h w) V) / (1 + h w)^2

    which is stable at every step (backward Euler), and is the spring itself in a continuous plant.

    Parameters
    ----------
    body
        The floating body, in a finalized plant.
    carried
        All bodies whose weight the wrist moves, with the first one among them.
    """

    def __init__(self, body: RigidBody, carried: Sequence[RigidBody]) -> None:
        super().__init__()
        make = AbstractValue.Make
        self._body, self._step = body.index(), body.GetParentPlant().time_step()
        self._carried = [each.index() for each in carried]
        inertias = [each.default_spatial_inertia() for each in carried]
        self._masses = np.array([each.get_mass() for each in inertias])  # (B,)
        self._centers = np.array([each.get_com() for each in inertias])  # (B, 3)
        self._rotational = np.array(
            [
                each.Shift(each.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
                for each in inertias
            ]
        )  # (B, 3, 3)
        self._goal = self.DeclareAbstractInputPort("X_WG", make(RigidTransform()))
        self._poses = self.DeclareAbstractInputPort("body_poses", make([RigidTransform()]))
        self._velocities = self.DeclareAbstractInputPort(
            "body_spatial_velocities", make([SpatialVelocity()])
        )
        force = ExternallyAppliedSpatialForce()
        self.DeclareAbstractOutputPort("forces", lambda: make([force]), self._pull)

    def _pull(self, context: Context, output: AbstractValue) -> None:
        goal, poses = self._goal.Eval(context), self._poses.Eval(context)
        X, V = poses[self._body], self._velocities.Eval(context)[self._body]
        turn = (goal.rotation() @ X.rotation().inverse()).ToAngleAxis()
        error = np.append(turn.angle() * turn.axis(), goal.translation() - X.translation())
        velocity = np.append(V.rotational(), V.translational())
        w, h = _FREQUENCY, self._step
        acceleration = (w**2 * error - w * (2.0 + h * w) * velocity) / (1.0 + h * w) ** 2
        pull = self._inertia(poses) @ acceleration
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._body
        force.F_Bq_W = SpatialForce(tau=pull[:3], f=pull[3:])
        output.set_value([force])

    def _inertia(self, poses: Sequence[RigidTransform]) -> FloatArray:
        """Return the spatial inertia (6, 6) about the body's frame, in W; rotations first."""
        X = np.array([poses[index].GetAsMatrix4() for index in self._carried])
        R = X[:, :3, :3]
        centers = X[:, :3, 3] + np.einsum("bij,bj->bi", R, self._centers)
        levers = cross_matrix(centers - poses[self._body].translation())
        moved = self._masses[:, None, None] * levers
        M = np.zeros((6, 6))
        M[:3, :3] = np.einsum("bij,bjk,blk->il", R, self._rotational, R)
        M[:3, :3] -= np.einsum("bij,bjk->ik", moved, levers)
        M[:3, 3:] = moved.sum(axis=0)
        M[3:, :3] = M[:3, 3:].T
        M[3:, 3:] = self._masses.sum() * np.eye(3)
        return M
