"""Reach of an arm for probes: straight approach, guarded motion and retreat without collision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lis_grasp.arms.reach_filter import best_solutions
from lis_grasp.arms.station import Station
from lis_grasp.arms.station_collision import StationChecker
from lis_grasp.arms.straight_motion import track
from lis_grasp.typing import BoolArray, FloatArray

# Points (P, 3) -> which are inside of what is known, (P,).
Occupied = Callable[[FloatArray], BoolArray]

_SEEDS, _KEPT = 4, 2  # seeds of a pose; its solutions that are tried


@dataclass(frozen=True, slots=True, eq=False)
class ArmProbe:
    """Joint positions of an arm for one probe, J joints."""

    approach: FloatArray  # (S, J): straight, up to the start of the probe
    motion: FloatArray  # (M, J): the guarded motion, from there to its end


class ProbeReach:
    """Finds which poses of the hand at the start of a probe an arm can carry out, and how.

    The arm has to follow the straight approach and the guarded motion within joint limits, and to
    collide with neither table, nor itself, nor what is known of the object.
    """

    def __init__(self, station: Station) -> None:
        self._station = station
        self._checker = StationChecker(station, arm_only=True)

    def first(
        self,
        X_WH: FloatArray,
        q_hand: FloatArray,
        *,
        approach: FloatArray,
        motion: FloatArray,
        occupied: Occupied,
    ) -> tuple[int, ArmProbe] | None:
        """Return the first of R poses that the arm can carry out, with its joint positions.

        Parameters
        ----------
        X_WH
            Shape (R, 4, 4): the palm's poses at the start of the probe.
        q_hand
            Shape (R, K): the hand's joint positions.
        approach
            Shape (R, 3) [m], in W: translations of the approaches to the start.
        motion
            Shape (3,) [m], in W: translation of the probe.
        occupied
            Says which points are inside of known object, which the arm must avoid. The hand is
            not checked.
        """
        station = self._station
        solutions = station.solve_ik(X_WH, seeds=_SEEDS, first=station.arm.home)
        pose, q = best_solutions(station, solutions, kept=_KEPT)
        if not len(q):
            return None
        back = track(station, q, X_WH[pose], -approach[pose])
        ahead = track(station, q, X_WH[pose], motion)
        for i in np.flatnonzero(back.followed & ahead.followed):
            found = ArmProbe(back.q[i, ::-1], ahead.q[i])
            ends = np.array([found.approach[0], found.motion[0], found.motion[-1]])
            path = np.concatenate([ends, found.approach[1:-1:3], found.motion[1:-1:3]])
            if not self._checker.free(path, q_hand[pose[i]]).all():
                continue
            if not occupied(self._checker.arm_points(path)).any():
                return int(pose[i]), found
        return None
