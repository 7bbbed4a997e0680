"""Home posture of a station: the hand above the table, clear of everything."""

from __future__ import annotations

import numpy as np

from lis_grasp.arms.base_search import palm_targets
from lis_grasp.arms.reach_filter import best_solutions
from lis_grasp.arms.station import Station, Table
from lis_grasp.arms.station_collision import StationChecker
from lis_grasp.exceptions import InvalidArmError
from lis_grasp.typing import FloatArray

HEADROOM = 0.25
"""Least height of the hand above the table at home [m]: objects are below it."""

# Heights of the pads above the table that are tried where the arm's own home is not free [m].
_HEIGHTS = (0.35, 0.45, 0.3, 0.55)
_SEEDS, _KEPT = 8, 4


def home_of(station: Station) -> FloatArray:
    """Return the arm's home (J,) if the hand is high and free there, else a posture that is.

    It is free in every pregrasp and probe posture of the hand. Such a posture has the hand pointing
    down, or obliquely, above the middle of the table.

    Raises
    ------
    InvalidArmError
        If there is none: the base is too far from the table, for example.
    """
    checker = StationChecker(station)
    if _is_home(station, checker, station.arm.home):
        return station.arm.home
    table = station.table or Table()
    for height in _HEIGHTS:
        center = np.array([*table.center, table.height + height])
        targets = palm_targets(station.hand, center, (0.0, 0.0, 0.0), each=1)
        for turned in targets.swapaxes(0, 1):
            solutions = station.solve_ik(turned, seeds=_SEEDS, first=station.arm.home)
            for q in best_solutions(station, solutions, kept=_KEPT)[1]:
                if _is_home(station, checker, q):
                    return q
    raise InvalidArmError(
        f"arm {station.arm.name} must have a home posture with hand {station.hand.name} above the"
        f" table; none was found from its base at {np.round(station.X_WA[:3, 3], 3).tolist()}: move"
        " the base nearer to the object, or give home in the arm's YAML",
        key="home",
    )


def _is_home(station: Station, checker: StationChecker, q: FloatArray) -> bool:
    """Return whether the hand is high and free in all its postures, the arm at q (J,)."""
    hand = station.hand
    probes = [posture.joint_positions for posture in hand.probe_postures.values()]
    postures = np.array([*hand.pregrasps.values(), *probes])
    floor = HEADROOM if station.table is None else station.table.height + HEADROOM
    links = hand.forward_kinematics(station.palm_poses(q), postures)
    heights = np.stack([X[:, 2, 3] for X in links.values()])
    if heights.min() < floor:
        return False
    return bool(checker.free(np.tile(q, (len(postures), 1)), postures).all())
