"""Exploration policies: the target that each selects, and the surface that it searches."""

import numpy as np
import pytest
import trimesh
from analytic_surfaces import Analytic, Ball, cube_bounds

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.touch_coverage import reachable_coverage, touch_radius
from lis_grasp.exploration import (
    POLICIES,
    Exploration,
    ExplorationStrategy,
    Probe,
    ProbeOutcome,
    TactilePerception,
    TactileSensor,
    TargetPolicy,
    Workspace,
    explore,
)
from lis_grasp.exploration.policy import (
    TargetSelector,
    farthest,
    most_uncertain,
    uniform,
)
from lis_grasp.exploration.probe_motions import (
    contact_hull,
    surface_probe,
)
from lis_grasp.exploration.targets import Targets
from lis_grasp.geometry import hull_crossing
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.stages.scenario import known_place as workspace
from lis_grasp.stages.touch import make_policy
from lis_grasp.surfaces import ESTIMATORS

RADIUS = 0.05
NEAREST = np.array([0.01, 0.03, 0.05, 0.02, 0.04])


def ball(radius: float = RADIUS) -> Ball:
    """A ball round the origin, the less known the higher."""
    return Ball(radius, doubt=lambda p: 0.1 + p[..., 2])


def targets(eligible: list[bool]) -> Targets:
    points = np.array([[0.0, 0.0, z] for z in (0.05, 0.01, 0.02, 0.04, 0.03)])
    return Targets(points, points, NEAREST, np.array(eligible), 0.02)


def selected(select: TargetSelector, eligible: list[bool], seed: int = 0) -> int | None:
    return select(targets(eligible), ball(), rng=np.random.default_rng(seed))


def test_farthest_selects_the_eligible_target_with_the_largest_gap() -> None:
    assert selected(farthest, [True] * 5) == 2
    assert selected(farthest, [True, True, False, True, True]) == 4


def test_most_uncertain_selects_the_largest_deviation() -> None:
    assert selected(most_uncertain, [True] * 5) == 0
    assert selected(most_uncertain, [False, True, True, True, True]) == 3


def test_uniform_selects_every_eligible_target_equally_often() -> None:
    eligible = [True, False, True, True, True]
    counts = np.bincount([selected(uniform, eligible, seed) for seed in range(800)], minlength=5)
    assert counts[1] == 0
    # A quarter of 800 has a standard deviation of 12; four of them.
    np.testing.assert_allclose(counts[[0, 2, 3, 4]], 200, atol=49)


@pytest.mark.parametrize("name", POLICIES)
def test_without_eligible_targets_none_is_selected(name: str) -> None:
    assert selected(POLICIES[name].select, [False] * 5) is None


def six_touches() -> tuple[Contacts, list[ProbeOutcome]]:
    normals = np.vstack([np.eye(3), -np.eye(3)])
    outcomes = [
        ProbeOutcome(Probe(RADIUS * n, -n, 0.1, 0.0), "touched", Contacts([RADIUS * n], [n]))
        for n in normals
    ]
    return Contacts(RADIUS * normals, normals), outcomes


@pytest.mark.parametrize(("step", "radius"), [(0.02, RADIUS), (0.05, 0.055)])
def test_the_guess_is_searched_before_the_estimate(step: float, radius: float) -> None:
    # Six touches of a ball of 50 mm leave gaps of 46 mm. With steps of 20 mm the guess, which is
    # that ball, comes first. With steps of 50 mm it is covered, and the estimate, a ball of 55 mm
    # and farther from the contacts, is searched.
    contacts, outcomes = six_touches()
    # Known to be 0.2 m large, so that six contacts do not show a smaller object.
    space = Workspace(step, np.zeros(3), 0.2)
    policy = TargetPolicy(space, farthest, guess=lambda _: ball(RADIUS))
    rng = np.random.default_rng(0)
    probe = policy.next_probe(contacts, ball(0.055), outcomes=outcomes, rng=rng)
    # Samples are on the surface within a percent of a cell of 5 mm and more.
    assert np.linalg.norm(probe.target) == pytest.approx(radius, abs=2e-4)


def bar(size: tuple[float, float, float], turn: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_transform(trimesh.transformations.euler_matrix(*turn))


def corners_and_middles(mesh: trimesh.Trimesh) -> Contacts:
    points = np.vstack([mesh.vertices, mesh.triangles_center])
    return Contacts(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))


@pytest.mark.parametrize("factor", [0.1, 1.0, 3.0])
def test_the_felt_step_is_that_of_the_ball_of_the_same_area(factor: float) -> None:
    size = factor * np.array([0.3, 0.03, 0.02])
    corners = bar(tuple(size), (0.3, 0.5, 0.7)).vertices
    contacts = Contacts(corners, np.tile([0.0, 0.0, 1.0], (8, 1)))
    extent = float(np.ptp(corners, axis=0).max())
    space = Workspace(0.25 * extent, np.zeros(3), extent)
    area = 2.0 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    assert space.fitted_to(contacts).step == pytest.approx(0.25 * np.sqrt(area / np.pi))
    # The ball of a cube's area is larger than the cube's edge: the step stays.
    cube = corners_and_middles(bar((0.3, 0.3, 0.3), (0.0, 0.0, 0.0)))
    assert Workspace(0.05, np.zeros(3), 0.3).fitted_to(cube).step == 0.05


def test_lines_cross_the_hull_where_they_cross_the_box() -> None:
    mesh = bar((0.3, 0.025, 0.025), (0.3, 0.5, 0.7))
    hull = contact_hull(corners_and_middles(mesh))
    rng = np.random.default_rng(0)
    starts = 0.3 * rng.normal(size=(200, 3))
    directions = 0.05 * rng.normal(size=(200, 3)) - starts
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    enter, leave = hull_crossing(hull, starts, directions)
    along = np.linspace(-1.5, 1.5, 6001)[:, None, None]
    inside = hull_contains(mesh, starts + along * directions)  # (6001, 200)
    crosses = inside.any(axis=0)
    assert 20 < crosses.sum() < 180
    first = along[np.argmax(inside, axis=0), 0, 0]
    last = along[len(along) - 1 - np.argmax(inside[::-1], axis=0), 0, 0]
    # Along the line the samples are 0.5 mm apart; a line may cross a corner between two.
    np.testing.assert_allclose(enter[crosses], first[crosses], atol=5e-4)
    np.testing.assert_allclose(leave[crosses], last[crosses], atol=5e-4)
    missed = np.isinf(enter)
    assert not (missed & crosses).any()
    assert (missed | crosses).sum() > 195


def hull_contains(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    heights = points @ mesh.face_normals.T - np.einsum(
        "fk,fk->f", mesh.face_normals, mesh.triangles[:, 0]
    )
    return np.asarray((heights <= 0.0).all(axis=-1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "turn"),
    [
        ((0.3, 0.025, 0.025), (0.6, -0.7, 0.3)),
        ((0.2, 0.15, 0.01), (0.0, np.pi / 2.0, 0.0)),
    ],
)
def test_bars_and_plates_are_covered_with_few_missed_probes(
    size: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    mesh = bar(size, turn)
    shape = shapes.Shape.from_mesh(mesh, "bar")
    hand, space = Hand.load("allegro"), workspace(shape)
    exploration = explore(
        KinematicProber(hand, mesh),
        TactilePerception(ESTIMATORS["blend"]),
        ExplorationStrategy(make_policy("spread", space, TactileSensor()), touches=40, space=space),
        rng=np.random.default_rng(0),
    )
    assert len(exploration.contacts) == 40
    assert len(exploration.outcomes) <= 1.3 * 40
    covered = reachable_coverage(
        mesh, exploration.contacts, tip_radius=0.012, radius=touch_radius(mesh)
    )
    assert covered >= 0.9


def explored(name: str, policy: str) -> tuple[trimesh.Trimesh, Exploration]:
    shape = shapes.build(name, 0.2)
    space = Workspace(0.05, shape.mesh.bounds.mean(axis=0), shape.size)
    kind = POLICIES[policy]
    exploration = explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        TactilePerception(ESTIMATORS["gpis"]),
        ExplorationStrategy(
            TargetPolicy(
                space, kind.select, ESTIMATORS["gpis"] if kind.uses_gaussian_process else None
            ),
            touches=16,
            space=space,
        ),
        rng=np.random.default_rng(1),
    )
    return shape.mesh, exploration


@pytest.mark.slow
def test_spread_covers_more_than_random_with_as_many_touches() -> None:
    covered = {}
    for policy in ("spread", "random"):
        mesh, exploration = explored("box", policy)
        samples, _ = trimesh.sample.sample_surface(mesh, 2000, seed=0)
        apart = np.linalg.norm(samples[:, None] - exploration.contacts.points, axis=-1)
        covered[policy] = np.mean(apart.min(axis=1) < 0.05)
    assert covered["spread"] > covered["random"] + 0.05


# An upright cylinder without ends.
COLUMN = Analytic(lambda p: np.hypot(p[..., 0], p[..., 1]) - 0.03, cube_bounds(0.06))


def test_a_place_above_a_table_that_was_blocked_is_left_alone() -> None:
    # Low targets are touched at the height of a level motion, from starts of that height.
    angles, heights = np.meshgrid(np.arange(0.0, 2.0 * np.pi, 0.2), np.arange(0.002, 0.1, 0.006))
    normals = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1).reshape(-1, 3)
    contacts = Contacts(0.03 * normals + heights.reshape(-1, 1) * [0.0, 0.0, 1.0], normals)
    space = Workspace(0.02, np.array([0.0, 0.0, 0.05]), 0.1, support_height=0.0)
    target, out = np.array([0.03, 0.0, 0.005]), np.eye(3)[0]
    blocked = ProbeOutcome(
        surface_probe(target, out, space, contacts, COLUMN, []), "blocked", reason="the table"
    )
    for outcomes, left in (([], True), ([blocked], False)):
        targets = Targets.find(space, contacts, COLUMN, outcomes)
        near = np.linalg.norm(targets.points - target, axis=1) < 0.3 * space.step
        assert near.sum() > 3
        assert targets.eligible[near].any() == left


def test_a_low_wall_is_touched_by_a_level_motion_and_a_high_one_from_its_normal() -> None:
    space = Workspace(0.02, np.array([0.0, 0.0, 0.05]), 0.1, support_height=0.0, tip_radius=0.006)
    out = np.array([1.0, 0.0, 0.2]) / np.hypot(1.0, 0.2)
    contacts = Contacts(np.array([[0.03, 0.01, 0.005]]), out[None])
    low = surface_probe(np.array([0.03, 0.0, 0.003]), out, space, contacts, COLUMN, [])
    np.testing.assert_allclose(low.direction, [-1.0, 0.0, 0.0], atol=1e-12)
    assert low.target[2] == pytest.approx(0.0075)  # the tip's radius and 1.5 mm
    high = surface_probe(np.array([0.03, 0.0, 0.06]), out, space, contacts, COLUMN, [])
    np.testing.assert_allclose(high.direction, -out, atol=1e-12)


def test_after_a_miss_a_flat_object_is_touched_level_from_beyond_its_edge() -> None:
    space = Workspace(0.02, np.array([0.0, 0.0, 0.004]), 0.1, support_height=0.0, tip_radius=0.006)
    up = np.array([0.0, 0.0, 1.0])
    contacts = Contacts(np.array([[0.03, 0.0, 0.008]]), up[None])
    target = np.array([0.06, 0.0, 0.008])  # the estimate's top extends too far
    missed = ProbeOutcome(surface_probe(target, up, space, contacts, ball(0.03), []), "missed")
    again = surface_probe(target, up, space, contacts, ball(0.03), [missed])
    np.testing.assert_allclose(again.direction, [-1.0, 0.0, 0.0], atol=1e-12)


def test_the_wall_of_a_hole_is_not_touched_by_a_level_motion() -> None:
    tube = Analytic(
        lambda p: np.abs(np.hypot(p[..., 0], p[..., 1]) - 0.04) - 0.01, cube_bounds(0.06)
    )
    space = Workspace(0.02, np.array([0.0, 0.0, 0.02]), 0.1, support_height=0.0, tip_radius=0.006)
    contacts = Contacts(np.array([[0.05, 0.0, 0.02]]), np.eye(3)[:1])
    for radius, normal, level in ((0.05, 1.0, True), (0.03, -1.0, False)):
        target, out = np.array([radius, 0.0, 0.003]), np.array([normal, 0.0, 0.0])
        probe = surface_probe(target, out, space, contacts, tube, [])
        assert (probe.direction[2] == 0.0) == level
        assert level or probe.direction[2] < -0.5


# A ball of radius 1 about the origin holds the object.
SPACE = Workspace(0.1, np.zeros(3), 2.0 / np.sqrt(3.0))


def test_an_approach_begins_on_the_ball_around_the_object() -> None:
    starts = np.array([[0.0, 0.0, 0.4], [0.0, 0.8, 0.0], [0.0, 0.0, 1.5], [2.0, 0.0, 0.0]])
    lengths = SPACE.approach_distance(starts, np.tile([0.0, 0.0, -1.0], (4, 1)))
    np.testing.assert_allclose(lengths, [0.6, 0.6, 0.0, 0.0])
