"""Motion times: lengths over speeds, computed by hand."""

import numpy as np
import pytest

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Probe, ProbeOutcome, Workspace
from lis_grasp.exploration.probe_motions import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.exploration.targets import seconds_to_touch
from lis_grasp.exploration.workspace import ObstacleModel
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand

# A ball of radius 1 about the origin holds the object.
SPACE = Workspace(0.1, np.zeros(3), 2.0 / np.sqrt(3.0))


def made(direction: np.ndarray, seconds: float) -> ProbeOutcome:
    return ProbeOutcome(Probe(-0.5 * direction, direction, 0.1, 0.0), "missed", duration=seconds)


def test_an_approach_begins_on_the_ball_around_the_object() -> None:
    starts = np.array([[0.0, 0.0, 0.4], [0.0, 0.8, 0.0], [0.0, 0.0, 1.5], [2.0, 0.0, 0.0]])
    lengths = SPACE.approach_distance(starts, np.tile([0.0, 0.0, -1.0], (4, 1)))
    np.testing.assert_allclose(lengths, [0.6, 0.6, 0.0, 0.0])


def test_the_first_touch_takes_approach_guarded_step_and_retreat() -> None:
    point, normal = np.array([[0.0, 0.0, 0.5]]), np.array([[0.0, 0.0, 1.0]])
    expected = 0.4 / TRANSIT_SPEED + 0.1 / PROBE_SPEED + 0.5 / TRANSIT_SPEED
    np.testing.assert_allclose(seconds_to_touch(point, normal, SPACE, []), [expected])


def test_the_next_touch_takes_the_transfer_too() -> None:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    alone = seconds_to_touch(0.5 * normals, normals, SPACE, [])
    after = seconds_to_touch(0.5 * normals, normals, SPACE, [made(-normals[0], 1.0)])
    turns = np.array([0.0, 0.5, 0.5, 1.0, 0.5, 0.5]) * np.pi
    np.testing.assert_allclose(after - alone, turns / TRANSIT_SPEED, atol=1e-12)


def test_the_predicted_time_is_that_of_a_touch_where_it_was_expected() -> None:
    shape = shapes.build("box", 0.2)
    space = Workspace(0.05, np.zeros(3), 0.2)
    top = shape.mesh.bounds[1, 2]
    point, normal = np.array([0.0, 0.0, top]), np.array([0.0, 0.0, 1.0])
    prober = KinematicProber(Hand.load("allegro"), shape.mesh)
    probe = Probe(point, -normal, space.step, 0.02)
    outcome = prober.probe(probe, ObstacleModel(space, Contacts.empty(), None))
    assert outcome.status == "touched"
    predicted = seconds_to_touch(point[None], normal[None], space, [])
    # The prober's approach begins with the tip's centre on the ball, its radius farther out.
    assert outcome.duration == pytest.approx(predicted[0], abs=2 * 0.012 / TRANSIT_SPEED + 1e-3)
