"""Simulate a lift in MuJoCo: approach, close, squeeze, lift and shake the true object."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.io.optional_packages import needed_package
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.lift_setup import LiftSetup
from lis_grasp.lifting.lift_trial import AcceptGrasp, LiftTrial
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.mujoco.convex_pieces import convex_pieces
from lis_grasp.typing import FloatArray

with needed_package("mujoco", "mujoco", option="the simulator mujoco"):
    from lis_grasp.simulation.mujoco.mujoco_scene import MujocoScene


def simulate_in_mujoco(
    mesh: trimesh.Trimesh,
    hand: Hand,
    grasp: Grasp,
    *,
    support_height: float,
    mass: float = 0.2,
    friction: float = 0.8,
    options: LiftOptions | None = None,
    accept_grasp: AcceptGrasp | None = None,
    X_WO: FloatArray | None = None,
) -> LiftOutcome:
    """Execute one grasp on the true, free object in MuJoCo, and return whether it holds.

    Phases, control, outcome and arguments are those of `simulate_lift`, which uses Drake.

    Contact model: points with elliptic friction cones and torsional friction, MuJoCo's soft
    constraints. The object is a union of convex pieces (`convex_pieces`), with the mass and inertia
    of its mesh; links of the hand do not collide with each other.

    Raises
    ------
    InvalidMeshError, InvalidOptionError
        As `simulate_lift`.
    """
    pose = np.eye(4) if X_WO is None else X_WO
    options = options or LiftOptions()
    setup = LiftSetup(mesh, hand, grasp, support_height, mass, friction, options, pose)
    scene = MujocoScene(setup, convex_pieces(mesh))
    return LiftTrial(scene, setup, accept_grasp).run()
