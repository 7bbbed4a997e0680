"""An arm's part of a lift: its station, and the motion to where the approach begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from lis_grasp.arms.grasp_motion import plan_transit
from lis_grasp.arms.station import Station
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
    planned = plan_transit(
        station,
        estimate,
        grasp.X_OH,
        grasp.pregrasp_positions,
        grasp.joint_positions,
        rng=np.random.default_rng(_SEED),
        step=time_step,
    )
    if isinstance(planned, str):
        return "no_arm_motion"
    _, transit = planned
    return ArmLift(station, JointPath.of(transit, time_step))
