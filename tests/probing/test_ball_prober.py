"""Ball prober: contacts of a ball, a block and a table against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidMeshError, InvalidOptionError
from lis_grasp.exploration import Probe
from lis_grasp.exploration.probe_motions import PROBE_SPEED
from lis_grasp.geometry import unit
from lis_grasp.probing.ball_prober import BallProber
from lis_grasp.probing.guarded_motion import TOUCHING

BLOCK = trimesh.creation.box((0.08, 0.06, 0.04))
TIP = 0.006


def test_a_ball_touches_a_ball_where_their_radii_add_up() -> None:
    radius, rng = 0.03, np.random.default_rng(0)
    prober = BallProber(trimesh.creation.icosphere(5, radius), radius=TIP)
    for along in unit(rng.normal(size=(20, 3))):
        target = 0.5 * radius * unit(np.cross(along, rng.normal(size=3)))
        outcome = prober.probe(Probe(target, along, standoff=0.1, overshoot=0.1))
        # The centre stops on the sphere of both radii; the contact is towards it.
        back = np.sqrt((radius + TIP) ** 2 - target @ target)
        expected = (target - back * along) * radius / (radius + TIP)
        chord = radius * (1.0 - np.cos(0.5 * 1.107 / 2**5))  # of an edge of the icosphere
        np.testing.assert_allclose(outcome.contacts.points[0], expected, atol=40 * chord)
        assert outcome.contacts.normals[0] @ unit(expected) > 0.998


@pytest.mark.parametrize("axis", range(3))
def test_a_ball_touches_the_middle_of_a_face_of_a_block(axis: int) -> None:
    along = -np.eye(3)[axis]
    outcome = BallProber(BLOCK, radius=TIP).probe(Probe(np.zeros(3), along, 0.1, 0.0))
    half = 0.5 * BLOCK.extents[axis]
    np.testing.assert_allclose(outcome.contacts.points[0], -half * along, atol=TOUCHING)
    np.testing.assert_allclose(outcome.contacts.normals[0], -along, atol=1e-12)
    # The leading point was at 0.1 m, and stopped at the face; times are at the speed of probes.
    assert outcome.duration == pytest.approx((0.1 - half) / PROBE_SPEED, rel=1e-3)


def test_free_balls_of_a_probe_are_outside_of_the_object() -> None:
    outcome = BallProber(BLOCK, radius=TIP).probe(Probe(np.zeros(3), [0, 0, -1], 0.1, 0.0))
    beyond = np.maximum(np.abs(outcome.free_points) - 0.5 * BLOCK.extents, 0.0)
    assert len(outcome.free_points) > 3
    assert (np.linalg.norm(beyond, axis=1) >= outcome.free_radii).all()


def test_a_probe_beside_the_block_misses() -> None:
    beside = Probe([0.0, 0.03 + 1.5 * TIP, 0.0], [-1, 0, 0], 0.1, 0.1)
    assert BallProber(BLOCK, radius=TIP).probe(beside).status == "missed"
    grazing = Probe([0.0, 0.03 + 0.99 * TIP, 0.0], [-1, 0, 0], 0.1, 0.1)
    assert BallProber(BLOCK, radius=TIP).probe(grazing).status == "touched"


def test_the_table_ends_a_probe_and_a_start_inside_is_blocked() -> None:
    prober = BallProber(BLOCK, radius=TIP, support_height=-0.02)
    beside = prober.probe(Probe([0.1, 0.0, -0.02], [0, 0, -1], 0.1, 0.1))
    assert beside.status == "blocked"
    assert beside.duration == pytest.approx(0.1 / PROBE_SPEED)
    assert prober.probe(Probe([0.0, 0.0, 0.01], [0, 0, -1], 0.0, 0.1)).status == "blocked"
    below = prober.probe(Probe([0.1, 0.0, -0.03], [-1, 0, 0], 0.0, 0.1))
    assert below.status == "blocked"


def test_open_meshes_and_balls_without_size_are_refused() -> None:
    with pytest.raises(InvalidMeshError):
        BallProber(BLOCK.submesh([range(11)], append=True))
    with pytest.raises(InvalidOptionError):
        BallProber(BLOCK, radius=0.0)
