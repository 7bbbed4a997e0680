"""An arm's part of a lift: its station, and the motion to where the approach begins."""

from __future__ import annotations

from dataclasses import dataclass

from lis_grasp.arms.station import Station
from lis_grasp.lifting.joint_path import JointPath


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
