"""The patch estimator against literal loops, exact solids, and the paper's estimator."""

from __future__ import annotations

import numpy as np
import pytest
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import LocalImplicitSurface, PatchImplicitSurface
from lis_grasp.surfaces._patch_segmentation import ContactPairs, cluster_pairs

NOISELESS = {"position_noise": 0.0, "normal_noise": 0.0}


def scattered_touches(
    points: np.ndarray, normals: np.ndarray, spacing: float, seed: int
) -> Contacts:
    """Points of a dense sample in random order, each at least `spacing` from those before it."""
    kept: list[int] = []
    for i in np.random.default_rng(seed).permutation(len(points)):
        if all(np.linalg.norm(points[i] - points[j]) >= spacing for j in kept):
            kept.append(int(i))
    return Contacts(points[kept], normals[kept])


def touched_box(half: np.ndarray, spacing: float, seed: int = 0, clear: float = 0.004) -> Contacts:
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            on_face = rng.uniform(-1, 1, (400, 3)) * (half - clear)
            on_face[:, axis] = side * half[axis]
            points.append(on_face)
            normals.append(np.tile(side * np.eye(3)[axis], (400, 1)))
    return scattered_touches(np.vstack(points), np.vstack(normals), spacing, seed)


def touched_sphere(radius: float, spacing: float, seed: int = 0) -> Contacts:
    normals = random_directions(1500, np.random.default_rng(seed))
    return scattered_touches(radius * normals, normals, spacing, seed)


def touched_cylinder(radius: float, half: float, spacing: float, seed: int = 0) -> Contacts:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, 2000)
    around = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2000)])
    side = radius * around + rng.uniform(-half + 0.004, half - 0.004, (2000, 1)) * [0, 0, 1]
    up = np.where(rng.uniform(size=2000) < 0.5, -1.0, 1.0)[:, None] * [0, 0, 1]
    disc = (radius - 0.004) * np.sqrt(rng.uniform(size=(2000, 1))) * around + half * up
    return scattered_touches(np.vstack([side, disc]), np.vstack([around, up]), spacing, seed)


def patch_count(surface: PatchImplicitSurface) -> int:
    return len(surface.patches)


def test_equals_its_expressions_term_by_term() -> None:
    surface = PatchImplicitSurface.from_contacts(touched_cylinder(0.05, 0.06, 0.035))
    for x in np.random.default_rng(1).uniform(-0.09, 0.09, (40, 3)):
        patches = [float(patch.value(x[None])[0]) for patch in surface.patches]
        solids = [
            min(max(patches[p] for p in term) for term in surface.expressions[k])
            for k in surface.expression_of
        ]
        nearest = min(np.linalg.norm(surface.points - x, axis=1))
        weights = np.exp(surface.mean.log_weights) * np.exp(
            -0.5 * (np.sum((surface.points - x) ** 2, axis=1) - nearest**2) / surface.mean.sigma**2
        )
        expected = float(weights @ np.array(solids) / weights.sum())
        assert surface.evaluate(x) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_a_sphere_is_one_patch_and_exact() -> None:
    surface = PatchImplicitSurface.from_contacts(touched_sphere(0.05, 0.03), **NOISELESS)
    assert patch_count(surface) == 1
    directions = random_directions(500, np.random.default_rng(3))
    # Left over is the pull towards flat: 1 part in (noise floor / prior)^2, and third-order
    # allowances beside it, some 1e-3 of the sagitta (30 mm)^2 / (8 * 50 mm) = 2 mm.
    assert np.abs(surface.evaluate(0.05 * directions)).max() < 1e-4
    assert (surface.evaluate(0.0495 * directions) < 0).all()


@pytest.mark.by_default("0")
@pytest.mark.parametrize("seed", range(4))
def test_a_box_has_exact_edges_and_corners(seed: int) -> None:
    # Opposite faces may be one patch: a quadric describes two parallel planes.
    half = np.array([0.06, 0.045, 0.08])
    surface = PatchImplicitSurface.from_contacts(touched_box(half, 0.04, seed), **NOISELESS)
    assert 3 <= patch_count(surface) <= 6
    queries = np.random.default_rng(seed).uniform(-1.15, 1.15, (4000, 3)) * half
    distance = (np.abs(queries) - half).max(axis=1)
    near = np.abs(distance) > 1e-9
    assert (np.sign(surface.evaluate(queries)) == np.sign(distance))[near].mean() > 0.995
    along = np.linspace(-1, 1, 101)[:, None]
    for axis in range(3):
        a, b = np.eye(3)[np.arange(3) != axis] * half
        edge = along * np.eye(3)[axis] * half + a + b
        assert np.median(np.abs(surface.evaluate(edge))) < 1e-6


@pytest.mark.by_default("1")
@pytest.mark.parametrize("seed", range(4))
def test_a_cylinder_is_three_patches_with_a_sharp_rim(seed: int) -> None:
    surface = PatchImplicitSurface.from_contacts(touched_cylinder(0.05, 0.06, 0.035, seed))
    assert patch_count(surface) == 3
    angle = np.linspace(0, 2 * np.pi, 200)
    rim = np.column_stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), np.full(200, 0.06)])
    # Chords of 35 mm on a radius of 50 mm are 3 mm deep: planes are off by as much.
    assert np.sqrt(np.mean(surface.evaluate(rim) ** 2)) < 5e-4


def test_a_concave_edge_is_a_union_of_terms() -> None:
    # Floor z = 0 for x > 0, wall x = 0 for z > 0: the solid fills all else.
    rng = np.random.default_rng(0)
    floor = np.column_stack(
        [rng.uniform(0.01, 0.1, 300), rng.uniform(-0.05, 0.05, 300), np.zeros(300)]
    )
    wall = floor[:, [2, 1, 0]]
    normals = np.vstack([np.tile([0.0, 0.0, 1.0], (300, 1)), np.tile([1.0, 0.0, 0.0], (300, 1))])
    surface = PatchImplicitSurface.from_contacts(
        scattered_touches(np.vstack([floor, wall]), normals, 0.03, 0)
    )
    assert patch_count(surface) == 2
    queries = rng.uniform([-0.02, -0.05, -0.02], [0.05, 0.05, 0.05], (500, 3))
    np.testing.assert_allclose(
        surface.evaluate(queries), np.minimum(queries[:, 0], queries[:, 2]), atol=1e-6
    )


def test_six_contacts_on_the_axes_are_a_sphere_and_more_make_a_cube() -> None:
    # One sphere explains six contacts as well as six planes, and is simpler.
    axes = np.vstack([np.eye(3), -np.eye(3)])
    directions = random_directions(500, np.random.default_rng(0))
    ball = PatchImplicitSurface.from_contacts(Contacts(0.05 * axes, axes), **NOISELESS)
    assert np.abs(ball.evaluate(0.05 * directions)).max() < 1e-5
    cube = PatchImplicitSurface.from_contacts(touched_box(np.full(3, 0.05), 0.04), **NOISELESS)
    queries = np.random.default_rng(0).uniform(-0.07, 0.07, (2000, 3))
    distance = np.abs(queries).max(axis=1) - 0.05
    assert (np.sign(cube.evaluate(queries)) == np.sign(distance)).mean() > 0.995


def test_a_thin_plate_keeps_both_sides() -> None:
    surface = PatchImplicitSurface.from_contacts(touched_box(np.array([0.08, 0.06, 0.004]), 0.03))
    inside = np.random.default_rng(0).uniform(-1, 1, (300, 3)) * [0.06, 0.045, 0.003]
    above = np.array([0.0, 0.0, 0.012])
    assert (surface.evaluate(inside) < 0).all()
    assert (surface.evaluate(inside + above) > 0).all()
    assert (surface.evaluate(inside - above) > 0).all()


def test_contacts_on_an_arc_are_one_patch_up_to_a_sharp_bend() -> None:
    for bend, expected in ((40.0, 1), (90.0, 2)):
        angle = np.deg2rad(bend)
        normals = np.array([[0.0, 0.0, 1.0], [np.sin(angle), 0.0, np.cos(angle)]])
        points = 0.05 * normals  # equally deep below each other: nothing but the bend tells
        pairs = ContactPairs.within(points, normals, 1.0)
        assert cluster_pairs(pairs, np.zeros(2), np.zeros(2)).max() + 1 == expected


def test_contacts_placed_symmetrically_about_edges_make_a_cube() -> None:
    # All contacts are equally far from the edges, as on arcs across them.
    faces = np.vstack([np.eye(3), -np.eye(3)])
    across = np.roll(faces, 1, axis=1), np.roll(faces, 2, axis=1)
    corners = [0.6 * (a * across[0] + b * across[1]) for a in (-1, 1) for b in (-1, 1)]
    points = 0.03 * np.vstack([faces + corner for corner in corners])
    surface = PatchImplicitSurface.from_contacts(Contacts(points, np.tile(faces, (4, 1))))
    queries = np.random.default_rng(0).uniform(-0.04, 0.04, (500, 3))
    np.testing.assert_allclose(
        surface.evaluate(queries), np.abs(queries).max(axis=1) - 0.03, atol=1e-6
    )


@pytest.mark.parametrize("seed", range(3))
def test_noisy_sides_of_a_prism_meet_in_edges(seed: int) -> None:
    # A bend through few touches explains their noise nearly as well as the sides do.
    rng, apothem, half = np.random.default_rng(seed), 0.04, np.pi / 7
    angles = np.repeat(2.0 * half * np.arange(7), 5)
    normals = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    along = np.column_stack([-np.sin(angles), np.cos(angles), 0.0 * angles])
    points = apothem * normals + rng.uniform(-0.014, 0.014, (35, 1)) * along
    points += rng.uniform(-0.03, 0.03, (35, 1)) * np.eye(3)[2]
    points += rng.normal(0.0, 0.0005, (35, 1)) * normals
    turned = normals + rng.normal(0.0, np.deg2rad(3.0), (35, 3))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    surface = PatchImplicitSurface.from_contacts(
        Contacts(points, turned), position_noise=0.0005, normal_noise=float(np.deg2rad(3.0))
    )
    assert patch_count(surface) == 7
    edges = half * (2.0 * np.arange(7) + 1.0)
    places = np.column_stack([np.cos(edges), np.sin(edges), 0.0 * edges]) * apothem / np.cos(half)
    # A cylinder through the middles of the sides is 4.4 mm inside of the edges. A plane of five
    # normals is turned by 1.3 degrees, 0.5 mm at an edge 20 mm away; three of these is the limit.
    assert np.abs(surface.evaluate(places)).max() < 0.0015


def test_patches_are_numbered_by_their_first_contact() -> None:
    contacts = touched_box(np.array([0.06, 0.045, 0.08]), 0.04)
    patches = PatchImplicitSurface.from_contacts(contacts).patch_of
    _, first = np.unique(patches, return_index=True)
    assert (np.diff(first) > 0).all()


def test_a_handle_does_not_cut_the_head_it_stands_on() -> None:
    # A slab |z| < 20 mm with a round handle on top: the handle's cylinder, prolonged, must not cut
    # the slab's rim, which lies within reach and is below all of the handle's tangent planes.
    slab = touched_box(np.array([0.07, 0.04, 0.02]), 0.025, seed=3)
    under = (slab.normals[:, 2] > 0.5) & (np.hypot(*slab.points[:, :2].T) < 0.022)
    handle = touched_cylinder(0.018, 0.04, 0.018, seed=3)
    handle = handle.subset(handle.normals[:, 2] > -0.5)
    handle = Contacts(handle.points + np.array([0.0, 0.0, 0.06]), handle.normals)
    surface = PatchImplicitSurface.from_contacts(slab.subset(~under).append(handle))
    in_slab = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [0.066, 0.036, 0.016]
    assert (surface.evaluate(in_slab) < 0).mean() > 0.99
    assert surface.evaluate([0.0, 0.0, 0.06]) < 0
    assert surface.evaluate([0.05, 0.0, 0.06]) > 0


def test_contacts_on_the_very_edge_leave_it_where_it_is() -> None:
    # A tip that meets an edge reports the normal of either side.
    half = np.array([0.06, 0.045, 0.08])
    along = np.linspace(-0.05, 0.05, 4)
    on_edge = np.column_stack([np.full(4, half[0]), np.full(4, half[1]), along])
    sides = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] * 2)
    contacts = touched_box(half, 0.04).append(Contacts(on_edge, sides))
    surface = PatchImplicitSurface.from_contacts(contacts)
    edge = np.column_stack([np.tile(half[:2], (50, 1)), np.linspace(-0.07, 0.07, 50)])
    np.testing.assert_allclose(surface.evaluate(edge), 0.0, atol=1e-6)
    # Beyond the edge, level with one side, is outside.
    beyond = edge + [0.0, 0.01, 0.0]
    assert surface.evaluate(beyond).min() > 0.005
    assert surface.evaluate(edge + [0.01, 0.0, 0.0]).min() > 0.005


@pytest.mark.parametrize("seed", range(3))
def test_given_noise_is_averaged_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = 0.03 * (np.arange(8) - 3.5)
    across = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    points = np.column_stack([across + rng.uniform(-0.004, 0.004, (64, 2)), np.zeros(64)])
    points[:, 2] = 0.003 * rng.normal(size=64)
    normals = np.column_stack([0.05 * rng.normal(size=(64, 2)), np.ones(64)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = PatchImplicitSurface.from_contacts(
        Contacts(points, normals), position_noise=0.003, normal_noise=0.05
    )
    plane = np.column_stack([rng.uniform(-0.09, 0.09, (400, 2)), np.zeros(400)])
    # A fit to a dozen neighbours should leave 3 mm / sqrt(12) = 0.9 mm, and does not at the rim.
    assert np.sqrt(np.mean(surface.evaluate(plane) ** 2)) < 0.5 * 0.003


@pytest.mark.by_default("box", "cylinder")
@pytest.mark.parametrize("name", ["box", "cylinder", "half_cylinder", "pentagon"])
def test_edges_are_found_better_than_by_planes(name: str) -> None:
    shape = shapes.build(name, 0.2)
    mesh = shape.mesh
    midpoints = shape.edges.mean(axis=1)
    clear = (
        np.linalg.norm(mesh.triangles_center[:, None] - midpoints[None], axis=2).min(axis=1) > 0.006
    )
    contacts = scattered_touches(
        mesh.triangles_center[clear], mesh.face_normals[clear], 0.045, seed=1
    )
    errors = [
        np.sqrt(np.mean(estimate.from_contacts(contacts).evaluate(midpoints) ** 2))
        for estimate in (PatchImplicitSurface, LocalImplicitSurface)
    ]
    assert errors[0] < 0.5 * errors[1]


def test_uncertainty_of_a_lone_contact_is_the_sensor_s() -> None:
    contact = Contacts(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))
    surface = PatchImplicitSurface.from_contacts(contact, position_noise=0.001, normal_noise=0.0)
    # The prior of the trend, 30 spacings, adds a little.
    assert surface.uncertainty(np.zeros(3)) == pytest.approx(0.001, rel=1e-6)


def test_uncertainty_is_below_the_sensor_s_among_neighbours_and_grows_away_from_them() -> None:
    contacts = touched_sphere(0.05, 0.03)
    surface = PatchImplicitSurface.from_contacts(contacts, position_noise=0.001)
    at_contacts = surface.uncertainty(contacts.points)
    # All contacts are on one quadric of ten coefficients: no better than the mean of all, and no
    # worse than the sensor.
    assert (at_contacts < 0.001).all()
    assert (at_contacts > 0.001 / np.sqrt(len(contacts))).all()
    away = np.linspace(1.0, 3.0, 30)[:, None] * contacts.points[0]
    assert (np.diff(surface.uncertainty(away)) > 0).all()


@pytest.mark.slow
def test_the_estimate_of_a_noisy_plane_scatters_by_its_uncertainty() -> None:
    # Repeated estimates of a plane with known noise: the spread of the height at one place is the
    # stated uncertainty. The prior adds a little to it.
    grid = np.stack(np.meshgrid(*2 * [0.03 * np.arange(-3, 4)]), axis=-1).reshape(-1, 2)
    place, heights, predicted = np.array([[0.012, 0.008, 0.0]]), [], []
    rng = np.random.default_rng(5)
    for _ in range(40):
        points = np.column_stack([grid, 0.001 * rng.normal(size=len(grid))])
        normals = np.column_stack([0.05 * rng.normal(size=grid.shape), np.ones(len(grid))])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        surface = PatchImplicitSurface.from_contacts(
            Contacts(points, normals), position_noise=0.001, normal_noise=0.05
        )
        heights.append(surface.evaluate(place)[0])
        predicted.append(surface.uncertainty(place)[0])
    # The spread of 40 draws is known to 1 / sqrt(80) = 11 %.
    assert 0.7 < np.mean(predicted) / np.std(heights) < 1.4


def test_value_and_gradient_at_once_equal_the_separate_ones() -> None:
    surface = PatchImplicitSurface.from_contacts(touched_box(np.array([0.06, 0.045, 0.08]), 0.04))
    queries = np.random.default_rng(1).uniform(-0.09, 0.09, (700, 3))
    values, gradients = surface.value_and_gradient(queries)
    np.testing.assert_array_equal(values, surface.evaluate(queries))
    np.testing.assert_array_equal(gradients, surface.gradient(queries))


def contradicting_touches(places: int, each: int) -> Contacts:
    """Touches of `places`**3 places on a grid, `each` of a place, of any normal."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(*[0.025 * np.arange(places)] * 3), axis=-1).reshape(-1, 3)
    normals = random_directions(each * len(grid), rng)
    return Contacts(np.repeat(grid, each, axis=0), normals, judged=True)


@pytest.mark.slow
@pytest.mark.parametrize(("places", "each"), [(4, 4), (6, 1)])
def test_contacts_that_contradict_each_other_have_finite_values(places: int, each: int) -> None:
    contacts = contradicting_touches(places, each)
    surface = PatchImplicitSurface.from_contacts(contacts)
    assert np.isfinite(surface.evaluate(contacts.points)).all()


def test_expressions_of_many_terms_are_their_literal_minima_of_maxima() -> None:
    surface = PatchImplicitSurface.from_contacts(contradicting_touches(2, 12))
    assert np.mean([len(expression) for expression in surface.expressions]) > 5
    queries = np.random.default_rng(1).uniform(-0.02, 0.05, (30, 3))
    evaluated = [patch.value(queries) for patch in surface.patches]
    near, weights = surface.mean.weights(queries)
    expected = np.zeros(len(queries))
    for node, weight in zip(near, weights, strict=True):
        expression = surface.expressions[surface.expression_of[node]]
        terms = [np.max([evaluated[p] for p in term], axis=0) for term in expression]
        expected += weight * np.min(terms, axis=0)
    np.testing.assert_allclose(surface.evaluate(queries), expected, rtol=1e-9, atol=1e-12)
