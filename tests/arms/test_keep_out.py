"""Inner links of a hand on an arm keep off the estimated object while a fingertip touches it."""

import numpy as np
import pytest
from stations import station_with

from lis_grasp.arms.station import Station
from lis_grasp.contacts import Contacts
from lis_grasp.exploration.probe import Probe
from lis_grasp.exploration.workspace import ObstacleModel, Workspace
from lis_grasp.probing.approach_planner import (
    FREE,
    INSIDE,
    NEAR,
    Approach,
    ApproachPlanner,
    KeepOut,
)
from lis_grasp.typing import FloatArray

_DEVIATION = 0.003  # [m]


class _Roof:
    """A post under a roof that juts out above its side at +y; signed distances, at most."""

    def evaluate(self, points: FloatArray) -> FloatArray:
        post = np.abs(points - [0.0, 0.0, 0.06]) - [0.03, 0.04, 0.06]
        roof = np.abs(points - [0.0, 0.06, 0.08]) - [0.05, 0.06, 0.04]
        return np.minimum(post.max(axis=-1), roof.max(axis=-1))

    def uncertainty(self, points: FloatArray) -> FloatArray:
        return np.full(points.shape[:-1], _DEVIATION)


def _obstacles(contacts: int) -> ObstacleModel:
    # Contacts of the top, too far from the probes to make the estimate an obstacle there.
    points = np.column_stack([np.linspace(-0.02, 0.02, contacts), np.zeros(contacts)])
    points = np.column_stack([points, np.full(contacts, 0.12)])
    known = Contacts(points=points, normals=np.tile([0.0, 0.0, 1.0], (contacts, 1)))
    space = Workspace(0.03, np.array([0.0, 0.03, 0.06]), 0.2, 0.0)
    return ObstacleModel(space, known, _Roof())


def test_places_are_near_within_two_deviations() -> None:
    keep_out = KeepOut(_obstacles(6))
    cell = 0.2 / 24
    beside = np.array([0.03, 0.0, 0.03])  # on the post's side
    off = np.array([1.0, 0.0, 0.0])
    assert keep_out.nearness(beside - cell * off) == INSIDE
    assert keep_out.nearness(beside + 0.4 * cell * off) == NEAR
    assert keep_out.nearness(beside + (2.0 * _DEVIATION + 2.0 * cell) * off) == FREE
    assert keep_out.nearness(np.array([1.0, 0.0, 0.0])) == FREE  # beyond the grid
    assert keep_out.nearness(np.array([beside - cell * off, 10.0 * off])) == INSIDE
    assert KeepOut(_obstacles(4)).nearness(beside - cell * off) == FREE


@pytest.mark.slow
def test_a_probe_is_blocked_if_inner_links_would_pass_through_the_estimate() -> None:
    station = station_with("allegro")
    planner = ApproachPlanner(station.hand, station)
    probe = Probe([0.0, 0.04, 0.02], [0.0, -1.0, 0.0], standoff=0.05, overshoot=0.02)
    # Four contacts are no estimate to go by: the hand would pass through the roof.
    approach = planner.plan(probe, _obstacles(4))
    assert (_Roof().evaluate(_passed(station, approach, probe)) < 0.0).any()
    assert planner.plan(probe, _obstacles(6)) is None


def _passed(station: Station, approach: Approach, probe: Probe) -> FloatArray:
    """Return where the corners of all links but fingertips are on a probe up to its target."""
    hand = station.hand
    links = hand.forward_kinematics(approach.X_OH, approach.posture.joint_positions)
    corners = []
    for geometry in hand.link_geometries:
        if geometry.link not in hand.fingertip_links:
            X_OG = links[geometry.link] @ geometry.X_LG
            corners.append(geometry.mesh.vertices @ X_OG[:3, :3].T + X_OG[:3, 3])
    ahead = np.linspace(0.0, probe.standoff, 11)[:, None, None] * probe.direction
    return np.concatenate(corners) + ahead
