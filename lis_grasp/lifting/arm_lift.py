"""An arm's part of a lift: its station, and the motion to where the approach begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.arms.reach_filter import ReachFilter
from lis_grasp.arms.station import Station
from lis_grasp.arms.station_home import home_of
from lis_grasp.arms.time_scaling import time_path
from lis_grasp.arms.transit import TransitPlanner
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.joint_path import JointPath
from lis_grasp.lifting.lift_outcome import Reason

# The same transit is planned for the same grasp.
_SEED = 0


@dataclass(frozen=True, slots=True, eq=False)
class ArmLift:
    """Station and transit of a lift.

    Parameters
    ----------
    station
        The arm with its base, the hand on its flange.
    transit
        Joint path from the arm's home to where the straight approach begins.
    """

    station: Station
    transit: JointPath


def plan_arm_lift(
    station: Station, grasp: Grasp, estimate: trimesh.Trimesh | None, *, time_step: float
) -> ArmLift | Reason:
    """Return the arm's part of a lift, or the reason that there is none.

    The arm avoids the table and the `estimate` of the object; None for no object. Its path has a
    sample each `time_step` [s].
    """
    opened = np.asarray(grasp.pregrasp_positions)
    reach = ReachFilter(station, estimate)
    pose, closed = np.array([grasp.X_OH]), np.array([grasp.joint_positions])
    (motion,) = reach.plan(pose, opened[None], closed)
    if motion is None:
        return "no_arm_motion"
    planner = TransitPlanner(station, estimate)
    rng = np.random.default_rng(_SEED)
    corners = planner.plan(home_of(station), motion.standoff, opened, rng=rng)
    if corners is None:
        return "no_arm_motion"
    transit = time_path(
        station.arm,
        corners,
        is_free=lambda path: planner.is_free(path, opened),
        step=time_step,
    )
    return ArmLift(station, JointPath.of(transit, time_step))
