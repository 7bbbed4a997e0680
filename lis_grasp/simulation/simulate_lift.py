"""Simulate a lift in Drake: approach, close, squeeze, lift and shake the true object."""

from __future__ import annotations

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.hands.hand import Hand
from lis_grasp.lifting.lift_outcome import LiftOptions, LiftOutcome, Reason
from lis_grasp.simulation.lift_trial import AcceptGrasp, LiftTrial
from lis_grasp.typing import FloatArray

__all__ = ["AcceptGrasp", "LiftOptions", "LiftOutcome", "Reason", "simulate_lift"]


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
) -> LiftOutcome:
    """Execute one grasp on the true, free object, and say whether it holds.

    The object stands on a table. The hand comes along a straight line in the pregrasp posture,
    closes each finger until it feels the object (the grasp was planned on an estimate that is off
    by millimetres), squeezes with forces that balance each other at the felt contacts, lifts,
    shakes and holds. The trial ends early once the grasp has failed.

    Contact model: hydroelastic, in Drake's discrete solver with the "lagged" approximation. The
    object is its exact rigid mesh, never its hull; all links of the hand and the table are
    compliant; links of the hand pass through each other. The same friction coefficient holds
    between object and hand and between object and table.

    Parameters
    ----------
    mesh
        The true object in its frame O, upright [m]; watertight.
    hand
        The hand that the grasp is for.
    grasp
        What to execute, in O.
    support_height
        Height of the table's top in O [m].
    mass, friction
        Of the object [kg], and Coulomb's coefficient.
    options
        How the trial is run and judged; None for the defaults.
    accept_grasp
        Asked, once the fingers have closed and before they squeeze, whether to go on with the
        contacts that they feel, at times one or none; if not, the hand opens and goes back. A hand
        with `accept_grasp` also stops and goes back where it touches the object on its way.
    X_WO
        Shape (4, 4): where the object really stands, in the frame that the grasp was planned in;
        None for just there.

    Raises
    ------
    InvalidMeshError
        If the mesh is not watertight: it has no volume to weigh.
    InvalidOptionError
        If mass or friction is not positive, or the grasp is for another hand.
    """
    if not mesh.is_watertight:
        raise InvalidMeshError("a grasp trial needs a watertight mesh: load it with `shapes.load`")
    if not (0.0 < mass < np.inf and 0.0 < friction < np.inf):
        raise InvalidOptionError(
            f"mass and friction must be positive; they are {mass:g} kg and {friction:g}"
        )
    if tuple(grasp.joint_names) != tuple(hand.joint_names):
        raise InvalidOptionError(
            f"the grasp is for the joints of '{grasp.hand}', not for those of '{hand.name}'"
        )
    options = options or LiftOptions()
    trial = LiftTrial(
        mesh,
        hand,
        grasp,
        support_height=support_height,
        mass=mass,
        friction=friction,
        options=options,
        accept_grasp=accept_grasp,
        X_WO=X_WO,
    )
    return trial.run()
