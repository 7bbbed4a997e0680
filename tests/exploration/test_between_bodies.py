"""Whose a contact is beside known bodies, and which targets a finger can reach between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import worlds

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import (
    Exploration,
    Probe,
    ProbeOutcome,
    Region,
    TactilePerception,
    Workspace,
    advance,
    begin,
)
from lis_grasp.exploration.extent import unreached
from lis_grasp.exploration.neighbours import BodyTouch, attributed, fitted, longest_parts
from lis_grasp.exploration.observations import Observation
from lis_grasp.exploration.region import PlaceBelief
from lis_grasp.exploration.strategy import MOST_BLOCKED
from lis_grasp.exploration.touch_log import TouchLog
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.shapes.placement import placed
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.surroundings import believed
from lis_grasp.stages.touch import touch
from lis_grasp.task.task import Task
from lis_grasp.world import Body, KnownBodies, Surroundings

NOISE, TIP = 0.0005, 0.012  # [m]
HALF = np.array([0.042, 0.03, 0.06])  # of the object, a box on the table
DOWN = np.array([0.0, 0.0, -1.0])
WALL = Surroundings((Body.box("wall", (0.02, 0.4, 0.2), (0.1, 0.0, 0.1)),))


def _on_box(half: np.ndarray, center: np.ndarray, rng: np.random.Generator, count: int) -> Contacts:
    """Return contacts of a sensor on the sides and the top of a box."""
    axis = rng.choice(3, size=count, p=[0.4, 0.4, 0.2])
    sign = np.where(axis == 2, 1.0, rng.choice([-1.0, 1.0], size=count))
    points, normals = rng.uniform(-half, half, size=(count, 3)), np.zeros((count, 3))
    rows = np.arange(count)
    points[rows, axis], normals[rows, axis] = sign * half[axis], sign
    return Contacts(points + center + NOISE * rng.normal(size=(count, 3)), normals)


@pytest.mark.parametrize(
    ("gap", "error", "least"),
    [
        *((gap, 0.0, 0.999) for gap in (0.005, 0.015, 0.03)),
        *((gap, 0.005, 0.99) for gap in (0.01, 0.015, 0.03)),
    ],
)
def test_contacts_are_given_to_the_body_that_made_them(
    gap: float, error: float, least: float
) -> None:
    rng, right, made = np.random.default_rng(0), 0, 0
    for _ in range(20):
        true = worlds.blocks(gap)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        off = error * np.array([np.cos(angle), np.sin(angle), 0.0])
        poses = {body.name: body.X_EB.copy() for body in true}
        for X in poses.values():
            X[:3, 3] += off
        known = KnownBodies(true.placed(poses), error=error, noise=NOISE)
        contacts = _on_box(HALF, np.array([0.0, 0.0, HALF[2]]), rng, 30)
        # No finger gets into a gap that is narrower than its tip and the error.
        faces = np.abs(contacts.normals[:, 0]) > 0.5
        room = gap > 2.0 * TIP + error
        contacts = contacts.subset(np.flatnonzero(room | ~faces))
        owners = known.whose(contacts)
        right, made = right + owners.count(None), made + len(owners)
        for body in true:
            theirs = _on_box(0.5 * np.array(worlds.BLOCK), body.X_EB[:3, 3], rng, 30)
            owners = known.whose(theirs)
            right, made = right + owners.count(body.name), made + len(owners)
    assert right >= least * made


def test_a_contact_that_faces_a_body_is_the_objects() -> None:
    known = KnownBodies(WALL, error=0.005)
    at = np.array([[0.088, 0.0, 0.1], [0.088, 0.0, 0.1]])
    contacts = Contacts(at, np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]))
    assert known.whose(contacts) == [None, "wall"]


def test_a_probe_that_met_a_body_alone_is_blocked_and_keeps_its_free_space() -> None:
    probe = Probe(np.array([0.09, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]), 0.05, 0.0)
    of_wall = Contacts(np.array([[0.09, 0.0, 0.1]]), np.array([[-1.0, 0.0, 0.0]]))
    free = np.array([[0.05, 0.0, 0.1]])
    outcome = ProbeOutcome(probe, "touched", of_wall, free, free_radii=np.array([0.01]))
    left, beside = attributed(outcome, KnownBodies(WALL), np.eye(4))
    assert (left.status, left.reason, len(left.contacts)) == ("blocked", "touched wall", 0)
    assert np.array_equal(left.free_points, free)
    assert [touch.body for touch in beside] == ["wall"]
    both = of_wall.append(Contacts(np.array([[0.04, 0.0, 0.1]]), np.array([[1.0, 0.0, 0.0]])))
    left, beside = attributed(replace(outcome, contacts=both), KnownBodies(WALL), np.eye(4))
    assert (left.status, len(left.contacts), len(beside)) == ("touched", 1, 1)


def test_a_state_counts_the_contacts_of_bodies_apart() -> None:
    probe = Probe(np.array([0.09, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]), 0.05, 0.0)
    of_wall = Contacts(np.array([[0.09, 0.0, 0.1]]), np.array([[-1.0, 0.0, 0.0]]))
    perception = TactilePerception(lambda contacts: pytest.fail("no contact of the object"))
    perception = replace(perception, beside=KnownBodies(WALL))
    state = advance(perception, begin(perception), ProbeOutcome(probe, "touched", of_wall))
    assert len(state.contacts) == 0
    assert state.result.touched_beside == {"wall": 1}


def test_touches_correct_a_believed_place() -> None:
    error = 0.005
    off = np.eye(4)
    off[:2, 3] = [0.003, -0.003]
    block = worlds.block().bodies[0]
    known = KnownBodies(Surroundings((replace(block, X_EB=off @ block.X_EB),)), error, NOISE)
    before = float(np.linalg.norm(off[:3, 3]))
    face, center = 0.5 * worlds.BLOCK[0], block.X_EB[:3, 3]
    for normal in (np.array([-1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        known = known.corrected([BodyTouch(block.name, center + face * normal, normal)])
    after = float(np.linalg.norm(known.poses[block.name][:3, 3] - center))
    # The posterior mean leaves noise^2 / (prior + noise^2) of the error.
    assert after <= 1.01 * before * NOISE**2 / (0.25 * error**2 + NOISE**2)


def test_bodies_stay_where_they_are_when_the_frame_of_the_contacts_moves() -> None:
    X_EF = level_pose(0.004, -0.003, 0.2)
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.2, 0.2, size=(50, 3))
    known = KnownBodies(worlds.corner())
    moved = known.in_frame(X_EF).distances(apply_pose(inverse_pose(X_EF), points))
    np.testing.assert_allclose(moved, known.distances(points), atol=1e-12)
    contacts = Contacts(np.array([[0.1, 0.0, 0.1]]), np.array([[-1.0, 0.0, 0.0]]))
    seen = Contacts(
        apply_pose(inverse_pose(X_EF), contacts.points),
        rotate(inverse_pose(X_EF), contacts.normals),
    )
    assert known.in_frame(X_EF).whose(seen) == known.whose(contacts) == ["east"]


def level_pose(x: float, y: float, yaw: float) -> np.ndarray:
    X = np.eye(4)
    X[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    X[:2, 3] = x, y
    return X


def test_a_probe_begins_and_ends_before_known_bodies() -> None:
    known = KnownBodies(WALL)
    level = Probe(np.array([0.03, 0.0, 0.1]), np.array([-1.0, 0.0, 0.0]), 0.1, 0.02)
    part = fitted(level, known, TIP)
    assert part is not None
    # The tip's centre is a radius behind its leading point, and a radius off the wall.
    assert 0.03 < part.start[0] < 0.09 - 2.0 * TIP
    assert part.overshoot == level.overshoot
    assert fitted(replace(level, target=np.array([0.08, 0.0, 0.1])), known, TIP) is None
    assert fitted(level, KnownBodies(worlds.shelf()), TIP) is level
    (sweep,) = longest_parts([replace(level, standoff=0.3, overshoot=0.3)], known, TIP)
    assert 0.2 < sweep.standoff + sweep.overshoot < 0.4


def test_no_place_of_the_object_is_inside_a_known_body() -> None:
    known = KnownBodies(worlds.block(mass=None))
    none = np.empty((0, 3))
    free = PlaceBelief.of(Region(), none, np.empty(0))
    left = PlaceBelief.of(Region(), none, np.empty(0), neighbours=known)
    inside = known.distances(np.column_stack([left.centers, 0.5 * left.heights]))
    assert 0.5 < left.weights.sum() < free.weights.sum()
    assert (inside > 0.0).all()


def test_the_sides_that_no_finger_reaches_are_named() -> None:
    contacts = Contacts(
        np.array([[0.0, 0.0, 0.12], [0.0, 0.03, 0.06], [-0.042, 0.0, 0.06]]),
        np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    )
    space = Workspace(0.03, np.array([0.0, 0.0, 0.06]), 0.12, 0.0)
    refused = [
        ProbeOutcome(Probe(contacts.points[0], direction, 0.03, 0.0), "blocked")
        for direction in (np.array([-1.0, 0.0, 0.0]), DOWN)
    ]
    assert len(unreached(contacts, refused, space)) == 1
    assert unreached(contacts, [], space) == []


def test_a_log_keeps_what_was_refused_and_what_bodies_were_touched(tmp_path: Path) -> None:
    probe = Probe(np.array([0.09, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]), 0.05, 0.0)
    beside = (BodyTouch("wall", probe.target, -probe.direction),)
    refused = (ProbeOutcome(probe, "blocked", reason="wall is in the way"),)
    log = TouchLog(tmp_path / "touches.jsonl", {})
    log.append(Observation(ProbeOutcome(probe, "missed"), None, beside=beside, refused=refused))
    (again,) = (logged.observation for logged in log.read().probes)
    assert again.beside[0].body == "wall"
    assert np.array_equal(again.beside[0].point, probe.target)
    assert again.refused[0].reason == refused[0].reason
    assert np.array_equal(again.refused[0].probe.start, probe.start)


def _explored(
    world: Surroundings, hand: str = "wsg50", touches: int = 12, error: float = 0.0, seed: int = 1
) -> Exploration:
    task = Task.of("box", hand=hand, prober="kinematic", touches=touches, seed=seed, free=False)
    task = task.having(region=(0.2, 0.2, 0.2), pose="upright", body_error=error)
    scenario = Scenario.from_config(task)
    X = scenario.truth.X_WO.copy()  # the object is at the middle of the world
    truth = replace(scenario.truth, shape=placed(scenario.truth.shape, inverse_pose(X)))
    truth = replace(truth, surroundings=world)
    agent = scenario.agent.knowing(believed(world, error, seed))
    return touch(replace(scenario, truth=truth, agent=agent))


# Shares of blocked probes that the exploration promises; seeds and hands differ by chance.
@pytest.mark.by_default("bin")
@pytest.mark.parametrize(
    ("world", "share"),
    [
        (worlds.bin_, 0.08),
        (worlds.shelf, 0.12),
        (worlds.corner, 0.12),
        (worlds.blocks, 0.15),
        (lambda: worlds.blocks(0.01), 0.2),
    ],
    ids=["bin", "shelf", "corner", "blocks", "near_blocks"],
)
def test_few_probes_are_blocked_beside_known_bodies(
    world: Callable[[], Surroundings], share: float
) -> None:
    exploration = _explored(world())
    blocked = [outcome.status == "blocked" for outcome in exploration.outcomes]
    assert exploration.made == 12
    assert np.mean(blocked) <= share
    distances = world().distances(exploration.contacts.points)
    assert (distances > 0.0).all()  # no contact of a body is on the map


@pytest.mark.slow
def test_a_closed_box_ends_the_exploration_and_names_a_body() -> None:
    exploration = _explored(worlds.closed_box())
    assert len(exploration.contacts) == 0
    assert len(exploration.outcomes) <= MOST_BLOCKED
    assert any(body.name in exploration.ended.split() for body in worlds.closed_box())
