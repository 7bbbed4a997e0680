"""Space carving: closed forms, contacts that stay, and the true objects."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from analytic_surfaces import Analytic, cube_bounds, differences, sphere, union
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.cli.main import main
from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    Exploration,
    ExplorationStrategy,
    TactilePerception,
    TactileSensor,
    Workspace,
    explore,
)
from lis_grasp.meshing import extract_mesh
from lis_grasp.probing.kinematic_prober import KinematicProber
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.mesh_distance import InsideTest, distances_to_mesh
from lis_grasp.stages.estimate import estimate
from lis_grasp.stages.touch import make_policy
from lis_grasp.surfaces import ESTIMATORS, ImplicitSurface, carved, judge_contacts
from lis_grasp.surfaces.carved_implicit_surface import (
    depths_in_free_space,
    outside_bodies,
    walls_down_to,
)
from lis_grasp.typing import FloatArray

RADIUS = 0.04
POSITION_NOISE, NORMAL_NOISE = 0.0005, 0.05  # [m], [rad]
LOBE, LOBE_RADIUS = np.array([0.05, 0.0, 0.0]), 0.02


# A ball, and a second ball on its side that is not there in truth; exact distances outside.
WITH_LOBE = Analytic(
    union(sphere(RADIUS), sphere(LOBE_RADIUS, LOBE)),
    cube_bounds(0.08),
    doubt=lambda p: np.full(p.shape[:-1], 1e-3),
)


def on_ball(directions: FloatArray, **free: npt.ArrayLike) -> Contacts:
    return Contacts(RADIUS * directions, directions, **free)


def test_an_estimate_ends_before_a_known_wall() -> None:
    wall, margin = 0.03, 0.002  # its face at x = 30 mm, inside of the ball of 40 mm

    def distances(points: FloatArray) -> FloatArray:
        return np.asarray(wall - points[:, 0])

    ball = Analytic(sphere(RADIUS), cube_bounds(0.08), doubt=lambda p: np.full(p.shape[:-1], 1e-3))
    cut = outside_bodies(ball, distances, margin)
    mesh = extract_mesh(cut)
    # Dual contouring is exact on planes; it extrapolates a ball by a fraction of a cell.
    assert mesh.bounds[1, 0] == pytest.approx(wall - margin, abs=1e-5)
    assert mesh.bounds[0, 0] == pytest.approx(-RADIUS, abs=1e-4)
    inside = np.array([[wall - margin, 0.0, 0.0]])
    assert_allclose(cut.evaluate(inside), 0.0, atol=1e-12)
    assert_allclose(cut.gradient(inside + [1e-3, 0.0, 0.0]), [[1.0, 0.0, 0.0]], atol=1e-6)
    # A surface that nobody touched is as unsure as it is deep in the estimate.
    assert cut.uncertainty(inside + [1e-3, 0.0, 0.0])[0] > 0.01
    assert outside_bodies(ball, lambda points: distances(points) + 1.0, margin) is ball


def some_directions(count: int, seed: int = 0) -> FloatArray:
    return random_directions(count, np.random.default_rng(seed))


def free_beside_the_ball(count: int = 400, seed: int = 1) -> Contacts:
    """Contacts on the ball, and balls of 1 cm, all free, that touch it or nearly so."""
    heights = np.random.default_rng(seed).uniform(0.0, 0.03, count)
    centers = (RADIUS + 0.01 + heights)[:, None] * some_directions(count, seed)
    return on_ball(some_directions(30), free_points=centers, free_radii=np.full(count, 0.01))


def lobe_of(surface: ImplicitSurface) -> FloatArray:
    """Return points of a fine grid that are in the estimate and not in the true ball."""
    axis = np.linspace(-0.08, 0.08, 41)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[(surface.evaluate(grid) < 0.0) & (np.linalg.norm(grid, axis=1) > RADIUS)]


# ---------------------------------------------------------------- closed forms


def test_a_lobe_in_free_space_is_carved_off() -> None:
    left = lobe_of(carved(WITH_LOBE, free_beside_the_ball(3000)))
    assert len(lobe_of(WITH_LOBE)) > 100
    assert len(left) < 0.1 * len(lobe_of(WITH_LOBE))


def test_the_value_is_the_larger_of_the_estimate_and_the_depth_in_a_ball() -> None:
    center, radius = np.array([0.06, 0.0, 0.0]), 0.015
    contacts = on_ball(some_directions(3), free_points=center[None], free_radii=[radius])
    surface = carved(WITH_LOBE, contacts, growth=0.0)
    points = np.random.default_rng(0).uniform(-0.08, 0.08, size=(5, 100, 3))
    depths = radius - np.linalg.norm(points - center, axis=-1)
    expected = np.maximum(WITH_LOBE.evaluate(points), depths)
    np.testing.assert_allclose(surface.evaluate(points), expected, atol=1e-15)


def test_outside_stays_outside_and_beside_the_balls_nothing_changes() -> None:
    contacts = free_beside_the_ball()
    surface = carved(WITH_LOBE, contacts, growth=0.0)
    points = np.random.default_rng(2).uniform(-0.08, 0.08, size=(4000, 3))
    before, after = WITH_LOBE.evaluate(points), surface.evaluate(points)
    assert np.all(after >= before)
    apart = np.linalg.norm(points[:, None] - contacts.free_points, axis=-1) - contacts.free_radii
    beside = apart.min(axis=1) > 0.0
    np.testing.assert_array_equal((after < 0.0)[beside], (before < 0.0)[beside])


def test_the_depth_of_surface_points_in_free_space_is_what_carving_adds() -> None:
    contacts, estimate = free_beside_the_ball(), WITH_LOBE
    directions = some_directions(2000, seed=3)
    points = np.vstack([RADIUS * directions, LOBE + LOBE_RADIUS * directions])
    points = points[np.abs(estimate.evaluate(points)) < 1e-12]  # none inside the other ball
    depths = depths_in_free_space(points, estimate, contacts)
    values = carved(estimate, contacts).evaluate(points)
    assert (values > 1e-3).sum() > 100
    assert_allclose(np.maximum(depths, 0.0), values, atol=1e-12)


def test_without_free_space_no_point_is_in_it() -> None:
    points, contacts = RADIUS * some_directions(5), on_ball(some_directions(3))
    assert (depths_in_free_space(points, WITH_LOBE, contacts) == -np.inf).all()
    assert depths_in_free_space(np.empty((0, 3)), WITH_LOBE, contacts).shape == (0,)


def test_the_gradient_is_that_of_the_value() -> None:
    surface = carved(WITH_LOBE, free_beside_the_ball(), growth=0.0)
    points = np.random.default_rng(3).uniform(-0.07, 0.07, size=(2000, 3))
    numeric = differences(surface, points, 1e-6)
    # Values are distances: where the difference is not of length 1 there is a crease between.
    smooth = np.abs(np.linalg.norm(numeric, axis=1) - 1.0) < 1e-6
    assert smooth.mean() > 0.99
    np.testing.assert_allclose(surface.gradient(points)[smooth], numeric[smooth], atol=1e-5)


def test_the_carved_surface_closes_and_faces_outward() -> None:
    mesh = extract_mesh(carved(WITH_LOBE, free_beside_the_ball()))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.1)


def test_uncertainty_grows_with_the_depth_that_was_carved() -> None:
    center = np.array([0.06, 0.0, 0.0])
    contacts = on_ball(some_directions(3), free_points=center[None], free_radii=[0.015])
    surface = carved(WITH_LOBE, contacts, growth=0.0)
    at = np.array([[0.046, 0.0, 0.0], [0.0, RADIUS, 0.0]])  # 16 mm deep in the lobe; on the ball
    np.testing.assert_allclose(surface.uncertainty(at), [np.hypot(1e-3, 0.016), 1e-3])


# ---------------------------------------------------------------- contacts


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(sorted(ESTIMATORS)))
def test_contacts_are_never_carved_off(seed: int, estimator: str) -> None:
    # Balls anywhere, in contradiction to the contacts too, as noise or a false touch makes them.
    rng = np.random.default_rng(seed)
    contacts = on_ball(
        some_directions(12, seed),
        free_points=rng.uniform(-0.06, 0.06, size=(50, 3)),
        free_radii=rng.uniform(0.0, 0.03, 50),
    )
    before = ESTIMATORS[estimator](contacts)
    after = carved(before, contacts)
    at_before, at_after = before.evaluate(contacts.points), after.evaluate(contacts.points)
    assert np.all(at_after >= at_before)
    assert np.all(at_after <= np.maximum(at_before, 1e-12))  # no ball reaches beyond a contact


@pytest.mark.parametrize(
    "free",
    [
        {},
        {"free_points": [LOBE]},  # a radius of 0, as files without one have
        {"free_points": [[0.0, 0.07, 0.0]], "free_radii": [0.02]},  # beside the estimate
        {"free_points": [[0.5, 0.0, 0.0]], "free_radii": [0.1]},  # far away
    ],
)
def test_an_estimate_without_contradiction_is_returned_as_it_is(free: dict) -> None:
    assert carved(WITH_LOBE, on_ball(some_directions(9), **free)) is WITH_LOBE


def test_a_margin_shrinks_the_balls() -> None:
    contacts = on_ball(some_directions(3), free_points=[[0.06, 0.0, 0.0]], free_radii=[0.015])
    surface = carved(WITH_LOBE, contacts, margin=0.002, growth=0.0)
    np.testing.assert_allclose(surface.spaces[0].radii, 0.013)
    for option in ("margin", "growth"):
        with pytest.raises(InvalidOptionError) as error:
            carved(WITH_LOBE, contacts, **{option: -0.001})
        assert error.value.option == option


@pytest.mark.parametrize(
    ("center", "grown"),
    [
        # 4 mm inside the lobe: 4 mm more, and half the way to the nearest contact is farther.
        ([0.066, 0.0, 0.0], 0.009),
        # 17 mm inside, 9 mm from the contact at the pole of x: halfway between 5 and 9.
        ([0.049, 0.0, 0.0], 0.007),
        # Its centre is outside of the lobe, its edge is not: it stays as it is.
        ([0.074, 0.0, 0.0], 0.005),
    ],
)
def test_a_ball_deep_inside_grows_at_most_halfway_to_a_contact(
    center: list[float], grown: float
) -> None:
    pole = np.array([[1.0, 0.0, 0.0]])
    contacts = on_ball(pole, free_points=[center], free_radii=[0.005])
    surface = carved(WITH_LOBE, contacts)
    np.testing.assert_allclose(surface.spaces[0].radii, [grown], atol=1e-12)


# ---------------------------------------------------------------- the hand


def explored(name: str, *, touches: int, seed: int) -> tuple[shapes.Shape, Exploration]:
    shape = shapes.build(name)
    space = Workspace(0.25 * shape.size, shape.mesh.bounds.mean(axis=0), shape.size)
    exploration = explore(
        KinematicProber(Hand.load("allegro"), shape.mesh),
        TactilePerception(ESTIMATORS["patch"]),
        ExplorationStrategy(
            make_policy("spread", space, TactileSensor()), touches=touches, space=space
        ),
        rng=np.random.default_rng(seed),
    )
    return shape, exploration


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "hollow_cylinder" else pytest.mark.slow)
        for name in shapes.NAMES
    ],
)
def test_free_space_is_outside_the_object(name: str) -> None:
    shape, exploration = explored(name, touches=12, seed=4)
    contacts = exploration.contacts
    apart, _ = distances_to_mesh(contacts.free_points, shape.mesh)
    outside = ~InsideTest(shape.mesh).inside(contacts.free_points)
    assert outside.all()
    # Conservative advancement ends within 0.02 mm of contact.
    assert np.all(contacts.free_radii < apart + 3e-5)
    assert len(contacts.free_points) > 100


@pytest.mark.slow
def test_carving_removes_no_point_of_the_object() -> None:
    shape, exploration = explored("hollow_cylinder", touches=12, seed=4)
    contacts = exploration.contacts
    points = np.random.default_rng(0).uniform(*shape.mesh.bounds, size=(3000, 3))
    true = trimesh.proximity.signed_distance(shape.mesh, points) > 1e-4
    for name, estimator in ESTIMATORS.items():
        before = estimator(contacts)
        after = carved(before, contacts, growth=0.0)
        changed = (before.evaluate(points) < 0.0) & (after.evaluate(points) >= 0.0)
        assert changed.any(), name
        assert not (changed & true).any(), name


@pytest.mark.by_default(".csv")
@pytest.mark.parametrize("suffix", [".ply", ".csv"])
def test_the_command_line_carves_the_free_space_of_a_contact_file(
    tmp_path: Path, suffix: str
) -> None:
    # Five touches leave one side of a ball to guess; a hand was there, 1 cm before the guess.
    normals = np.vstack([np.eye(3), -np.eye(3)])[:5]
    contacts = Contacts(
        RADIUS * normals, normals, free_points=[[0.0, 0.0, -0.8 * RADIUS]], free_radii=[0.015]
    )
    path = tmp_path / f"contacts{suffix}"
    contacts.save(path)
    volumes = {}
    for flag in ("--free-space", "--no-free-space"):
        output = tmp_path / flag
        output.mkdir()
        arguments = ["estimate", str(path), "--estimator", "gpis", flag, "--output", str(output)]
        assert main(arguments) == 0
        volumes[flag] = trimesh.load(output / "surface.ply").volume
    assert volumes["--free-space"] < 0.99 * volumes["--no-free-space"]


def flat_ring(height: float = 0.0, count: int = 8, seed: int | None = None) -> Contacts:
    """Contacts on the top and both walls of a ring of 6 mm on a table; of a seed with noise."""
    noise = np.random.default_rng(seed).normal if seed is not None else lambda size: np.zeros(size)
    at = 2.0 * np.pi * (np.arange(count) + 0.15 * noise(size=count))[:, None] / count
    out = np.hstack([np.cos(at), np.sin(at), 0.0 * at])
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    walls = [radius * out + 0.005 * up for radius in (0.045, 0.025)]
    points, normals = np.vstack([*walls, 0.035 * out + 0.006 * up]), np.vstack([out, -out, up])
    normals = normals + NORMAL_NOISE * noise(size=normals.shape)
    points = points + POSITION_NOISE * noise(size=points.shape) + [0.0, 0.0, height]
    return Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


@pytest.mark.parametrize("height", [0.0, -0.3])
def test_walls_near_a_table_go_on_straight_down_to_it(height: float) -> None:
    contacts = flat_ring(height)
    feet = walls_down_to(height, contacts)
    assert_allclose(feet.points[:, :2], contacts.points[:16, :2])  # of the walls, not of the top
    assert_allclose(feet.points[:, 2], height)
    assert_allclose(feet.normals, contacts.normals[:16])
    assert not len(walls_down_to(height - 0.02, contacts))  # too high above it


@pytest.mark.slow
def test_few_touches_show_a_flat_ring_better_if_its_walls_reach_the_table() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-0.06, 0.06, 33)] * 2, [0.001, 0.003, 0.005]), -1)
    radii = np.hypot(grid[..., 0], grid[..., 1])
    ring = (radii < 0.045) & (radii > 0.025)

    def overlap(surface: ImplicitSurface) -> float:
        inside = surface.evaluate(grid) < 0.0
        return float((inside & ring).sum() / (inside | ring).sum())

    noise = {"position_noise": POSITION_NOISE, "normal_noise": NORMAL_NOISE}
    gains = []
    for count, seed in product((4, 5), range(4)):
        contacts = flat_ring(count=count, seed=seed)
        without = overlap(estimate(contacts, **noise))
        gains.append(overlap(estimate(contacts, support_height=0.0, **noise)) - without)
    assert min(gains) > -0.05
    assert np.mean(gains) > 0.05  # 0.15 of eight other sets, of which none lost more than 0.01


def test_the_table_does_not_confirm_a_contact_that_lies() -> None:
    flipped = flat_ring(0.0)
    flipped = replace(
        flipped, normals=np.where(np.arange(24)[:, None] == 3, -1, 1) * flipped.normals
    )
    assert judge_contacts(flipped).rows("flipped").tolist() == [3]
    places = flipped.points + [0.001, 0.002, -0.003]
    assert_allclose(
        estimate(flipped, support_height=0.0).evaluate(places),
        estimate(judge_contacts(flipped).credible, support_height=0.0).evaluate(places),
    )
