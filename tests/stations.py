"""Stations for tests of arms: the shipped arm beside a table."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.trajectory import JointTrajectory
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand


def station_with(hand: str) -> Station:
    """Return the shipped arm with a hand, its base 0.55 m behind the middle of the table."""
    X_WA = np.eye(4)
    X_WA[:3, 3] = -0.55, 0.0, 0.2
    return Station.make(Arm.load("iiwa14"), Hand.load(hand), X_WA, table=Table())


def positions_between(motion: JointTrajectory, step: float) -> np.ndarray:
    """Return the positions of a trajectory every `step` seconds, by SciPy's Hermite spline."""
    spline = CubicHermiteSpline(motion.times, motion.positions, motion.velocities)
    return np.asarray(spline(np.arange(0.0, motion.duration, step)))
