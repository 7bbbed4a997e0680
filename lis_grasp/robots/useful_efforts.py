"""Efforts of a hand's joints that its largest contact force can need."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_tree import by_joint_kind
from lis_grasp.typing import FloatArray

_RESERVE = 3.0  # times the effort that the largest contact force needs


def useful_efforts(hand: Hand, q: npt.ArrayLike) -> FloatArray:
    """Return the joints' effort limits (J,) [N m or N], without what no contact force needs.

    Files often give efforts far above those of the real motors. Three times the largest contact
    force, at the longest lever of a pad about a joint of that kind, is the most that counts.

    Parameters
    ----------
    hand
        The hand.
    q
        Shape (J,): the joint positions [rad or m] in which the levers are taken.
    """
    _, _, jacobian, _ = hand.pad_jacobians(np.eye(4), q)  # (F, 3, 6 + J)
    levers = np.linalg.norm(jacobian[:, :, 6:], axis=1).max(axis=0)  # (J,) [m or 1]
    turning = by_joint_kind(hand, revolute=1.0, prismatic=0.0) > 0.0
    for kind in (turning, ~turning):
        levers[kind] = levers[kind].max(initial=0.0)
    return np.minimum(hand.effort_limits, _RESERVE * hand.max_contact_force * levers)
