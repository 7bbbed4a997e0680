"""Where a hand starts a probe: one finger stretched out ahead, turned about the way it goes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidHandError
from lis_grasp.exploration.probe import Probe
from lis_grasp.grasping.hand import Hand, ProbePosture

FloatArray = npt.NDArray[np.float64]

# Rolls about the direction of motion that are tried to find a start that is free of the object.
_ROLLS = 8

NO_FREE_START = "no finger and turn of the hand is free at the start"

FREE_POINT_SPACING = 0.01
"""Distance between places that a tip is recorded to have passed [m]."""


def probe_postures(hand: Hand, finger: str | None) -> tuple[ProbePosture, ...]:
    """Return the postures to probe in, of one finger or, for None, of all, in the hand's order.

    Raises
    ------
    InvalidHandError
        If the hand has no probe posture (for that finger).
    """
    postures = hand.probe_postures
    if not postures or finger not in (None, *postures):
        raise InvalidHandError(
            f"touching needs a probe posture; hand '{hand.name}' has"
            f" {', '.join(postures) or 'none'}: add {finger or 'one'} to its YAML"
        )
    return tuple(postures.values()) if finger is None else (postures[finger],)


def hand_at_start(hand: Hand, posture: ProbePosture) -> FloatArray:
    """Return the palm's pose X_WH (4, 4): leading point at W's origin, leading to +x."""
    X_HL = hand.forward_kinematics(np.eye(4), posture.joint_positions)[posture.link]
    center = X_HL[:3, :3] @ posture.center_L + X_HL[:3, 3]
    X_WH = np.eye(4)
    X_WH[:3, :3] = _rotation_to_x(posture.direction_H)
    X_WH[:3, 3] = -X_WH[:3, :3] @ (center + posture.radius * posture.direction_H)
    return X_WH


def object_at_start(probe: Probe) -> Iterator[FloatArray]:
    """Yield poses X_WO (4, 4) of the object, one a roll: motion along +x, start at the origin."""
    for k in range(_ROLLS):
        X_WO = np.eye(4)
        X_WO[:3, :3] = _roll(2.0 * np.pi * k / _ROLLS) @ _rotation_to_x(probe.direction)
        X_WO[:3, 3] = -X_WO[:3, :3] @ probe.start
        yield X_WO


def free_points(probe: Probe, posture: ProbePosture, travelled: float) -> FloatArray:
    """Return places that the leading sphere's centre passed, shape (K, 3) [m], in O."""
    # The centre is a radius behind the leading point.
    steps = np.arange(0.0, travelled, FREE_POINT_SPACING)[:, None]  # (K, 1)
    return probe.start + (steps - posture.radius) * probe.direction


def _rotation_to_x(direction: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that takes the unit `direction` to +x."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    y = np.cross(direction, helper)
    y /= np.linalg.norm(y)
    return np.vstack([direction, y, np.cross(direction, y)])


def _roll(angle: float) -> FloatArray:
    """Return the rotation about +x by `angle` [rad], shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
