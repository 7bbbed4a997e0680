"""Simulate a lift in Drake: approach, close, squeeze, lift and shake the true object."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.arm_lift import ArmLift
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome
from lis_grasp.lifting.lift_setup import LiftSetup
from lis_grasp.lifting.lift_trial import AcceptGrasp, LiftTrial
from lis_grasp.robots.hand import Hand
from lis_grasp.simulation.drake.arm_carrier import ArmCarrier
from lis_grasp.simulation.drake.arm_lift_trial import ArmLiftTrial
from lis_grasp.simulation.drake.lift_scene import LiftScene
from lis_grasp.typing import FloatArray


def simulate_lift(
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
    arm: ArmLift | None = None,
) -> LiftOutcome:
    """Execute one grasp on the true, free object, and return whether it holds.

    The object rests on a table. The hand approaches along a straight line in the pregrasp posture.
    Each finger closes until it touches the object: the grasp was planned on an estimate that is
    off by millimetres. The fingers squeeze with forces that balance each other at the measured
    contacts; the hand lifts, shakes and holds. The trial ends early once the grasp has failed.

    Contact model: hydroelastic, in Drake's discrete solver with the "lagged" approximation. The
    object is its exact rigid mesh, never its hull; all links of the hand and the table are
    compliant; links of the hand do not collide with each other. One friction coefficient applies
    between object and hand and between object and table.

    Parameters
    ----------
    mesh
        The true object in its frame O, upright [m]; watertight.
    hand
        The hand of the grasp.
    grasp
        The grasp, in O.
    support_height
        Height of the table's top in O [m].
    mass, friction
        Mass of the object [kg], and Coulomb's coefficient.
    options
        Options of the trial; None for the defaults.
    accept_grasp
        Tactile check: called with the contacts of the closed fingers, if any, before they squeeze;
        if it returns False, the hand opens and retreats. A hand with a tactile check also stops and
        retreats if it touches the object on its approach.
    X_WO
        Shape (4, 4): true pose of the object in the frame in which the grasp was planned; None for
        the identity.
    arm
        The arm that carries the hand, with its path to where the approach begins. It stops at a
        contact of its own links or when a joint needs more than its largest effort. It shakes as
        far as its limits allow, and forces on the object make up for the rest. None for a free
        wrist.

    Raises
    ------
    InvalidMeshError
        If the mesh is not watertight: it has no volume to weigh.
    InvalidOptionError
        If mass or friction is not positive, or the grasp is for another hand.
    """
    setup = LiftSetup(
        mesh,
        hand,
        grasp,
        support_height,
        mass,
        friction,
        options or LiftOptions(),
        np.eye(4) if X_WO is None else X_WO,
        arm,
    )
    scene = LiftScene(setup)
    if isinstance(scene.carrier, ArmCarrier):
        return ArmLiftTrial(scene, scene.carrier, setup, accept_grasp).run()
    return LiftTrial(scene, setup, accept_grasp).run()
