"""Gains of the wrist's and the fingers' joint control in a simulated lift."""

from __future__ import annotations

from lis_grasp.grasping.grasps import Grasp
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.link_tree import by_joint_kind
from lis_grasp.robots.useful_efforts import useful_efforts
from lis_grasp.typing import FloatArray

# A hand of 1 kg follows 1 g within 1 mm.
WRIST_STIFFNESS = (2e4, 3e2)
"""Of the wrist's prismatic and revolute joints [N/m, N m/rad]."""
WRIST_DAMPING = (4e2, 6.0)
"""Of the wrist's prismatic and revolute joints [N s/m, N m s/rad]."""
WRIST_LIMITS = (150.0, 15.0)
"""Largest efforts of the wrist's prismatic and revolute joints [N, N m]."""

# Joint error at which a finger's spring gives full effort: it yields to errors of the estimate.
_FULL_EFFORT_ERROR = {"revolute": 0.1, "prismatic": 0.01}  # [rad], [m]
_DAMPING_TIME = 0.035  # [s], damping by stiffness


def finger_gains(hand: Hand, grasp: Grasp) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and damping of the joints, each (J,) [N m/rad, N m s/rad; N/m, N s/m]."""
    errors = by_joint_kind(hand, **_FULL_EFFORT_ERROR)
    stiffness = useful_efforts(hand, grasp.joint_positions) / errors
    return stiffness, _DAMPING_TIME * stiffness
