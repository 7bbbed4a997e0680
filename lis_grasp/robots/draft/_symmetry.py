"""Symmetry of a hand: fingers whose joints are alike, and pads at equal angles about an axis."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lis_grasp.geometry import cross, unit
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.schema import FEW_DIGITS
from lis_grasp.typing import FloatArray

_SYMMETRIC = 0.001  # by which a turned pad may miss the next one [m]


def symmetry_axis(hand: Hand, q: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return a point (3,) [m] on the pads' axis of symmetry and its direction (3,), unit, in H.

    Three pads or more have one if a turn by 2 pi / F about it moves each pad onto the next one,
    both its centre and, one radius of their circle further on, its axis. None otherwise.
    """
    centers, axes = hand.pad_centers(np.eye(4), q), hand.pad_axes(np.eye(4), q)  # (F, 3)
    count, middle = len(centers), centers.mean(axis=0)
    arms = centers - middle
    if count < 3 or np.linalg.norm(arms[0]) < _SYMMETRIC:
        return None
    normal = np.linalg.svd(arms)[2][2]
    first = unit(arms[0])
    angles = np.arctan2(arms @ cross(normal, first), arms @ first)
    order = np.argsort(np.mod(angles + 0.5 * np.pi / count, 2.0 * np.pi))
    turn = Rotation.from_rotvec(2.0 * np.pi / count * normal)
    reach = np.linalg.norm(arms, axis=1).mean()
    for vectors in (arms, reach * axes):
        missed = turn.apply(vectors[order]) - vectors[np.roll(order, -1)]
        if np.linalg.norm(missed, axis=1).max() > _SYMMETRIC:
            return None
    return middle, normal


def alike(hand: Hand, q: FloatArray) -> FloatArray | None:
    """Return the posture (J,) nearest to q in which all fingers are bent alike.

    None unless the fingers have as many joints each, none of them shared, with the same limits.
    """
    rows = [hand.finger_joints(finger) for finger in hand.fingers]
    if len({len(row) for row in rows}) != 1 or len(set(sum(rows, ()))) != sum(map(len, rows)):
        return None
    table = np.array(rows)  # (F, K)
    limits = np.stack([hand.lower[table], hand.upper[table]])  # (2, F, K)
    if not table.size or np.ptp(limits, axis=1).max() > FEW_DIGITS:
        return None
    bent = q.copy()
    bent[table] = q[table].mean(axis=0)
    return bent
