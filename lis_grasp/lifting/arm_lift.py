"""An arm's part of a lift: its station, and the motion to where the approach begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.arms.reach_filter import ReachFilter
from lis_grasp.arms.station import Station
from lis_grasp.arms.station_home import home_of
from lis_grasp.grasping.grasps import Grasp
from lis_grasp.lifting.joint_path import JointPath, straight_joint_path
from lis_grasp.lifting.lift_outcome import Reason


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
    reach = ReachFilter(station, estimate)
    pose, opened = np.array([grasp.X_OH]), np.array([grasp.pregrasp_positions])
    (motion,) = reach.plan(pose, opened, np.array([grasp.joint_positions]))
    if motion is None:
        return "no_arm_motion"
    transit = straight_joint_path(station.arm, home_of(station), motion.standoff, step=time_step)
    return ArmLift(station, transit)
