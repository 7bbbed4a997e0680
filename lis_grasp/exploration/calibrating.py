"""Touches of seen surface, which show where the camera was."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.targets import Targets
from lis_grasp.typing import FloatArray

# Seen contacts whose deviation along their normals is larger are worth a touch [m]: three times
# the noise of one.
_UNCERTAIN = 0.0015
# Touches of seen surface at most: each has another direction.
_MOST = 2
# Surface within this distance of a seen contact was seen [m], and is flat if all normals within
# twice the distance agree so well, as a cosine: beside an edge a touch may be of the other face.
_NEAR, _FLAT = 0.006, 0.9


def calibrating_target(targets: Targets, seen: Contacts, touches: int) -> int | None:
    """Return the target that says most about the place of what was seen, after some touches.

    It is where the place of a seen contact is least certain along its normal, on a flat part: the
    camera's error is common to all, so that each touch makes others certain, too. None if the place
    is known, or enough such touches were made.
    """
    if touches >= _MOST or not len(seen) or seen.position_noise is None:
        return None
    uncertain = seen.position_noise > _UNCERTAIN
    if not uncertain.any():
        return None
    distances, nearest = cKDTree(seen.points).query(targets.points)
    chosen = targets.eligible & (distances < _NEAR) & uncertain[nearest]
    chosen &= _is_flat(targets.points, targets.normals, seen)
    if not chosen.any():
        return None
    return int(np.argmax(np.where(chosen, seen.position_noise[nearest], 0.0)))


def _is_flat(points: FloatArray, normals: FloatArray, seen: Contacts) -> FloatArray:
    """Return whether all seen normals about points (P, 3) are like those there (P, 3), (P,)."""
    near = cKDTree(seen.points).query_ball_point(points, 2.0 * _NEAR)
    return np.array(
        [
            bool(len(rows)) and bool((seen.normals[rows] @ normal > _FLAT).all())
            for rows, normal in zip(near, normals, strict=True)
        ]
    )
