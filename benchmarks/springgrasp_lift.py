"""Simulated lift of a grasp by Cartesian springs at the fingertips, as SpringGrasp executes it.

The phases, scenes and criteria are those of `lis_grasp`; only the control of the fingers is not:
forces ``f = k (target - tip)`` pull each fingertip, ``tau = J^T f``, without any measured contact.
Its verify_grasp_robot.py doubles the planned stiffness, moves the springs' ends from the pregrasp
to the targets within a second, and then lifts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp import Grasp, Hand
from lis_grasp.lifting.finger_control import FingerControl
from lis_grasp.lifting.outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.scene import LiftingScene
from lis_grasp.lifting.setup import LiftSetup
from lis_grasp.lifting.trial import LiftTrial
from lis_grasp.simulation.drake.lift import LiftScene
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.simulation.mujoco.lift import MujocoScene
from lis_grasp.typing import FloatArray

_STIFFENED = 2.0  # times the planned compliance
_PULL_TIME = 1.0  # [s], ten steps of 0.1 s


@dataclass(frozen=True, slots=True)
class Springs:
    """Springs at the fingertips: their ends (F, 3) in W, and stiffnesses (F,) [N/m]."""

    starts: FloatArray
    targets: FloatArray
    stiffnesses: FloatArray


class SpringControl(FingerControl):
    """Closes a hand to the grasp's posture, then pulls the fingertips towards targets."""

    def __init__(self, scene: LiftingScene, setup: LiftSetup, springs: Springs) -> None:
        super().__init__(scene, setup)
        X_HW = np.linalg.inv(setup.grasp.X_OH)
        ends = np.stack([springs.starts, springs.targets])  # (2, F, 3)
        self._ends_H = ends @ X_HW[:3, :3].T + X_HW[:3, 3]
        self._stiffnesses = _STIFFENED * springs.stiffnesses
        self._part = 0.0

    def close(self, elapsed: float, interval: float) -> bool:
        part = elapsed / self._closing_time
        if part < 1.0:
            posture = self._start + part * (self._goal - self._start)
            self._scene.command_fingers(posture, np.zeros(len(posture)))
            return False
        self._part = min((elapsed - self._closing_time) / _PULL_TIME, 1.0)
        self.hold()
        measured = self._contacts_by_finger()
        for finger in self._planned_normals:
            contact = self._strongest(measured.get(finger, []))
            if contact is not None:
                self._contacts[finger] = contact
        return self._part >= 1.0

    def squeeze(self, fraction: float) -> None:
        self.hold()

    def hold(self) -> None:
        """Pull with the springs; the joints only damp."""
        X_WH = self._scene.X_WH
        ends_H = self._ends_H[0] + self._part * (self._ends_H[1] - self._ends_H[0])
        ends = ends_H @ X_WH[:3, :3].T + X_WH[:3, 3]
        q = self._scene.joint_positions
        efforts = np.zeros(len(q))
        for pad, end, stiffness in zip(self._hand.pads, ends, self._stiffnesses, strict=True):
            X_WL, joints = self._scene.X_WL(pad.link), self._joints[pad.finger]
            tip = X_WL[:3, :3] @ pad.center_L + X_WL[:3, 3]
            J = self._scene.jacobian(pad.link, pad.center_L)[:, joints]
            efforts[joints] += J.T @ (stiffness * (end - tip))
        limits = self._hand.effort_limits
        self._scene.command_fingers(q, np.clip(efforts, -limits, limits))

    def carry(self, mass: float) -> None:
        """Do nothing: the springs do not know the weight."""

    def grip_harder(self, factor: float) -> None:
        """Do nothing: the springs are as planned."""


@dataclass(frozen=True, slots=True)
class LiftedObject:
    """An object on a table at its lowest point."""

    mesh: trimesh.Trimesh
    mass: float
    friction: float

    def lift(
        self,
        simulator: str,
        hand: Hand,
        grasp: Grasp,
        options: LiftOptions,
        springs: Springs | None = None,
    ) -> LiftOutcome:
        """Simulate a lift: the trial of `lis_grasp.pipeline.lift`, or one with springs."""
        floor = float(self.mesh.bounds[0, 2])
        mass, friction = self.mass, self.friction
        setup = LiftSetup(self.mesh, hand, grasp, floor, mass, friction, options, np.eye(4))
        in_mujoco = simulator == "mujoco"
        scene = MujocoScene(setup, convex_pieces(self.mesh)) if in_mujoco else LiftScene(setup)
        control = None if springs is None else SpringControl(scene, setup, springs)
        return LiftTrial(scene, setup, None, control).run()
