"""Fraction of planned contact forces that the joint efforts of a hand can exert."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lis_grasp.robots.hand import Hand
from lis_grasp.typing import FloatArray

EFFORT_FRACTION = 0.9
"""Fraction of the joint efforts for a squeeze: the springs need some to keep the posture."""


def grip_fraction(
    hand: Hand, X_OH: npt.ArrayLike, q: npt.ArrayLike, fingers: Sequence[str], forces: FloatArray
) -> float:
    """Return the largest fraction, at most 1, of contact forces that a hand can exert.

    Joint efforts are ``tau = J^T f`` with the Jacobian J of the pads' centres: a force along the
    normal of a round pad passes through its centre. No effort exceeds 0.9 of its limit, and no
    normal force the hand's largest contact force if the forces are scaled so already.

    Parameters
    ----------
    hand
        The hand.
    X_OH, q
        Shapes (4, 4) and (J,): pose of the palm in O, and the joint positions [rad or m].
    fingers
        C names: which finger exerts each force.
    forces
        Shape (C, 3) [N]: forces on the object, in O.
    """
    _, _, jacobian, _ = hand.pad_jacobians(X_OH, q)  # (F, 3, 6 + J)
    efforts = np.zeros(jacobian.shape[-1] - 6)
    for finger, force in zip(fingers, forces, strict=True):
        efforts += jacobian[hand.fingers.index(finger), :, 6:].T @ force
    load = float(np.max(np.abs(efforts) / (EFFORT_FRACTION * hand.effort_limits), initial=0.0))
    return 1.0 / max(load, 1.0)
