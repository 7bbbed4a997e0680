"""An arm carries what it holds as far as its kinematics and the bodies beside it permit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lis_grasp.arms.carrying import CarryingArm
from lis_grasp.arms.placement import choose_base
from lis_grasp.arms.station import Station, Table
from lis_grasp.robots.arm import Arm
from lis_grasp.robots.hand import Hand
from lis_grasp.world import Body, Surroundings


@pytest.fixture(scope="module")
def station() -> Station:
    return choose_base(Arm.load("iiwa14"), Hand.load("wsg50"), table=Table(-0.05))


def carrying(station: Station) -> CarryingArm:
    return CarryingArm(station, station.arm.home, np.full(2, 0.02))


def way(station: Station, *, by: tuple[float, float, float]) -> np.ndarray:
    """Return poses (51, 4, 4) of the palm from the arm's home along a straight line [m]."""
    poses = np.repeat(station.palm_poses(station.arm.home[None]), 51, axis=0)
    poses[:, :3, 3] += np.linspace(0.0, 1.0, 51)[:, None] * by
    return poses


def test_an_arm_follows_a_way_in_its_reach_and_back(station: Station) -> None:
    there = way(station, by=(0.0, 0.2, 0.05))
    arm = carrying(station)
    assert arm.follows(there)
    arrived = arm.after(there)
    assert arrived is not None
    assert arrived.follows(there[::-1])


def test_an_arm_does_not_follow_a_way_that_is_longer_than_it(station: Station) -> None:
    out = way(station, by=(2.0, 0.0, 0.0))
    assert not carrying(station).follows(out)
    assert carrying(station).after(out) is None


def test_an_arm_does_not_follow_jumps(station: Station) -> None:
    ends = way(station, by=(0.0, 0.4, 0.0))[[0, -1]]
    assert not carrying(station).follows(ends)


def test_an_arm_does_not_reach_through_a_wall(station: Station) -> None:
    there = way(station, by=(0.0, 0.4, 0.0))
    at = there[:, :3, 3].mean(axis=0)
    wall = Surroundings((Body.box("wall", (1.5, 0.02, 1.5), (at[0], at[1], 0.0)),))
    assert station.table is not None
    beside = replace(station, table=replace(station.table, surroundings=wall))
    assert carrying(station).follows(there)
    assert not carrying(beside).follows(there)
