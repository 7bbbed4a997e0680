"""Placement of an arm: its base by reach over a region, and a home posture clear of everything."""

from __future__ import annotations

import numpy as np

from lis_grasp.arms.collision import StationChecker
from lis_grasp.arms.reach import KEPT, SEEDS, best_solutions, track
from lis_grasp.arms.station import Station, Table
from lis_grasp.exceptions import InvalidArmError
from lis_grasp.exploration.region import DEFAULT_REGION
from lis_grasp.geometry import cross, make_pose, rotate, tangent_frame, unit
from lis_grasp.grasping.grasps import STANDOFF
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.typing import BoolArray, FloatArray

# Candidates: distance from the region's middle as a fraction of the arm's reach, and height of the
# base above the table [m]. The arm faces the region.
_DISTANCES = (0.5, 0.6, 0.7)
_PEDESTALS = (0.0, 0.2)
# Directions of approach: down, and oblique from all around; turns of the hand about each.
_TILT, _AROUND, _TURNS = np.pi / 3.0, 6, 2

HEADROOM = 0.25
"""Least height of the hand above the table at home [m]: objects are below it."""

# Heights of the pads above the table that are tried where the arm's own home is not free [m].
_HEIGHTS = (0.35, 0.45, 0.3, 0.55)


def choose_base(arm: Arm, hand: Hand, *, table: Table | None = None) -> Station:
    """Return the station whose base reaches the most poses of the hand in a region, straight.

    The base is on the table, or on a pedestal on it; the region is above the table's middle.
    """
    return best_bases(arm, hand, table=table)[0]


def best_bases(arm: Arm, hand: Hand, *, table: Table | None = None) -> list[Station]:
    """Return the stations of all base poses that are tried, the one with the most reach first.

    For arguments see `choose_base`.
    """
    table = Table() if table is None else table
    start = Station.make(arm, hand, _base(table, 0.0, 0.0), table=table)
    targets = palm_targets(hand, _middle(table), DEFAULT_REGION, each=2)
    reach = arm.kinematics.reach(arm.ik.postures)[1]
    stations = [
        start.moved(_base(table, distance * reach, pedestal))
        for pedestal in _PEDESTALS
        for distance in _DISTANCES
    ]
    counts = [int(reached(station, targets).sum()) for station in stations]
    return [stations[i] for i in np.argsort(-np.array(counts), kind="stable")]


def reach_fraction(station: Station) -> float:
    """Return the fraction of places and directions in a region that the hand reaches straight.

    Places are a grid of four points along each axis; at each the hand points down and obliquely,
    from all sides. One of two turns about its direction has to be reached, with a straight approach
    of 12 cm, within joint limits. Collisions are not checked.
    """
    center = _middle(station.table or Table())
    return float(
        reached(station, palm_targets(station.hand, center, DEFAULT_REGION, each=4)).mean()
    )


def palm_targets(
    hand: Hand, center: FloatArray, region: tuple[float, float, float], *, each: int
) -> FloatArray:
    """Return palm poses with the pads' middle in a region: places and directions, turns.

    The shape is (P, T, 4, 4); `center` (3,) is the middle of the region's bottom.
    """
    lines = [np.linspace(-0.5, 0.5, each) * 0.9 * side for side in region]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    places = grid + center + [0.0, 0.0, 0.5 * region[2]]
    posture = next(iter(hand.pregrasps.values()))
    pads_H = hand.pad_centers(np.eye(4), posture).mean(axis=0)
    rotations = _directions(hand.approach_H)  # (D, T, 3, 3)
    poses = make_pose(rotations, places[:, None, None] - rotations @ pads_H)
    return np.asarray(poses.reshape(-1, rotations.shape[1], 4, 4))


def reached(station: Station, targets: FloatArray) -> BoolArray:
    """Return which of P targets are reached straight in one of T turns, (P,), for (P, T, 4, 4)."""
    done = np.zeros(len(targets), dtype=bool)
    for turn in range(targets.shape[1]):
        waiting = np.flatnonzero(~done)
        if not len(waiting):
            break
        X_WH = targets[waiting, turn]
        pose, q = best_solutions(station, station.solve_ik(X_WH, seeds=SEEDS), kept=KEPT)
        forward = rotate(X_WH[pose], station.hand.approach_H)
        straight = track(station, q, X_WH[pose], -STANDOFF * forward).followed
        done[waiting[pose[straight]]] = True
    return done


def _directions(approach_H: FloatArray) -> FloatArray:
    """Return rotations R_WH with the approach down and oblique, turned about it, (D, T, 3, 3)."""
    R_HT = np.column_stack([*tangent_frame(approach_H), approach_H])  # tool frame: +z approaches
    rotations = []
    for tilt in (0.0, _TILT):
        for around in 2.0 * np.pi * np.arange(_AROUND if tilt else 1) / _AROUND:
            out = np.array(
                [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), -np.cos(tilt)]
            )
            side = unit(cross(np.eye(3)[1 if abs(out[1]) < 0.9 else 0], out))
            R_WT = np.column_stack([side, cross(out, side), out])
            turns = []
            for turn in 2.0 * np.pi * np.arange(_TURNS) / _TURNS:
                c, s = np.cos(turn), np.sin(turn)
                turns.append(R_WT @ [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]] @ R_HT.T)
            rotations.append(turns)
    return np.array(rotations)


def _middle(table: Table) -> FloatArray:
    return np.array([*table.center, table.height])


def _base(table: Table, distance: float, pedestal: float) -> FloatArray:
    return make_pose(np.eye(3), _middle(table) + [-distance, 0.0, pedestal])


def home_of(station: Station) -> FloatArray:
    """Return the arm's home (J,) if the hand is high and free there, else another such posture.

    It is free in every pregrasp and probe posture of the hand. Such a posture has the hand pointing
    down, or obliquely, above the middle of the table.

    Raises `InvalidArmError` if there is none: the base is too far from the table, for example.
    """
    checker = StationChecker(station)
    if _is_home(station, checker, station.arm.home):
        return station.arm.home
    table = station.table or Table()
    for height in _HEIGHTS:
        center = np.array([*table.center, table.height + height])
        targets = palm_targets(station.hand, center, (0.0, 0.0, 0.0), each=1)
        for turned in targets.swapaxes(0, 1):
            solutions = station.solve_ik(turned, seeds=SEEDS, first=station.arm.home)
            for q in best_solutions(station, solutions, kept=KEPT)[1]:
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
