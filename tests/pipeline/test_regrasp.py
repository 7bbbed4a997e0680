"""Regrasping with a tactile check: the loop with a scripted lift, and whole lifts in Drake."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from lis_grasp import Contacts, Hand, shapes
from lis_grasp.exploration.planar_motion import planar_pose
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.io import provenance
from lis_grasp.lifting.closing import AcceptGrasp
from lis_grasp.lifting.outcome import LOST_GRASPS, LiftOutcome
from lis_grasp.pipeline import ContactSource, RunConfig, Scenario, estimate_file
from lis_grasp.results.progress import SILENT, Stopwatch
from lis_grasp.results.stage_files import StoredStages
from lis_grasp.shapes.mesh_distance import distances_to_mesh
from lis_grasp.stages.regrasp import Attempt, Stages, grasp_with_tactile_check
from lis_grasp.stages.tactile_check import tactile_check
from lis_grasp.stages.touching_again import Lesson, touch_more

ALLEGRO = Hand.load("allegro")
BOX = shapes.build("box")
LEFT, RIGHT = np.array([[-0.03, 0.0, 0.0]]), np.array([[0.03, 0.0, 0.0]])


def _outcome(
    reason: str, fingers: tuple[str, ...] = (), closed: bool = True, weighed: float | None = None
) -> LiftOutcome:
    """Return an outcome with one measured contact per finger, the object pushed by 1 mm.

    The contacts are on top of the box, where they show no motion of it.
    """
    top = BOX.mesh.bounds[1, 2]
    points = np.array([[0.01 * k, 0.0, top] for k in range(len(fingers))]).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(fingers), 1))
    measured = Contacts(points, normals, fingers=fingers)
    held = reason == "held"
    pushed = scenes.pose(0.001, 0.0, 0.0)
    motion = scenes.motion()
    lifted = reason in ("held", "dropped", "slipped", "turned")
    return LiftOutcome(
        lifted, held, 0.0, 0.0, reason, 0.0, 1.0, motion, closed, measured, pushed, weighed
    )


class _Script(Stages):
    """Planned grasps, and the outcomes of lifts; it keeps the calls of the lift."""

    def __init__(self, outcomes: list[LiftOutcome], grasps: tuple[Grasp, ...]) -> None:
        self.calls: list[dict[str, Any]] = []
        self.sought: list[bool] = []
        self._left, self._grasps = iter(outcomes), grasps

    def estimate(self, scenario: Scenario, contacts: Contacts) -> trimesh.Trimesh:
        return BOX.mesh

    def plan(self, scenario: Scenario, mesh: trimesh.Trimesh) -> GraspSearch:
        grasps = self._grasps
        return GraspSearch(grasps=grasps, rejections={}, candidates=len(grasps))

    def lift(
        self,
        scenario: Scenario,
        grasp: Grasp,
        mesh: trimesh.Trimesh,
        accept_grasp: AcceptGrasp | None,
    ) -> LiftOutcome:
        X_EO = scenario.truth.X_EO
        load = scenario.agent.load.prior
        self.calls.append(
            {"grasp": grasp, "accept_grasp": accept_grasp, "X_EO": X_EO, "load": load}
        )
        return next(self._left)

    def touch_more(
        self, scenario: Scenario, contacts: Contacts, *, moved: bool
    ) -> tuple[Scenario, Contacts, Lesson]:
        """Find the object where it is; touch it once on its back."""
        self.sought.append(moved)
        back = np.array([[0.0, 0.02 + 0.002 * len(contacts), 0.0]])
        found = contacts.append(Contacts(back, np.array([[0.0, 1.0, 0.0]])))
        return scenario, found, Lesson(0, 1, 3, 0.0, False)


def _scripted(
    outcomes: list[LiftOutcome], grasps: tuple[Grasp, ...], attempts: int, closings: int = 0
) -> tuple[list[Attempt], list[dict[str, Any]]]:
    """Run the loop with planned grasps and the outcomes of lifts; return the calls of the lift."""
    script = _Script(outcomes, grasps)
    scenario = scenes.scenario(BOX, scenes.hand(), attempts=attempts, closings=closings)
    made = list(grasp_with_tactile_check(scenario, scenes.contacts(), script))
    return made, script.calls


def test_a_held_grasp_ends_the_attempts() -> None:
    made, calls = _scripted([_outcome("held")], (scenes.grasp(),), 3)
    assert len(made) == len(calls) == 1
    assert calls[0]["accept_grasp"] is not None
    assert_array_equal(calls[0]["X_EO"], np.eye(4))


@pytest.mark.parametrize("reason", sorted(LOST_GRASPS))
def test_a_failed_grasp_teaches_and_the_next_starts_where_the_object_rests(reason: str) -> None:
    outcomes = [_outcome(reason, ("left",)), _outcome("held")]
    made, calls = _scripted(outcomes, (scenes.grasp(),), 3)
    assert [attempt.outcome for attempt in made] == outcomes
    assert [len(attempt.contacts) for attempt in made] == [6, 8]
    measured = outcomes[0].measured_contacts.points[0]
    assert_allclose(made[1].contacts.points[6], measured, rtol=0.0, atol=1e-12)
    assert made[0].lesson == Lesson(felt=1, touched=1, probes=3, moved=0.0, lost=False)
    assert made[1].lesson is None
    assert_allclose(calls[1]["X_EO"], outcomes[0].X_WO, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("reason", ["unstable", "diverged"])
def test_a_trial_that_says_nothing_of_the_grasp_ends_the_attempts(reason: str) -> None:
    assert len(_scripted([_outcome(reason)], (scenes.grasp(),), 3)[0]) == 1


def test_the_last_attempt_has_no_tactile_check() -> None:
    _, calls = _scripted([_outcome("aborted", ("left",))] * 2, (scenes.grasp(),), 2)
    assert [call["accept_grasp"] is None for call in calls] == [False, True]


def test_a_lifted_object_is_weighed_for_the_next_plan() -> None:
    outcomes = [
        _outcome("not_lifted", weighed=0.1),  # the table may have carried a part
        _outcome("dropped", weighed=0.6),
        _outcome("held"),
    ]
    _, calls = _scripted(outcomes, (scenes.grasp(),), 3)
    prior, second, third = (call["load"] for call in calls)
    assert second == prior
    assert (third.mass, third.mass_spread) == (0.6, 0.0)
    assert third.friction == prior.friction


def test_the_space_inside_the_felt_hand_is_free() -> None:
    felt = Contacts(
        RIGHT,
        np.array([[1.0, 0.0, 0.0]]),
        free_points=np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]),
        free_radii=np.array([0.012, 0.001]),
    )
    failed = replace(_outcome("not_lifted"), measured_contacts=felt)
    made, _ = _scripted([failed, _outcome("held")], (scenes.grasp(),), 2)
    # As far as the object's pose is known, to 2 mm.
    assert_allclose(made[1].contacts.free_radii[-2:], [0.01, 0.0])


def test_a_grasp_to_which_the_arm_has_no_way_is_followed_by_the_next_of_the_plan() -> None:
    grasps = (scenes.grasp(), scenes.grasp(), scenes.grasp())
    stopped = _outcome("arm_collision", closed=False)
    outcomes = [LiftOutcome.not_begun("no_arm_motion", np.eye(4)), stopped, _outcome("held")]
    made, calls = _scripted(outcomes, grasps, 1)
    assert [attempt.rank for attempt in made] == [0, 1, 2]
    assert [call["grasp"] is grasp for call, grasp in zip(calls, grasps, strict=True)] == [True] * 3
    assert_array_equal(calls[1]["X_EO"], np.eye(4))  # nothing has moved
    assert_array_equal(calls[2]["X_EO"], stopped.X_WO)


def test_an_arm_that_stops_with_the_object_in_its_hand_ends_the_attempts() -> None:
    made, _ = _scripted([_outcome("torque_limit", closed=True)], (scenes.grasp(),) * 2, 2)
    assert len(made) == 1


def test_without_a_grasp_an_object_that_has_not_moved_is_touched_some_more() -> None:
    script = _Script([], ())
    scenario = scenes.scenario(BOX, scenes.hand(), attempts=3, closings=0)
    made = list(grasp_with_tactile_check(scenario, scenes.contacts(), script))
    assert [attempt.outcome for attempt in made] == [None] * 3
    assert [len(attempt.contacts) for attempt in made] == [6, 7, 8]
    assert script.sought == [False, False]


def test_the_next_grasp_is_away_from_what_failed() -> None:
    both = scenes.grasp()  # contacts of "left" and "right" 6 cm apart

    def shifted(distance: float) -> Grasp:
        return replace(both, contact_points=both.contact_points + [0.0, distance, 0.0])

    grasps = (both, shifted(0.009), shifted(0.03))
    for outcome in (_outcome("aborted", ("right",)), _outcome("turned")):
        made, _ = _scripted([outcome, _outcome("held")], grasps, 3)
        assert [attempt.rank for attempt in made] == [0, 2]
    # A grasp that shares only one of the contacts that failed together is another grasp.
    points = both.contact_points + np.array([[0.0, 0.0, 0.0], [0.0, 0.05, 0.0]])
    half = replace(both, contact_points=points)
    made, _ = _scripted([_outcome("turned"), _outcome("held")], (both, half), 3)
    assert [attempt.rank for attempt in made] == [0, 1]
    # What touched nothing before the hand closed says nothing of the grasp.
    made, _ = _scripted([_outcome("aborted", closed=False), _outcome("held")], grasps, 3)
    assert [attempt.rank for attempt in made] == [0, 0]


def _closing(angle: float, count: int) -> Contacts:
    """Return contacts around the box, with normals that turn up by an angle [rad]."""
    azimuths = np.pi + np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    around = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(count)])
    return Contacts(0.03 * around, np.cos(angle) * around + [0.0, 0.0, np.sin(angle)])


def test_grasps_are_tested_and_planned_anew_on_what_was_measured() -> None:
    outcomes = [
        _outcome("aborted"),
        _outcome("aborted", ("left",), closed=False),  # the open hand hit the object
        _outcome("held"),
    ]
    made, calls = _scripted(outcomes, (scenes.grasp(),), 1, closings=5)
    assert [attempt.outcome for attempt in made] == outcomes
    assert [len(attempt.contacts) for attempt in made] == [6, 6, 7]
    taught = [Lesson(felt, touched=0, probes=0, moved=0.0, lost=False) for felt in (0, 1)]
    assert [attempt.lesson for attempt in made] == [*taught, None]
    assert all(call["accept_grasp"] is not None for call in calls)


@pytest.mark.parametrize(("attempts", "closings"), [(1, 0), (1, 3), (2, 2), (3, 0)])
def test_each_attempt_has_its_tests_and_the_last_lifts_in_any_case(
    attempts: int, closings: int
) -> None:
    count = attempts * (closings + 1)
    script = _Script([_outcome("aborted", ("left",))] * count, (scenes.grasp(),))
    scenario = scenes.scenario(BOX, scenes.hand(), attempts=attempts, closings=closings)
    list(grasp_with_tactile_check(scenario, scenes.contacts(), script))
    checks = [call["accept_grasp"] is not None for call in script.calls]
    assert checks == [True] * (count - 1) + [False]
    # After an attempt, the object may be somewhere else; after a test, it is where it was.
    assert script.sought == [True] * (attempts - 1)


@pytest.mark.slow
@pytest.mark.parametrize(("hand", "count"), [(scenes.hand(), 2), (ALLEGRO, 3)])
def test_each_test_needs_less_closure_than_the_one_before(hand: Hand, count: int) -> None:
    script = _Script([_outcome("aborted")] * 12, (scenes.grasp(),))
    scenario = scenes.scenario(BOX, hand, attempts=2, closings=5)
    list(grasp_with_tactile_check(scenario, scenes.contacts(), script))
    limit = np.arctan(0.5 * scenario.agent.load.prior.friction)
    closings = [_closing(angle, count) for angle in np.linspace(0.0, 1.1 * limit, 200)]
    checks = [call["accept_grasp"] for call in script.calls[:-1]]
    accepted = [sum(map(check, closings)) for check in checks]
    assert accepted[:6] == accepted[6:] + accepted[5:6]  # the tests of both attempts
    assert 0 < accepted[0] < accepted[1] < accepted[2] < accepted[3] < accepted[4] < accepted[5]
    # What remains is force closure at half the friction.
    assert accepted[5] == pytest.approx(200 / 1.1, abs=1.0)


def test_the_tactile_check_needs_force_closure() -> None:
    _, calls = _scripted([_outcome("held")], (scenes.grasp(),), 2)
    accept_grasp = calls[0]["accept_grasp"]
    opposite = Contacts(np.vstack([LEFT, RIGHT]), np.array([[-1.0, 0, 0], [1.0, 0, 0]]))
    assert not accept_grasp(opposite.subset([0]))
    aligned = Contacts(opposite.points, np.array([[0, 0, 1.0], [0, 0, 1.0]]))
    assert not accept_grasp(aligned)


def test_flat_pads_may_touch_parallel_faces_at_opposite_ends() -> None:
    gripper = Hand.load("wsg50")
    known = scenes.scenario(BOX, gripper, friction=0.8).agent
    accept_grasp = tactile_check(BOX.mesh, known, 0.0)
    points = np.array([[-0.02, -0.01, 0.0], [0.02, 0.01, 0.0]])  # 27 deg, outside half the cone
    faces = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert accept_grasp(Contacts(points, faces))
    wedge = np.array([[-1.0, 0.0, 0.6], [1.0, 0.0, 0.6]]) / np.hypot(1.0, 0.6)
    assert not accept_grasp(Contacts(points, wedge))
    # Fingertips do not turn the object.
    rounded = replace(known, hand=ALLEGRO)
    assert not tactile_check(BOX.mesh, rounded, 0.0)(Contacts(points, faces))


def test_an_object_with_an_unseen_end_is_touched_before_the_first_grasp() -> None:
    scenario = scenes.scenario(BOX, scenes.hand(), attempts=1, region=[0.4] * 3, pose="stable")
    some = scenes.contacts().subset([1, 2, 4])  # none faces along x
    for contacts, sought in ((scenes.contacts(), []), (some, [False])):
        script = _Script([_outcome("held")], (scenes.grasp(),))
        list(grasp_with_tactile_check(scenario, contacts, script))
        assert script.sought == sought
        assert bool(script.calls[0]["load"].toward) == bool(sought)


@pytest.mark.parametrize(("rows", "is_seen"), [([0, 1, 2, 3, 4, 5], True), ([1, 2, 4], False)])
def test_a_surface_of_contacts_with_an_unseen_end_says_so(
    tmp_path: Path, rows: list[int], is_seen: bool
) -> None:
    scenario = scenes.scenario(BOX, scenes.hand(), region=[0.4] * 3, pose="stable")
    contacts, path = scenes.contacts().subset(rows), tmp_path / "contacts.ply"
    contacts.save(path, header=provenance.describe(**scenario.warnings(contacts)))
    source = ContactSource(path)
    made = estimate_file([source], tmp_path / "estimated", estimator="gpis")
    said = " ".join(provenance.read(made.path).get("warnings") or ())
    assert ("the end beyond" not in said) == is_seen


def test_contacts_of_an_object_explored_anew_replace_those_in_the_file(tmp_path: Path) -> None:
    contacts = _face_contacts(np.zeros(3))
    contacts.save(tmp_path / "contacts.ply")
    stages = StoredStages(tmp_path, Stopwatch(), SILENT)
    anew = _face_contacts(np.array([0.1, 0.0, 0.0]))  # as many, somewhere else
    stages.estimate(scenes.scenario(BOX, scenes.hand()), anew)
    stored = Contacts.load(tmp_path / "contacts.ply")
    assert_allclose(stored.points, anew.points, rtol=0.0, atol=1e-6)


# ---- lifts in Drake -------------------------------------------------------------------------


def _face_contacts(offset: np.ndarray) -> Contacts:
    """Return twelve contacts of the box, all of them moved by an offset (3,) [m]."""
    low, high = BOX.mesh.bounds
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal = side * np.eye(3)[axis]
            along = 0.5 * half * np.eye(3)[(axis + 1) % 3]
            for way in (-1.0, 1.0):
                points.append(middle + half * normal + way * along + offset)
                normals.append(normal)
    return Contacts(np.array(points), np.array(normals))


def _attempts(offset: np.ndarray, attempts: int, seed: int = 0, closings: int = 0) -> list[Attempt]:
    config = RunConfig("box", estimator="blend", attempts=attempts, closings=closings, seed=seed)
    scenario = Scenario.from_config(config, BOX, ALLEGRO)
    return list(grasp_with_tactile_check(scenario, _face_contacts(offset)))


def _holds(attempts: list[Attempt]) -> bool:
    outcome = attempts[-1].outcome
    return outcome is not None and outcome.held


@pytest.mark.slow
def test_a_correct_estimate_passes_the_tactile_check_at_once() -> None:
    (only,) = _attempts(np.zeros(3), 3, closings=5)
    assert only.outcome.reason == "held"


@pytest.mark.slow
def test_contacts_of_aborted_grasps_correct_a_displaced_estimate() -> None:
    # The contacts are 30 mm off, so that the hand collides with the true box.
    aside, seeds = np.array([0.03, 0.0, 0.0]), (0, 1, 2)
    assert not any(_holds(_attempts(aside, 1, seed)) for seed in seeds)
    assert sum(_holds(_attempts(aside, 1, seed, closings=5)) for seed in seeds) >= 2
    runs = [_attempts(aside, 3, seed) for seed in seeds]
    for before, after in chain.from_iterable(map(pairwise, runs)):
        assert before.outcome.reason == "aborted"
        assert before.lesson is not None
        known = 0 if before.lesson.lost else len(before.contacts) + before.lesson.felt
        assert len(after.contacts) == known + before.lesson.touched
        # The touches after each attempt are on the true object, where it is then.
        measured = after.contacts.points[-before.lesson.touched :]
        assert before.lesson.touched
        X_OE = np.linalg.inv(after.scenario.truth.X_EO)
        on_object = trimesh.transform_points(measured, X_OE)
        assert distances_to_mesh(on_object, BOX.mesh)[0].max() < 0.01
    assert sum(map(_holds, runs)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("motion", [(0.008, -0.006, 0.1), (0.12, 0.05, 0.9)])
def test_a_displaced_object_is_found_again_by_touch(motion: tuple[float, ...]) -> None:
    config = RunConfig("box", hand="allegro", region=[0.5, 0.5, 0.3], pose="stable", seed=5)
    scenario = Scenario.from_config(config)
    mesh, X_EO = scenario.truth.shape.mesh, planar_pose(np.array(motion))
    points, faces = trimesh.sample.sample_surface(mesh, 20, seed=0)
    above = mesh.face_normals[faces][:, 2] > -0.5
    contacts = Contacts(points[above], mesh.face_normals[faces][above])
    found, touched, lesson = touch_more(scenario.moved(X_EO), contacts, moved=True)
    assert lesson.moved > 0.005
    on_object = trimesh.transform_points(touched.points, np.linalg.inv(found.truth.X_EO))
    assert distances_to_mesh(on_object, mesh)[0].max() < 0.003
    assert len(touched) > len(contacts)
