"""Measured extents: closed forms of a cube, a ball and a cavity, and the laws of free space."""

import numpy as np
import pytest
import trimesh
from analytic_surfaces import Analytic, Ball, cube_bounds, differences
from numpy.testing import assert_allclose
from random_directions import random_directions

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import TactileSensor
from lis_grasp.geometry import rotate, unit
from lis_grasp.meshing import extract_mesh
from lis_grasp.stages.estimate import Perception, SurfaceEstimate
from lis_grasp.surfaces.carved_implicit_surface import without
from lis_grasp.surfaces.measured_extents import BeyondExtents, measured_extents
from lis_grasp.typing import FloatArray

HALF = 0.03  # half the edge of the cube [m]
AXES = np.vstack([np.eye(3), -np.eye(3)])

# A cube's faces, each a plane that goes on for ever: an estimate without edges or corners.
SLABS = Analytic(
    lambda p: np.sort(np.abs(p), axis=-1)[..., 1] - HALF,  # three bars: they end at no face
    cube_bounds(0.08),
)


def on_cube(places: int = 2) -> Contacts:
    """Exact contacts on a grid of each face of the cube."""
    ticks = np.linspace(-0.6 * HALF, 0.6 * HALF, places)
    a, b = (grid.ravel() for grid in np.meshgrid(ticks, ticks))
    points, normals = [], []
    for k in range(3):
        for sign in (1.0, -1.0):
            face = np.insert(np.column_stack([a, b]), k, sign * HALF, axis=1)
            points.append(face)
            normals.append(np.tile(sign * np.eye(3)[k], (len(face), 1)))
    return Contacts(np.vstack(points), np.vstack(normals))


def extents_of(contacts: Contacts, surface: object, *noise: float) -> BeyondExtents:
    (extents,) = measured_extents(surface, contacts, *noise)  # type: ignore[arg-type]
    return extents


def cube_field(points: FloatArray) -> FloatArray:
    return np.abs(points).max(axis=-1) - HALF


CUBE = Analytic(cube_field, cube_bounds(0.08))


def test_exact_contacts_of_a_cube_bound_exactly_the_cube() -> None:
    extents = extents_of(on_cube(), CUBE)
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (2000, 3))
    depths, slopes = extents.depths(points)
    assert_allclose(depths, cube_field(points), atol=1e-9)
    chosen = np.abs(points).argmax(axis=1)
    expected = np.sign(points[np.arange(2000), chosen])[:, None] * np.eye(3)[chosen]
    assert_allclose(slopes, expected, atol=1e-9)


def test_surface_beyond_the_faces_is_cut_at_them() -> None:
    cut = without(SLABS, *measured_extents(CUBE, on_cube()))
    mesh = extract_mesh(cut, bounds=cube_bounds(0.06))
    assert mesh.is_watertight
    assert np.abs(mesh.vertices).max() == pytest.approx(HALF, abs=1e-6)


def test_noise_lets_the_surface_pass_by_two_standard_deviations() -> None:
    position, normal = 0.0005, 0.06
    extents = extents_of(Contacts(HALF * AXES, AXES), CUBE, position, normal)
    lever = 0.02
    beyond = np.array([[HALF, lever, 0.0]])
    deviation = np.hypot(position, 0.5 * normal * lever)  # an estimate halves the noise of normals
    assert_allclose(extents.depths(beyond)[0], -2.0 * deviation, rtol=1e-9)


def test_the_slope_is_that_of_the_depth() -> None:
    extents = extents_of(Contacts(HALF * AXES, AXES), CUBE, 0.0005, 0.06)
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (500, 3))
    depth = Analytic(
        lambda p: extents.depths(p.reshape(-1, 3))[0].reshape(p.shape[:-1]), CUBE.bounds
    )
    numeric = differences(depth, points, 1e-7)
    smooth = np.abs(np.sort(np.abs(points), axis=1)[:, 1] - np.abs(points).max(axis=1)) > 3e-3
    assert smooth.sum() > 300
    assert_allclose(extents.depths(points)[1][smooth], numeric[smooth], atol=1e-5)


def test_a_plane_in_a_cavity_holds_half_the_way_to_the_contact_in_front() -> None:
    """Of two inner walls of a U, one is in front of the other's plane."""
    floor, opposite = np.array([-0.02, 0.0, 0.02]), np.array([0.02, 0.0, 0.02])
    contacts = Contacts([floor, opposite], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    gap = Analytic(lambda p: 0.02 - np.abs(p[..., 0]), CUBE.bounds)
    extents = extents_of(contacts, gap, 0.0005, 0.05)
    assert_allclose(extents.reaches, 0.5 * 0.04)
    before_half, behind_half = floor + [[0.019, 0.0, 0.0]], floor + [[0.0, 0.025, 0.0]]
    assert extents.depths(before_half)[0] > 0.0
    assert extents.depths(behind_half)[0] < 0.0


def test_a_ball_is_inside_its_tangent_planes() -> None:
    directions = random_directions(60, np.random.default_rng(2))
    contacts = Contacts(0.04 * directions, directions)
    extents = extents_of(contacts, Ball(0.04))
    assert (extents.reaches > 1.0).all()
    on_ball = 0.04 * random_directions(3000, np.random.default_rng(3))
    assert extents.depths(on_ball)[0].max() <= 1e-9


def test_extents_turn_with_the_contacts() -> None:
    rng = np.random.default_rng(4)
    X = np.eye(4)
    X[:3, :3] = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    X[:3, 3] = [0.3, -0.2, 0.5]
    contacts = on_cube()
    turned = Contacts(contacts.points @ X[:3, :3].T + X[:3, 3], rotate(X, contacts.normals))
    back = lambda p: (p - X[:3, 3]) @ X[:3, :3]  # noqa: E731
    field = Analytic(lambda p: cube_field(back(p)), CUBE.bounds)
    points = rng.uniform(-0.06, 0.06, (200, 3))
    before = extents_of(contacts, CUBE, 0.0005, 0.05).depths(points)[0]
    after = extents_of(turned, field, 0.0005, 0.05).depths(points @ X[:3, :3].T + X[:3, 3])[0]
    assert_allclose(after, before, atol=1e-7)


def test_unknown_noise_is_the_departure_from_the_estimate() -> None:
    rng = np.random.default_rng(5)
    contacts = on_cube(5)
    noisy = Contacts(
        contacts.points + 0.001 * rng.normal(size=(150, 1)) * contacts.normals,
        unit(contacts.normals + 0.05 * rng.normal(size=(150, 3))),
    )
    extents = extents_of(noisy, CUBE)
    # A median of 150 errors is within four standard errors, 4 * 0.79 / sqrt(150), of its own.
    assert extents.position_deviations[0] == pytest.approx(0.001, rel=0.26)
    assert extents.normal_deviations[0] == pytest.approx(0.5 * 0.05, rel=0.26)


def test_an_estimate_without_slopes_has_no_extents() -> None:
    flat = Analytic(lambda p: 0.0 * p[..., 0], CUBE.bounds)
    assert measured_extents(flat, on_cube()) == ()


def test_a_contact_that_the_estimate_contradicts_has_no_plane() -> None:
    """Of a half-space below z = 0, the top alone agrees with the contacts of a ball."""
    below = Analytic(lambda p: p[..., 2], CUBE.bounds)
    extents = extents_of(Contacts(HALF * AXES, AXES), below, 0.0005, 0.05)
    assert_allclose(extents.points, [[0.0, 0.0, HALF]])


@pytest.mark.by_default("gpis", "blend")
@pytest.mark.parametrize("estimator", ["blend", "gpis", "lis", "smooth"])
def test_an_estimate_ends_where_touches_measured_that_it_does(estimator: str) -> None:
    """Forty noisy touches of a box: no surface is farther out than noise explains."""
    rng, box = np.random.default_rng(6), trimesh.creation.box((0.06, 0.06, 0.06))
    points, faces = trimesh.sample.sample_surface_even(box, 40, seed=7)
    normals = box.face_normals[faces]
    noise = TactileSensor(position_noise=0.0005, normal_noise=0.05)
    contacts = Contacts(
        points + 0.0005 * rng.normal(size=(len(points), 1)) * normals,
        unit(normals + 0.05 * rng.normal(size=normals.shape)),
    )
    estimate = SurfaceEstimate(contacts, Perception(estimator=estimator, sensor=noise))
    # The farthest contact of a face is 2.5 deviations out; two more of it, and of its normal.
    beyond = 4.5 * 0.0005 + 2.0 * 0.025 * np.hypot(0.06, 0.06)
    assert np.abs(estimate.mesh.vertices).max() < 0.03 + beyond
