"""Touches of seen surface, which show where the camera was."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.targets import Targets

# Seen contacts whose deviation along their normals is larger are worth a touch [m]: twice the noise
# of one.
_UNCERTAIN = 0.001
# Touches of seen surface are the first of all and every third one, up to this one.
_EVERY, _LAST = 3, 7
# Surface within this distance of a seen contact was seen [m].
_NEAR = 0.006


def calibrating_target(targets: Targets, seen: Contacts, touches: int) -> int | None:
    """Return the target that says most about the place of what was seen, after some touches.

    It is where the place of a seen contact is least certain along its normal: the camera's error is
    common to all, so that each touch makes others certain, too. None if the place is known, after
    enough such touches, and where it is the turn of a touch of what was not seen.
    """
    if touches % _EVERY or touches >= _LAST or not len(seen) or seen.position_noise is None:
        return None
    uncertain = seen.position_noise > _UNCERTAIN
    distances, nearest = cKDTree(seen.points).query(targets.points)
    chosen = targets.eligible & (distances < _NEAR) & uncertain[nearest]
    if not chosen.any():
        return None
    return int(np.argmax(np.where(chosen, seen.position_noise[nearest], 0.0)))
