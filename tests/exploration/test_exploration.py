"""Exploration by a finger that is a ray, on exact shapes."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import product

import numpy as np
import pytest
import trimesh
from analytic_surfaces import Analytic, Ball, cube_bounds

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    STEP_FRACTION,
    Exploration,
    ExplorationState,
    ExplorationStrategy,
    HandPose,
    NextProbe,
    Probe,
    ProbeOutcome,
    TactilePerception,
    TargetPolicy,
    Workspace,
    advance,
    begin,
    choose,
    explore,
    explore_steps,
)
from lis_grasp.exploration.targets import Targets, _tried
from lis_grasp.exploration.workspace import sample_zero_level_set
from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface
from lis_grasp.surfaces.contact_checks import doubt_of_side


@dataclass
class RayProber:
    """A finger without width: ray and triangles (Moeller, Trumbore 1997)."""

    mesh: trimesh.Trimesh
    probes: list[Probe] = field(default_factory=list)

    def probe(self, probe: Probe, obstacles: object = None) -> ProbeOutcome:
        self.probes.append(probe)
        triangles = np.asarray(self.mesh.triangles)
        e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        cross = np.cross(probe.direction, e2)
        determinant = np.einsum("fk,fk->f", e1, cross)
        inverse = 1.0 / np.where(np.abs(determinant) > 1e-15, determinant, np.inf)
        away = probe.start - triangles[:, 0]
        u = inverse * np.einsum("fk,fk->f", away, cross)
        turned = np.cross(away, e1)
        v = inverse * (turned @ probe.direction)
        t = inverse * np.einsum("fk,fk->f", e2, turned)
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t > 0.0) & (inverse != 0.0)
        if not hit.any():
            return ProbeOutcome(probe, "missed")
        face = np.flatnonzero(hit)[np.argmin(t[hit])]
        normal = self.mesh.face_normals[face]
        if normal @ probe.direction > 0.0:
            return ProbeOutcome(probe, "blocked")  # the start was inside
        if t[face] > probe.standoff + probe.overshoot:
            return ProbeOutcome(probe, "missed")
        return ProbeOutcome(
            probe, "touched", Contacts([probe.start + t[face] * probe.direction], [normal])
        )


class NeverProber:
    """Makes no contact."""

    def __init__(self, status: str) -> None:
        self.status = status

    def probe(self, probe: Probe, obstacles: object = None) -> ProbeOutcome:
        return ProbeOutcome(probe, self.status)


def policy_for(shape: Shape) -> TargetPolicy:
    center = shape.mesh.bounds.mean(axis=0)
    return TargetPolicy(Workspace(STEP_FRACTION * shape.size, center, shape.size))


@cache
def explored(
    name: str, *, estimator: str, touches: int, seed: int = 0, size: float | None = None
) -> tuple[Shape, Exploration]:
    shape = shapes.build(name, size)
    exploration = explore(
        RayProber(shape.mesh),
        TactilePerception(ESTIMATORS[estimator]),
        ExplorationStrategy(policy_for(shape), touches),
        rng=np.random.default_rng(seed),
    )
    return shape, exploration


class InwardProber(RayProber):
    """A prober whose normals have the wrong sign."""

    def probe(self, probe: Probe, obstacles: object = None) -> ProbeOutcome:
        outcome = super().probe(probe)
        touched = replace(outcome.contacts, normals=-outcome.contacts.normals)
        return replace(outcome, contacts=touched)


@pytest.mark.parametrize("kind", [RayProber, InwardProber])
def test_normals_of_a_prober_that_point_inward_are_warned_of_once(kind: type[RayProber]) -> None:
    shape = shapes.build("box")
    perception = TactilePerception(ESTIMATORS["gpis"])
    strategy = ExplorationStrategy(policy_for(shape), 12)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        exploration = explore(kind(shape.mesh), perception, strategy)
    # The words of an estimate, at the first contacts that show it.
    counts = range(2, len(exploration.contacts) + 1)
    words = [doubt for n in counts if (doubt := doubt_of_side(exploration.contacts[:n]))]
    assert [str(w.message) for w in told] == words[:1]
    assert bool(words) == (kind is InwardProber)


def coverage(shape: Shape, contacts: Contacts) -> float:
    """Return the fraction of the surface within a step of a contact, as in the paper."""
    samples, _ = trimesh.sample.sample_surface(shape.mesh, 4000, seed=0)
    apart = np.linalg.norm(samples[:, None] - contacts.points, axis=-1)
    return float(np.mean(apart.min(axis=1) < STEP_FRACTION * shape.size))


# ---------------------------------------------------------------- probes


def test_a_probe_runs_from_its_start_to_its_end_through_its_target() -> None:
    probe = Probe([1.0, 0.0, 0.0], [0.0, 0.0, -2.0], 0.3, 0.1)
    np.testing.assert_array_equal(probe.direction, [0, 0, -1])
    np.testing.assert_allclose(probe.start, [1, 0, 0.3])
    np.testing.assert_allclose(probe.end, [1, 0, -0.1])


VALID = {
    Probe: {"target": [0, 0, 0], "direction": [0, 0, 1], "standoff": 0.1, "overshoot": 0.0},
    ProbeOutcome: {
        "probe": Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1),
        "status": "touched",
        "contacts": Contacts([[0, 0, 0]], [[0, 0, -1]]),
    },
    HandPose: {"X_OH": np.eye(4), "joint_positions": [0.1]},
    Workspace: {"step": 0.03, "center": [0, 0, 0], "size": 0.12},
}


@pytest.mark.parametrize(
    ("kind", "option", "value", "named"),
    [
        (Probe, "target", [0, 0], "target"),
        (Probe, "target", [0, 0, np.nan], "target"),
        (Probe, "direction", [0, 0, 0], "direction"),
        (Probe, "standoff", -0.1, "standoff"),
        (Probe, "overshoot", np.inf, "overshoot"),
        (ProbeOutcome, "status", "lost", "status"),
        (ProbeOutcome, "status", "missed", "contacts"),
        (ProbeOutcome, "contacts", Contacts.empty(), "contacts"),
        (ProbeOutcome, "duration", -1.0, "duration"),
        (ProbeOutcome, "moved", np.nan, "moved"),
        (ProbeOutcome, "reason", 1, "reason"),
        (ProbeOutcome, "free_points", [[0, 0, np.inf]], "free_points"),
        (HandPose, "X_OH", np.eye(3), "X_OH"),
        (HandPose, "X_OH", np.full((4, 4), np.nan), "X_OH"),
        (HandPose, "joint_positions", [[0.0]], "joint_positions"),
        (Workspace, "step", 0.0, "step"),
        (Workspace, "size", -1.0, "size"),
        (Workspace, "size", np.nan, "size"),
        (Workspace, "center", [0, 0], "center"),
        (Workspace, "center", [0, 0, np.inf], "center"),
    ],
)
def test_an_invalid_value_of_a_record_is_refused(
    kind: type, option: str, value: object, named: str
) -> None:
    kind(**VALID[kind])
    with pytest.raises(InvalidOptionError) as error:
        kind(**{**VALID[kind], option: value})
    assert error.value.option == named


# ---------------------------------------------------------------- samples of the zero level set


def test_level_set_samples_are_on_the_surface_with_outward_normals() -> None:
    ball = Ball(0.05, np.array([0.01, 0.0, -0.02]))
    points, normals = sample_zero_level_set(ball, ball.bounds + 0.01 * np.array([[-1], [1]]), 0.01)
    # A secant step on a distance that bends by cell / radius leaves less than 1/50 of a cell.
    assert np.abs(ball.evaluate(points)).max() < 0.01 / 50.0
    np.testing.assert_allclose(normals, ball.gradient(points))
    # Every point of the sphere has a sample within a cell's diagonal.
    rng = np.random.default_rng(0)
    places = rng.normal(size=(200, 3))
    places = ball.center + ball.radius * places / np.linalg.norm(places, axis=1, keepdims=True)
    apart = np.linalg.norm(places[:, None] - points, axis=-1).min(axis=1)
    assert apart.max() < 0.01 * np.sqrt(3.0)


def test_a_jump_over_zero_is_no_surface() -> None:
    # It jumps from inside to outside at x = 0, without a zero in between.
    shelf = Analytic(lambda p: p[..., 2] + np.where(p[..., 0] < 0.0, -1.0, 1.0), cube_bounds(1.0))
    points, _ = sample_zero_level_set(shelf, cube_bounds(0.5), 0.09)
    assert len(points) == 0


def test_without_a_sign_change_there_are_no_samples() -> None:
    points, normals = sample_zero_level_set(Ball(0.01), np.array([[1.0] * 3, [1.2] * 3]), 0.05)
    assert points.shape == normals.shape == (0, 3)


# ---------------------------------------------------------------- the loop


class Scripted:
    """A policy of one repeated probe, and a prober that returns given contacts."""

    def __init__(self, answers: Sequence[Contacts], *, poses: bool = False) -> None:
        self.answers = list(answers)
        self.poses = poses
        self.seen: list[tuple[int, bool, int]] = []

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        self.seen.append((len(contacts), surface is None, len(outcomes)))
        return Probe([0, 0, 0], [0, 0, 1], 0.1, 0.1) if self.answers else None

    def probe(self, probe: Probe, obstacles: object = None) -> ProbeOutcome:
        contacts = self.answers.pop(0)
        free = np.full((2, 3), float(len(self.answers)))
        status = "touched" if len(contacts) else "missed"
        count = float(len(self.answers))
        hand_pose = HandPose(np.eye(4), np.array([count])) if self.poses else None
        return ProbeOutcome(probe, status, contacts, free, duration=0.5, hand_pose=hand_pose)


def touch_at(*heights: float) -> Contacts:
    points = [[0.0, 0.0, h] for h in heights]
    # A prober may repeat its free space in the contacts.
    return Contacts(points, [[0.0, 0.0, 1.0]] * len(points), free_points=[[9.0, 9.0, 9.0]])


def run(script: Scripted, touches: int, **options: object) -> Exploration:
    perception = TactilePerception(lambda contacts: Ball(1.0))
    strategy = ExplorationStrategy(script, touches)
    return explore(script, perception, strategy, rng=np.random.default_rng(0), **options)


def test_an_exploration_ends_with_the_wanted_number_of_contacts() -> None:
    exploration = run(Scripted([touch_at(0.0, 0.1), touch_at(0.2, 0.3), touch_at(0.4)]), 3)
    np.testing.assert_array_equal(exploration.contacts.points[:, 2], [0.0, 0.1, 0.2])
    assert len(exploration.outcomes) == 2


def test_an_exploration_ends_when_the_policy_has_no_probe_left() -> None:
    exploration = run(Scripted([touch_at(0.0), Contacts.empty()]), 5)
    assert exploration.summary() == "1 contact from 2 probes (1 touched, 1 missed, 0 blocked)"
    assert exploration.duration == 1.0


def test_a_repeated_contact_counts_once() -> None:
    exploration = run(Scripted([touch_at(0.0, 0.0005), touch_at(0.0009), touch_at(0.0011)]), 5)
    np.testing.assert_array_equal(exploration.contacts.points[:, 2], [0.0, 0.0011])


def test_free_space_is_kept_once_whether_touched_or_missed() -> None:
    exploration = run(Scripted([touch_at(0.0), Contacts.empty(), touch_at(0.1)]), 5)
    np.testing.assert_array_equal(exploration.contacts.free_points[:, 0], [2, 2, 1, 1, 0, 0])


def test_the_policy_gets_all_contacts_and_outcomes() -> None:
    script = Scripted([Contacts.empty(), touch_at(0.0), touch_at(0.1)])
    run(script, 5)
    assert script.seen == [(0, True, 0), (0, True, 1), (1, False, 2), (2, False, 3)]


def test_the_steps_are_the_first_state_one_for_each_probe_and_the_end() -> None:
    script = Scripted([touch_at(0.0), Contacts.empty(), touch_at(0.0001), touch_at(0.1, 0.2)])
    perception = TactilePerception(lambda contacts: Ball(1.0))
    strategy = ExplorationStrategy(script, 3)
    states = list(explore_steps(script, perception, strategy))
    assert [len(state.contacts) for state in states] == [0, 1, 1, 1, 3, 3]
    assert [len(state.contacts) for state in states[:-1] if state.is_new] == [1, 3]
    assert [state.ended for state in states] == [*[""] * 5, "3 contacts made"]
    start = begin(perception, strategy, states[2].observations)
    resumed = list(explore_steps(script, perception, strategy, start=start))
    assert len(resumed[0].outcomes) == 2


def test_an_exploration_without_touches_is_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        run(Scripted([]), 0)
    assert error.value.option == "touches"


# ---------------------------------------------------------------- the frontier


def test_the_first_six_probes_come_from_all_sides_to_the_centre() -> None:
    shape, exploration = explored("box", estimator="gpis", touches=6)
    directions = np.array([outcome.probe.direction for outcome in exploration.outcomes])
    assert {tuple(d) for d in directions.round().astype(int).tolist()} == {
        tuple(int(x) for x in d) for d in np.vstack([np.eye(3), -np.eye(3)])
    }
    for outcome in exploration.outcomes:
        assert np.abs(outcome.probe.target).max() <= 0.1 * shape.size
        assert np.abs(outcome.probe.start).max() > 0.5 * shape.size  # from outside of the object


def test_later_targets_are_on_the_estimate_a_step_from_the_nearest_contact() -> None:
    step, radius = 0.03, 0.06
    ball = Ball(radius)
    policy = TargetPolicy(Workspace(step=step, center=np.zeros(3), size=2.0 * radius))
    axes = np.vstack([np.eye(3), -np.eye(3)])
    outcomes = [
        ProbeOutcome(Probe(np.zeros(3), -n, 0.1, 0.0), "touched", Contacts([radius * n], [n]))
        for n in axes
    ]
    contacts = Contacts(radius * axes, axes)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        probe = policy.next_probe(contacts, ball, outcomes=outcomes, rng=rng)
        assert np.linalg.norm(probe.target) == pytest.approx(radius, abs=step / 100.0)
        nearest = np.linalg.norm(contacts.points - probe.target, axis=1).min()
        assert nearest == pytest.approx(step, rel=0.2)
        np.testing.assert_allclose(probe.direction, -probe.target / radius, atol=0.02)
        assert np.linalg.norm(probe.start) == pytest.approx(radius + step, rel=0.02)


def test_without_a_frontier_the_largest_gap_is_the_target() -> None:
    # A ball is touched everywhere except around one point.
    radius = 0.06
    normals = fibonacci_directions(200)
    gap = np.array([0.6, 0.0, 0.8])
    normals = normals[np.linalg.norm(radius * (normals - gap), axis=1) > 0.02]
    outcomes = [
        ProbeOutcome(Probe(2 * radius * n, -n, 0.1, 0.1), "touched", Contacts([radius * n], [n]))
        for n in normals
    ]
    policy = TargetPolicy(Workspace(step=0.03, center=np.zeros(3), size=2.0 * radius))
    probe = policy.next_probe(
        Contacts(radius * normals, normals),
        Ball(radius),
        outcomes=outcomes,
        rng=np.random.default_rng(0),
    )
    assert np.linalg.norm(probe.target - radius * gap) < 0.01  # a cell of the search, and its half


def every_shape(*quick: tuple[str, str]) -> pytest.MarkDecorator:
    """Return all estimators and shapes; all but the `quick` ones are slow."""
    every = product(("gpis", "lis"), shapes.NAMES)
    cases = [pytest.param(*pair, marks=() if pair in quick else pytest.mark.slow) for pair in every]
    return pytest.mark.parametrize(("estimator", "name"), cases)


@pytest.mark.slow
@every_shape(("gpis", "hollow_cylinder"))
def test_forty_touches_cover_nine_tenths_of_every_object(estimator: str, name: str) -> None:
    shape, exploration = explored(name, estimator=estimator, touches=40)
    assert len(exploration.contacts) == 40
    assert coverage(shape, exploration.contacts) > 0.9
    # The planes of LIS have no end, and probes beyond an edge miss: still fewer than touches.
    assert sum(outcome.status == "missed" for outcome in exploration.outcomes) < 40


@pytest.mark.by_default("gpis-hollow_cylinder")
@every_shape(("gpis", "hollow_cylinder"), ("lis", "box"))
def test_the_first_touches_are_about_a_step_apart(estimator: str, name: str) -> None:
    # Every object has room for more than twenty touches a step apart.
    shape, exploration = explored(name, estimator=estimator, touches=20)
    assert 0.5 < exploration.contacts.spacing / (STEP_FRACTION * shape.size) < 1.1


@pytest.mark.slow
def test_the_bore_of_a_tube_is_touched_from_within() -> None:
    shape, exploration = explored("hollow_cylinder", estimator="gpis", touches=40)
    points, normals = exploration.contacts.points, exploration.contacts.normals
    inward = np.einsum("nk,nk->n", points[:, :2], normals[:, :2]) < -1e-6
    assert inward.sum() >= 3
    radius = np.hypot(*points[inward, :2].T)
    np.testing.assert_allclose(radius, 0.225 * shape.size, rtol=1e-3)


@pytest.mark.by_default("gpis")
@pytest.mark.parametrize("estimator", ["gpis", "lis"])
def test_a_seed_decides_the_touches(estimator: str) -> None:
    runs = [
        explored.__wrapped__("pentagon", estimator=estimator, touches=9, seed=seed)[1].contacts
        for seed in (0, 0, 1)
    ]
    assert runs[0].points.tobytes() == runs[1].points.tobytes()
    assert runs[0].normals.tobytes() == runs[1].normals.tobytes()
    apart = np.linalg.norm(runs[0].points[:, None] - runs[2].points, axis=-1).min(axis=1)
    assert np.median(apart) > 1e-3


def test_exploration_does_not_depend_on_scale_and_position() -> None:
    shape = shapes.pentagon(0.1)
    moved = shape.mesh.copy()
    offset = np.array([0.3, -0.2, 0.5])
    moved.apply_scale(10.0)
    moved.apply_translation(offset)
    points = []
    for mesh, factor, center in ((shape.mesh, 1.0, np.zeros(3)), (moved, 10.0, offset)):
        exploration = explore(
            RayProber(mesh),
            TactilePerception(
                lambda contacts, factor=factor, center=center: Ball(0.045 * factor, center)
            ),
            ExplorationStrategy(
                TargetPolicy(Workspace(step=0.025 * factor, center=center, size=0.1 * factor)),
                touches=25,
            ),
            rng=np.random.default_rng(0),
        )
        points.append((exploration.contacts.points - center) / factor)
    np.testing.assert_allclose(points[0], points[1], atol=1e-9)


@pytest.mark.parametrize("status", ["missed", "blocked"])
def test_an_exploration_without_contacts_ends(status: str) -> None:
    exploration = explore(
        NeverProber(status),
        TactilePerception(ESTIMATORS["lis"]),
        ExplorationStrategy(
            TargetPolicy(Workspace(step=0.03, center=np.zeros(3), size=0.12)), touches=5
        ),
        rng=np.random.default_rng(0),
    )
    assert len(exploration.contacts) == 0
    assert len(exploration.outcomes) == 40  # four for each touch and twenty more
    starts = np.array([outcome.probe.start for outcome in exploration.outcomes])
    assert len(np.unique(starts.round(6), axis=0)) == 40


def test_a_target_is_not_tried_twice_from_the_same_side() -> None:
    shape = shapes.build("mallet")
    prober = RayProber(shape.mesh)
    explore(
        prober,
        TactilePerception(ESTIMATORS["lis"]),
        ExplorationStrategy(policy_for(shape), touches=14),
        rng=np.random.default_rng(3),
    )
    tries = prober.probes[6:]
    targets = np.array([probe.target for probe in tries])
    directions = np.array([probe.direction for probe in tries])
    apart = np.linalg.norm(targets[:, None] - targets, axis=-1) + np.eye(len(tries))
    same = (apart < 0.002) & (directions @ directions.T > np.cos(np.radians(5.0)))
    assert not same.any()


def test_a_target_is_given_up_after_three_failed_probes_from_other_sides() -> None:
    place, up = np.array([[0.1, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    sides = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    failed = [ProbeOutcome(Probe([0.101, 0.0, 0.0], side, 0.1, 0.0), "missed") for side in sides]
    gap = np.array([0.01])
    assert not _tried(place, up, gap, failed[:2])[0]
    assert _tried(place, up, gap, failed)[0]
    assert not _tried(place + 0.01, up, gap, failed)[0]


def test_no_target_is_in_free_space() -> None:
    # The estimate is a ball of 1 m; a link passed through a ball about its pole without a touch.
    pole = np.array([[0.0, 0.0, 1.0]])
    c = np.sqrt(0.5)
    normals = np.vstack([np.eye(3)[:2], -np.eye(3), [[c, 0, c], [-c, 0, c], [0, c, c], [0, -c, c]]])
    touched = Contacts(normals, normals)
    carving = Contacts(touched.points, touched.normals, free_points=pole, free_radii=[0.4])
    space = Workspace(0.5, np.zeros(3), 2.0)
    outcomes = [
        ProbeOutcome(
            Probe([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.1, 0.1), "touched", touched.subset([2])
        )
    ]
    before = Targets.find(space, touched, Ball(1.0), outcomes)
    after = Targets.find(space, carving, Ball(1.0), outcomes)
    near = np.linalg.norm(after.points - pole, axis=1) < 0.3
    far = np.linalg.norm(after.points - pole, axis=1) > 0.9
    assert near.any()
    assert before.eligible[near].all()
    assert not after.eligible[near].any()
    np.testing.assert_array_equal(after.eligible[far], before.eligible[far])


def test_the_first_contacts_have_the_free_space_known_by_then() -> None:
    exploration = run(Scripted([touch_at(0.0), Contacts.empty(), touch_at(0.1, 0.2)]), 5)
    first = exploration.first(2)
    np.testing.assert_array_equal(first.points[:, 2], [0.0, 0.1])
    np.testing.assert_array_equal(first.free_points[:, 0], [2, 2, 1, 1, 0, 0])
    np.testing.assert_array_equal(exploration.first(1).free_points[:, 0], [2, 2])
    assert len(exploration.first(9)) == len(exploration.contacts)


@pytest.mark.parametrize("touches", [1, 2, 3])
def test_a_replay_knows_nothing_of_later_probes(touches: int) -> None:
    answers = [touch_at(0.0), Contacts.empty(), touch_at(0.1, 0.2), Contacts.empty()]
    exploration, shorter = run(Scripted(answers), 5), run(Scripted(answers), touches)
    replayed = Exploration.replay(exploration.observations, touches=touches)
    first = exploration.first(touches)
    assert len(replayed.outcomes) == len(shorter.outcomes)
    assert replayed.duration == shorter.duration
    for name in ("points", "free_points", "free_radii"):
        expected = getattr(replayed.contacts, name)
        np.testing.assert_array_equal(getattr(first, name), expected)
    # The script counts its free points down from the number of answers that are left.
    np.testing.assert_array_equal(first.points, shorter.contacts.points)
    np.testing.assert_array_equal(first.free_points, shorter.contacts.free_points)


def test_steps_are_repeated_from_any_earlier_state() -> None:
    shape = shapes.build("box")
    prober = RayProber(shape.mesh)
    perception = TactilePerception(ESTIMATORS["gpis"])
    strategy = ExplorationStrategy(policy_for(shape), touches=9)

    def step_on(state: ExplorationState, outcome: ProbeOutcome, seed: int) -> tuple:
        state = advance(perception, state, outcome)
        return state, choose(strategy, state, rng=np.random.default_rng(seed))

    states = [begin(perception, strategy)]
    chosen = [choose(strategy, states[0], rng=np.random.default_rng(0))]
    while isinstance(chosen[-1], NextProbe):
        outcome = prober.probe(chosen[-1].probe)
        state, following = step_on(states[-1], outcome, len(states))
        states.append(state)
        chosen.append(following)
    assert chosen[-1] == "9 contacts made"
    for k in (0, 4, 7):
        state, following = states[k], chosen[k]
        for later, outcome in enumerate(states[-1].outcomes[k:], start=k + 1):
            np.testing.assert_array_equal(following.probe.target, outcome.probe.target)
            state, following = step_on(state, outcome, later)
        assert following == chosen[-1]
        np.testing.assert_array_equal(state.contacts.points, states[-1].contacts.points)


def test_touches_are_one_per_kept_contact_in_order() -> None:
    answers = [touch_at(0.0, 0.0005), Contacts.empty(), touch_at(0.0009, 0.1), touch_at(0.2, 0.3)]
    exploration = run(Scripted(answers, poses=True), 3)
    np.testing.assert_array_equal(exploration.contacts.points[:, 2], [0.0, 0.1, 0.2])
    poses = [outcome.hand_pose for outcome in exploration.touches]
    assert [pose.joint_positions[0] for pose in poses if pose] == [3, 1, 0]
