"""Check of poses: rigid transforms of shape (4, 4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.records import read_only
from lis_grasp.typing import FloatArray

# Rounding in products of rotations is far below this.
_ROTATION_TOLERANCE = 1e-6


def checked_pose(name: str, X: npt.ArrayLike) -> FloatArray:
    """Return a read-only copy of a pose of that name, such as ``"X_OH"``, shape (4, 4).

    Raises
    ------
    InvalidOptionError
        If it is not a rigid transform of finite numbers.
    """
    try:
        pose = np.array(X, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (4, 4) or not are_rigid(pose):
        required = "a rigid transform of 4 x 4 finite numbers"
        raise InvalidOptionError.out_of_range(name, X, required)
    return read_only(pose)


def are_rigid(poses: FloatArray) -> bool:
    """Return whether all matrices, shape (..., 4, 4), are finite rotations with translations."""
    rotations = poses[..., :3, :3]
    error = np.abs(rotations @ rotations.swapaxes(-1, -2) - np.eye(3))
    return bool(
        np.isfinite(poses).all()
        and (poses[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
        and (error <= _ROTATION_TOLERANCE).all()
        and (np.linalg.det(rotations) > 0.0).all()
    )
