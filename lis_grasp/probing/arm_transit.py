"""Transits of an arm between its home and where the approaches of probes begin."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import trimesh

from lis_grasp.arms.joint_trajectory import JointTrajectory
from lis_grasp.arms.station import Station
from lis_grasp.arms.station_home import home_of
from lis_grasp.arms.time_scaling import time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.typing import FloatArray

# The leading fingertip of an approach begins at the ball that contains the object: transits keep
# off a ball that is smaller by these [m], and where the hand begins inside, by fractions of it.
_INSIDE = (0.015, 0.03)
_FRACTIONS = (0.6, 0.3)
# The same transit is planned for the same probe.
_SEED = 0


class ArmTransits:
    """Plans an arm's way from home to the approach of each probe, outside of the object's ball.

    What is in the ball is unknown, and only approach and probe enter it. The arm returns the same
    way, so that a probe does not depend on the one before.
    """

    def __init__(self, station: Station) -> None:
        self._station, self._home = station, home_of(station)
        self._planners: dict[tuple[float, ...], TransitPlanner] = {}

    def plan(
        self, goal: FloatArray, q_hand: FloatArray, space: Workspace
    ) -> JointTrajectory | None:
        """Return the motion from home to a posture (J,); None if there is no path.

        `q_hand` (K,) are the hand's joint positions.
        """
        radii = [space.radius - inside for inside in _INSIDE]
        for radius in [*radii, *(fraction * radii[-1] for fraction in _FRACTIONS)]:
            planner = self._planner(space, radius)
            rng = np.random.default_rng(_SEED)
            corners = planner.plan(self._home, goal, q_hand, rng=rng)
            if corners is not None:
                return time_path(
                    self._station.arm,
                    corners,
                    is_free=partial(planner.is_free, q_hand=q_hand),
                )
        return None

    def _planner(self, space: Workspace, radius: float) -> TransitPlanner:
        in_air = space.support_height is None
        key = (*space.center, radius, in_air)
        if key not in self._planners:
            if len(self._planners) >= len(_INSIDE) + len(_FRACTIONS):
                self._planners.clear()
            ball = None
            if radius > 0.0:
                ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
                ball.apply_translation(space.center)
            # An object that is held in the air is touched without a table.
            station = replace(self._station, table=None) if in_air else self._station
            self._planners[key] = TransitPlanner(station, ball)
        return self._planners[key]
