"""Pose tracking: pushes are learned, motion is followed, and a lost object is noticed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from moving_object import Motion, MovingObjectProber, once, pushed_by

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidFileError
from lis_grasp.exploration import (
    Exploration,
    ExplorationState,
    ExplorationStrategy,
    HandPose,
    Landmark,
    Observation,
    PoseTracker,
    Probe,
    ProbeOutcome,
    TactilePerception,
    TargetPolicy,
    TouchLog,
    begin,
    begin_again,
    explore,
)
from lis_grasp.exploration.planar_motion import (
    PoseBelief,
    Push,
    planar_pose,
    push_of,
)
from lis_grasp.exploration.policy import farthest
from lis_grasp.geometry import apply_inverse
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.scenario import known_place
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface

ALONG_X = Push(np.array([1.0, 0.0, 0.0]), np.diag([1.0, 1.0, 400.0]))
SIDE = np.array([-0.03, 0.0, 0.02]), np.array([-1.0, 0.0, 0.0])  # pushed along +x
PROBE = Probe([-0.03, 0.0, 0.02], [1.0, 0.0, 0.0], 0.02, 0.02)


def touched_at(x: float) -> ProbeOutcome:
    return ProbeOutcome(PROBE, "touched", Contacts([[x, 0.0, 0.02]], [[-1.0, 0.0, 0.0]]))


def never(contacts: Contacts) -> ImplicitSurface:
    raise AssertionError  # an estimate that no test uses


def state_after(*observations: Observation) -> ExplorationState:
    """Return the state of a tracked object after observations."""
    return begin(TactilePerception(never, tracker=PoseTracker()), recorded=observations)


def on_five_contacts(state: ExplorationState) -> ExplorationState:
    """Return a state with five contacts, and no estimate of them."""
    point, normal = np.array([[-0.03, 0.0, 0.02]]), np.array([[-1.0, 0.0, 0.0]])
    five = Contacts(np.tile(point, (5, 1)), np.tile(normal, (5, 1)))
    return replace(state, contacts=five, estimated=None)


@pytest.mark.slow
def test_variances_are_those_of_displaced_points() -> None:
    rng = np.random.default_rng(0)
    root = 1e-3 * rng.normal(size=(3, 3))
    start = PoseBelief.start()
    covariances = np.tile(root @ root.T, (len(start.means), 1, 1))
    belief = replace(start, covariances=covariances)
    points, normals = 0.1 * rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    draws = rng.normal(size=(20_000, 3)) @ root.T
    moved = [
        ((trimesh.transform_points(points, planar_pose(draw)) - points) * normals).sum(axis=1)
        for draw in draws
    ]
    # The sampled variance of 20,000 normal draws is within 4 x sqrt(2 / 20,000) = 4 %.
    np.testing.assert_allclose(belief.variances(points, normals), np.var(moved, axis=0), rtol=0.05)


def test_a_place_that_is_found_again_shows_that_touches_move_nothing() -> None:
    belief = PoseBelief.start().pushed(ALONG_X, detected=True)
    again = belief.measured(*SIDE, 0.0, 1e-8)
    assert again.weights[:2].sum() > 0.8
    assert abs(again.mean[0]) < 1e-4 < abs(belief.mean[0])


def test_a_place_that_has_moved_shows_by_how_much() -> None:
    belief = PoseBelief.start().pushed(ALONG_X, detected=True)
    # Along +x, into the side: 1 mm inside of where it was.
    again = belief.measured(*SIDE, -0.001, 1e-8)
    assert again.mean[0] == pytest.approx(0.001, rel=0.1)
    assert again.weights[3] == again.weights.max()  # the scale of 1 mm
    centered, X_EF = again.centered()
    np.testing.assert_allclose(centered.mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(X_EF, planar_pose(again.mean))


def test_a_push_from_above_moves_nothing() -> None:
    known = Contacts([[0.0, 0.0, 0.0], [0.1, 0.1, 0.0]], [[0.0, 0.0, 1.0]] * 2)
    above = push_of(Contacts([[0.0, 0.0, 0.05]], [[0.0, 0.0, 1.0]]), known)
    beside = push_of(Contacts([[0.0, 0.0, 0.05]], [[0.0, -1.0, 0.0]]), known)
    np.testing.assert_array_equal(above.along, 0.0)
    np.testing.assert_array_equal(beside.along, [0.0, 1.0, 0.0])


def test_a_contact_stays_where_the_hand_found_it_when_the_object_moves_on() -> None:
    tracker = PoseTracker()
    first, frames = tracker.track(touched_at(-0.03), state_after())
    # The frame follows the expected push, the contact only its part before the detection.
    x = (frames[0] @ frames[1])[0, 3]
    assert x > 1e-4
    assert -0.03 - 0.4 * x < first.outcome.contacts.points[0, 0] <= -0.03
    # Found at the same place of the hand's: nothing has moved, and the frame goes back.
    here, state = -0.03 - x, state_after(first)
    assert state.again is not None
    again, _ = tracker.track(touched_at(here), state)
    # The second touch may push too, now on a known scale.
    assert again.belief.X_WE[0, 3] < 0.5 * x


def test_an_uncertain_place_is_probed_again_at_once() -> None:
    tracker = PoseTracker()
    assert tracker.probe_again(state_after()) is None
    first, _ = tracker.track(touched_at(-0.03), state_after())
    again = tracker.probe_again(state_after(first))
    np.testing.assert_array_equal(again.target, PROBE.target)
    assert again.overshoot > PROBE.overshoot


def test_of_25_touches_five_repeat_others_unless_a_contact_could_not_be_used() -> None:
    tracker, made = PoseTracker(), []
    uncertain = PoseBelief.start().loosened(np.array([1.9e-3, 1.9e-3, 0.0]))
    for k in range(25):
        again = tracker.probe_again(state_after(*made))
        belief = replace(uncertain, repeated=again is not None, suspicious=k % 2 == 0)
        made.append(Observation(touched_at(-0.03 - 0.01 * k), belief))
    # The first shows at once whether touches move the object, the second after the next touch.
    assert [k for k, one in enumerate(made) if one.is_repeated] == [1, 3, 7, 13, 19]
    unusable = PoseBelief.start().loosened(np.array([5e-3, 5e-3, 0.0]))
    last = replace(made[-1], belief=unusable)
    assert tracker.probe_again(state_after(*made[:-1], last)) is not None
    elsewhere = replace(PROBE, target=PROBE.target + 0.1)
    doubt = replace(uncertain, trust="doubted", count=1)
    doubted = Observation(replace(made[-1].outcome, probe=elsewhere), doubt)
    assert tracker.probe_again(state_after(*made[:-1], doubted)) is not None


def test_a_landmark_from_before_is_touched_again_and_is_no_outcome() -> None:
    landmark = Landmark(PROBE, touched_at(-0.03).contacts)
    perception = TactilePerception(never, tracker=PoseTracker())
    strategy = ExplorationStrategy(SimpleNamespace(next_probe=None), touches=None)
    uncertain = PoseBelief.start().loosened(np.array([5e-3, 5e-3, 0.0]))
    for belief, is_uncertain in ((PoseBelief.start(), False), (uncertain, True)):
        state = begin_again(perception, strategy, [landmark], belief)
        np.testing.assert_array_equal(state.known.points, landmark.contacts.points)
        assert state.outcomes == ()
        assert (state.again is not None) is is_uncertain
    np.testing.assert_array_equal(state.again.target, PROBE.target)


@pytest.mark.parametrize(("turn", "trust"), [(0.0, "doubted"), (1.6, "trusted")])
def test_only_a_repetition_with_the_hand_turned_alike_shows_a_motion(
    turn: float, trust: str
) -> None:
    # Rolled by 92 degrees, the finger came to another side of a mallet that had not moved.
    roll = trimesh.transformations.rotation_matrix(turn, [1.0, 0.0, 0.0])
    first = replace(touched_at(-0.03), hand_pose=HandPose(np.eye(4), np.zeros(0)))
    tracker = PoseTracker()
    state = state_after(tracker.track(first, state_after())[0])
    assert state.again is not None
    side = Contacts([[-0.02, 0.02, 0.02]], [[0.0, 1.0, 0.0]])
    again = ProbeOutcome(PROBE, "touched", side, hand_pose=HandPose(roll, np.zeros(0)))
    observation, _ = tracker.track(again, state)
    assert observation.belief.trust == trust


def test_a_place_is_approached_from_near_once_contacts_show_the_object() -> None:
    tracker = PoseTracker()
    far = replace(PROBE, standoff=0.2)
    first = replace(touched_at(-0.03), probe=far)
    state = state_after(tracker.track(first, state_after())[0])
    assert state.again.standoff == far.standoff
    near = tracker.probe_again(on_five_contacts(state))
    assert near.standoff == pytest.approx(0.03, abs=0.01)


@pytest.mark.parametrize(("off", "trust"), [(0.0012, "trusted"), (0.008, "doubted")])
def test_the_other_side_of_an_edge_is_the_same_place(off: float, trust: str) -> None:
    # The hand came 0.5 mm aside, and met the top of a block instead of its side.
    tracker = PoseTracker(0.0005)
    state = state_after(tracker.track(touched_at(-0.03), state_after())[0])
    top = Contacts([[-0.03 + off, 0.0, 0.02]], [[0.0, 0.0, 1.0]])
    observation, _ = tracker.track(ProbeOutcome(PROBE, "touched", top), state)
    assert observation.belief.trust == trust


def test_contacts_before_a_loss_wait_until_the_object_is_found(tmp_path: Path) -> None:
    start, X_FE = PoseBelief.start(), planar_pose(np.array([0.2, 0.1, 0.5 * np.pi]))
    before = [Observation(touched_at(x), start) for x in (-0.03, -0.05, -0.07)]
    # A contact felt in doubt, in a frame 1 mm behind that of the loss, belongs to the new map.
    X_WE = planar_pose(np.array([-0.001, 0.0, 0.0]))
    behind = replace(start, X_WE=X_WE, trust="doubted", count=1)
    felt = Observation(replace(touched_at(0.201), status="blocked"), replace(behind, repeated=True))
    lost = Observation(touched_at(0.1), replace(start, trust="lost"))
    exploration = Exploration.replay([*before, felt, lost])
    np.testing.assert_allclose(exploration.contacts.points[:, 0], [0.2, 0.1], atol=1e-12)
    made_by = [touch.contacts.points[0, 0] for touch in exploration.touches]
    assert made_by == pytest.approx([0.2, 0.1])
    found = Observation(touched_at(0.3), replace(start, trust="lost")).on_map(X_FE)
    found = replace(found, belief=replace(start, X_WE=X_FE, joined=X_FE))
    log = TouchLog(tmp_path / "touches.jsonl", {})
    for observation in (*before, felt, lost, found):
        log.append(observation)
    joined = Exploration.replay(log.read().observations).contacts.points
    new = np.array([[0.2, 0.0, 0.02], [0.1, 0.0, 0.02], [0.3, 0.0, 0.02]])
    np.testing.assert_allclose(joined[:3, 0], [-0.03, -0.05, -0.07], atol=1e-12)
    np.testing.assert_allclose(joined[3:], apply_inverse(X_FE, new), atol=1e-12)


def test_a_repetition_that_misses_shows_a_large_motion() -> None:
    tracker, start = PoseTracker(), PoseBelief.start()
    state = state_after(*(Observation(touched_at(x), start) for x in (-0.03, -0.05, -0.07)))
    for again in (PROBE, None):
        missed, _ = tracker.track(ProbeOutcome(PROBE, "missed"), replace(state, again=again))
        assert missed.is_doubted is (again is not None)


def test_an_object_that_a_dozen_probes_miss_is_searched_again() -> None:
    tracker = PoseTracker()
    made = [tracker.track(touched_at(-0.03), state_after())[0]]
    missed = ProbeOutcome(PROBE, "missed")
    while not made[-1].is_lost:
        assert len(made) < 13
        made.append(tracker.track(missed, replace(state_after(*made), again=None))[0])
    assert len(made) == 13
    assert not len(Exploration.replay(made).contacts)
    # With five contacts, only free space and repetitions show a motion.
    five = replace(on_five_contacts(state_after(*made[:12])), again=None)
    assert not tracker.track(missed, five)[0].is_lost


def test_the_contact_that_shows_a_loss_has_the_noise_of_the_sensor() -> None:
    # It defines the object's new frame, so the doubt about the old one does not make it uncertain.
    tracker = PoseTracker(position_noise=5e-4)
    uncertain = PoseBelief.start().loosened(np.array([0.015, 0.015, 0.3]))
    doubtful = replace(uncertain, trust="doubted", count=6)
    state = on_five_contacts(state_after(Observation(ProbeOutcome(PROBE, "missed"), doubtful)))
    found, _ = tracker.track(touched_at(-0.07), state)
    assert found.is_lost
    np.testing.assert_array_equal(found.outcome.contacts.position_noise, [5e-4])


def test_repeated_probes_add_no_contacts() -> None:
    repeated = Observation(touched_at(-0.05), replace(PoseBelief.start(), repeated=True))
    first = Observation(touched_at(-0.03))
    assert len(Exploration.replay([first, repeated]).contacts) == 1


def test_the_log_keeps_both_poses_to_the_last_bit(tmp_path: Path) -> None:
    log = TouchLog(tmp_path / "touches.jsonl", {})
    belief = PoseBelief.start().pushed(ALONG_X, detected=False).measured(*SIDE, -0.001, 1e-8)
    belief, X_EF = belief.centered()
    log.append(Observation(touched_at(-0.03), belief), X_EF)
    (read,) = log.read().probes
    assert read.observation.belief.as_dict() == belief.as_dict()
    np.testing.assert_array_equal(read.X_EO, X_EF)
    text = log.path.read_text()
    for wrong in ('"a"', "2"):  # no rotation
        log.path.write_text(text.replace('"X_WE": [[1', f'"X_WE": [[{wrong}', 1))
        with pytest.raises(InvalidFileError):
            log.read()


def test_an_outcome_in_another_frame_is_the_same_touch() -> None:
    X_EF = planar_pose(np.array([0.01, -0.02, 0.7]))
    outcome = replace(
        touched_at(-0.03),
        free_points=[[0.1, 0.2, 0.3]],
        hand_pose=HandPose(planar_pose(np.array([0.1, 0.0, 0.2])), np.zeros(2)),
    )
    moved = outcome.in_frame(X_EF)
    back = moved.in_frame(np.linalg.inv(X_EF))
    np.testing.assert_allclose(
        trimesh.transform_points(moved.contacts.points, X_EF), outcome.contacts.points, atol=1e-15
    )
    np.testing.assert_allclose(
        moved.contacts.normals @ X_EF[:3, :3].T, outcome.contacts.normals, atol=1e-15
    )
    np.testing.assert_allclose(back.free_points, outcome.free_points, atol=1e-15)
    np.testing.assert_allclose(back.hand_pose.X_OH, outcome.hand_pose.X_OH, atol=1e-15)


def explored(name: str, motion: Motion, *, tracked: bool) -> tuple[Exploration, float]:
    """Explore an object that moves; return the root mean square error of its contacts [m]."""
    shape = shapes.build(name, None)
    prober = MovingObjectProber(Hand.load("allegro"), shape, motion)
    space = known_place(shape, on_table=True)
    exploration = explore(
        prober,
        TactilePerception(ESTIMATORS["blend"], tracker=PoseTracker() if tracked else None),
        ExplorationStrategy(
            TargetPolicy(space, farthest, ESTIMATORS["gpis"]), touches=16, space=space
        ),
        rng=np.random.default_rng(0),
    )
    in_object = trimesh.transform_points(exploration.contacts.points, np.linalg.inv(prober.X_EO))
    off, _ = distances_to_mesh(in_object, shape.mesh)
    return exploration, float(np.sqrt(np.mean(off**2)))


@pytest.mark.slow
def test_a_box_that_every_touch_pushes_is_tracked() -> None:
    motion = pushed_by(0.001)
    tracked, without = (explored("box", motion, tracked=on)[1] for on in (True, False))
    assert tracked < 0.6 * without  # 0.51 measured


@pytest.mark.slow
def test_a_ball_that_jumped_is_found_again() -> None:
    exploration, error = explored(
        "sphere", once(10, planar_pose([0.008, 0.004, 0.0])), tracked=True
    )
    assert error < 1e-3  # of a jump by 9 mm
    assert len(exploration.contacts) == 16
