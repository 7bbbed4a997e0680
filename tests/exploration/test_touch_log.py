"""Touch log: exact, resumable, and never of another exploration."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.exploration import (
    Exploration,
    ExplorationStrategy,
    HandPose,
    Observation,
    Probe,
    ProbeOutcome,
    TactilePerception,
    TactileSensor,
    TargetPolicy,
    TouchLog,
    Workspace,
    explore,
    load_observations,
    load_outcomes,
)
from lis_grasp.exploration.planar_motion import PoseBelief, PoseTrust, planar_pose
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface

FACTS = {"object": "pentagon", "seed": 3}


def explored(log: TouchLog | None, *, stop_after: int | None = None) -> Exploration:
    """Explore with noise; interrupt after some probes."""
    shape = shapes.build("pentagon", None)
    made: list[Observation] = []

    def record(observation: Observation) -> None:
        if log is not None:
            log.append(observation)
        made.append(observation)
        if len(made) == stop_after:
            raise KeyboardInterrupt

    return explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        TactilePerception(
            ESTIMATORS["gpis"],
            sensor=TactileSensor(position_noise=0.001, normal_noise=0.05, miss_rate=0.1),
        ),
        ExplorationStrategy(
            TargetPolicy(Workspace(0.25 * shape.size, shape.mesh.bounds.mean(axis=0), shape.size)),
            touches=14,
            slide=0.03,
        ),
        rng=np.random.default_rng(5),
        recorded=log.read().observations if log is not None else (),
        record=record,
    )


def arrays(exploration: Exploration) -> list[np.ndarray]:
    contacts = exploration.contacts
    probes = [(o.probe.target, o.probe.direction) for o in exploration.outcomes]
    noise = [contacts.position_noise, contacts.normal_noise]
    return [
        contacts.points,
        contacts.normals,
        contacts.times,
        contacts.free_points,
        *noise,
        *probes,
    ]


def assert_same(one: Exploration, other: Exploration) -> None:
    for first, second in zip(arrays(one), arrays(other), strict=True):
        np.testing.assert_array_equal(first, second)
    assert one.contacts.fingers == other.contacts.fingers


@pytest.fixture(scope="module")
def undisturbed() -> Exploration:
    return explored(None)


@pytest.mark.slow
@pytest.mark.parametrize("stop_after", [pytest.param(1, marks=pytest.mark.slow), 9])
def test_a_resumed_exploration_equals_one_without_interruption(
    stop_after: int, undisturbed: Exploration, tmp_path: Path
) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    with pytest.raises(KeyboardInterrupt):
        explored(log, stop_after=stop_after)
    with log.path.open("ab") as file:
        file.write(b'{"target": [0.1, ')  # killed while it wrote
    assert len(log.read().probes) == stop_after
    assert_same(explored(log), undisturbed)


@pytest.mark.slow
def test_a_long_exploration_estimates_seldom_and_can_be_resumed() -> None:
    shape = shapes.build("box", None)
    made: list[int] = []

    def estimate(contacts: Contacts) -> ImplicitSurface:
        made.append(len(contacts))
        return ESTIMATORS["gpis"](contacts)

    def touched(recorded: Sequence[Observation] = ()) -> Exploration:
        space = Workspace(0.25 * shape.size, shape.mesh.bounds.mean(axis=0), shape.size)
        strategy = ExplorationStrategy(TargetPolicy(space), touches=48)
        prober = KinematicProber(Hand.load("wsg50"), shape.mesh)
        return explore(prober, TactilePerception(estimate), strategy, rng=1, recorded=recorded)

    whole = touched()
    # After every contact, and after a sixteenth more beyond 31; not where no probe used it.
    assert len(made) == len(set(made)) > 30
    assert set(made) <= {n for n in range(1, 48) if n <= 32 or n % 2 == 0}
    made.clear()
    assert_same(touched(whole.observations[:-4]), whole)
    assert len(made) <= 3


def test_a_log_replays_into_the_same_contacts(undisturbed: Exploration, tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    for observation in undisturbed.observations:
        log.append(observation)
    log.end(undisturbed.ended)
    assert_same(Exploration.replay(load_observations(log.path), touches=14), undisturbed)


def test_a_log_of_other_facts_has_no_outcomes_to_resume(tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    blocked = ProbeOutcome(Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1), "blocked", reason="why")
    log.append(Observation(blocked))
    assert log.read().observations[0].outcome.reason == "why"
    other = TouchLog(log.path, {**FACTS, "seed": 4}).read()
    assert (other.probes, other.changes) == ((), {"seed": (FACTS["seed"], 4)})


def test_a_finished_exploration_is_not_touched_again(
    undisturbed: Exploration, tmp_path: Path
) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    for observation in undisturbed.observations:
        log.append(observation)
    assert log.read().ending is None
    log.end(undisturbed.ended)
    before = log.path.read_bytes()
    assert log.read().ending == undisturbed.ended
    # A new probe would raise KeyboardInterrupt.
    assert_same(explored(log, stop_after=1), undisturbed)
    assert log.path.read_bytes() == before


def test_a_log_keeps_every_bit_of_its_outcomes(tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    rng = np.random.default_rng(0)
    normals = random_directions(2, rng)
    bare = Contacts(rng.normal(size=(2, 3)), normals)
    full = Contacts(
        bare.points, normals, forces=rng.random(2), fingers=("a", "b"), times=rng.random(2)
    )
    probes = [
        Probe(rng.normal(size=3), rng.normal(size=3), 0.1, 0.2, rng.normal(size=(k, 3)), purpose)
        for k, purpose in enumerate(("policy", "extent"))
    ]
    outcomes: Sequence[ProbeOutcome] = [
        ProbeOutcome(
            probe,
            "touched",
            contacts,
            rng.normal(size=(4, 3)),
            0.3,
            free_radii=rng.random(4),
            hand_pose=pose,
            slid=len(probe.slides),
        )
        for probe, contacts, pose in zip(
            probes,
            (bare, full),
            (None, HandPose(planar_pose(rng.normal(size=3)), rng.random(3))),
            strict=True,
        )
    ]
    for outcome in outcomes:
        log.append(Observation(outcome))
    for read, written in zip(load_outcomes(log.path), outcomes, strict=True):
        np.testing.assert_array_equal(read.probe.direction, written.probe.direction)
        np.testing.assert_array_equal(read.probe.slides, written.probe.slides)
        assert (read.slid, read.probe.purpose) == (written.slid, written.probe.purpose)
        np.testing.assert_array_equal(read.contacts.normals, written.contacts.normals)
        np.testing.assert_array_equal(read.free_points, written.free_points)
        np.testing.assert_array_equal(read.free_radii, written.free_radii)
        assert (read.contacts.forces is None) == (written.contacts.forces is None)
        assert read.contacts.fingers == written.contacts.fingers
        assert (read.hand_pose is None) == (written.hand_pose is None)
    pose, same = outcomes[1].hand_pose, load_outcomes(log.path)[1].hand_pose
    np.testing.assert_array_equal(same.X_OH, pose.X_OH)
    np.testing.assert_array_equal(same.joint_positions, pose.joint_positions)


def test_a_log_without_hand_poses_loads(tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    outcome = ProbeOutcome(
        Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1),
        "touched",
        Contacts([[0, 0, 0]], [[0, 0, -1]]),
        hand_pose=HandPose(np.eye(4), np.zeros(2)),
    )
    log.append(Observation(outcome))
    text = log.path.read_text().splitlines()
    row = json.loads(text[1])
    del row["X_OH"], row["joint_positions"]
    log.path.write_text(f"{text[0]}\n{json.dumps(row)}\n")
    (outcome,) = load_outcomes(log.path)
    assert outcome.hand_pose is None
    assert len(outcome.contacts) == 1


@pytest.mark.parametrize(
    ("trust", "count"), [("on_probation", 5), ("trusted", 0), ("doubted", 3), ("lost", 0)]
)
def test_a_log_keeps_the_belief_of_an_object_that_was_lost(
    trust: PoseTrust, count: int, tmp_path: Path
) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    belief = replace(PoseBelief.start(), trust=trust, count=count)
    missed = ProbeOutcome(Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1), "missed")
    log.append(Observation(missed, belief))
    (read,) = load_observations(log.path)
    assert read.belief.as_dict() == belief.as_dict()
    assert (read.belief.trust, read.belief.count) == (trust, count)


@pytest.mark.parametrize(
    "text",
    [
        "x,y,z\n1,2,3\n",
        '{"results": 1}\n',
        '{"touch_log": 1}\n{"target": [0, 0]}\n',
    ],
)
def test_other_files_are_refused_and_kept(text: str, tmp_path: Path) -> None:
    path = tmp_path / "touches.jsonl"
    path.write_text(text)
    with pytest.raises(InvalidFileError) as error:
        load_outcomes(path)
    assert error.value.path == path
    with pytest.raises(InvalidFileError) as error:
        TouchLog(path, {}).read()
    assert error.value.path == path
    assert path.read_text() == text


def test_noise_that_is_unknown_for_some_contacts_is_kept(tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", FACTS)
    up = [0.0, 0.0, 1.0]
    contacts = Contacts([[0, 0, 0], [0, 0, 1]], [up, up], position_noise=[0.001, np.nan])
    probe = Probe([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 0.03, 0.02)
    log.append(Observation(ProbeOutcome(probe, "touched", contacts)))
    (outcome,) = load_outcomes(log.path)
    np.testing.assert_array_equal(outcome.contacts.position_noise, [0.001, np.nan])
    assert outcome.contacts.normal_noise is None
