"""The true object of a run: its pose and its support."""

from __future__ import annotations

import numpy as np

from lis_grasp.exploration import (
    DEFAULT_REGION,
)
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.shapes import Shape, draw_pose
from lis_grasp.typing import FloatArray

_PLACE_STREAM = 3  # of random numbers, apart from those of the stages


def pose_of(shape: Shape, config: RunConfig) -> FloatArray | None:
    """Return the configured pose X_WO (4, 4) of the true object, in W; None if O stays its frame.

    `lis_grasp.shapes.placed` moves the object there. Its frame is then W, with the table at z = 0.
    """
    if config.pose is None:
        return None
    rng = np.random.default_rng([config.seed, _PLACE_STREAM])
    return draw_pose(shape, config.pose, config.region or DEFAULT_REGION, rng=rng)


def support_height(shape: Shape, config: RunConfig | None = None) -> float:
    """Return the height of the plane under the object [m]: the table, or its lowest point in O."""
    if config is not None and config.pose is not None:
        return 0.0
    return float(shape.mesh.bounds[0, 2])


def table_of(config: RunConfig, support: float | None) -> float | None:
    """Return the height of the table under the object [m]; None for one that is held in the air.

    Placed and free objects are on a table, and those of an arm: at the height of their `support`
    [m].
    """
    if config.pose is not None:
        return 0.0
    return support if config.free or config.arm is not None else None
