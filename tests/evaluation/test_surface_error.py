"""Errors between surfaces whose distance has a formula."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import (
    SurfaceError,
    sample_mesh,
    sample_segments,
    surface_error,
)
from lis_grasp.exceptions import EstimationError, InvalidContactsError, InvalidOptionError
from lis_grasp.shapes import Shape
from lis_grasp.shapes.mesh_distance import distances_to_mesh

EVERYWHERE = 10.0
AXES = np.vstack([np.eye(3), -np.eye(3)])


def cube(side: float, center: npt.ArrayLike = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return trimesh.creation.box([side] * 3).apply_translation(center)


def ball(radius: float) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=5, radius=radius)


def touches(points: npt.ArrayLike, normals: npt.ArrayLike | None = None) -> Contacts:
    return Contacts(points, points if normals is None else normals)


@pytest.fixture
def truth() -> Shape:
    """A cube with a side of 20 cm."""
    return Shape.from_mesh(cube(0.2), "cube")


ON_CUBE = Contacts(0.1 * AXES, AXES)


def test_the_truth_has_no_error(truth: Shape) -> None:
    error = surface_error(truth.mesh, truth, ON_CUBE, explored_radius=EVERYWHERE)
    assert error.rmsd == pytest.approx(0.0, abs=1e-12)
    assert error.rmsd_truth_to_estimate == pytest.approx(0.0, abs=1e-12)
    assert error.edge_rmsd == pytest.approx(0.0, abs=1e-12)
    assert error.hausdorff_95 == pytest.approx(0.0, abs=1e-12)
    assert error.chamfer == pytest.approx(0.0, abs=1e-12)
    assert error.f_score_1mm == error.f_score_2mm == error.f_score_5mm == 1.0
    assert error.iou == pytest.approx(1.0, rel=1e-9)
    assert error.coverage == 1.0
    assert error.normal_error == pytest.approx(0.0, abs=1e-7)  # arccos near 1


def test_the_error_of_concentric_spheres_is_the_difference_of_radii() -> None:
    sphere = Shape.from_mesh(ball(0.1), "sphere")
    error = surface_error(ball(0.104), sphere, touches(AXES * 0.1, AXES), explored_radius=1.0)
    # The icosphere's triangles lie up to 0.1 (1 - cos 1.1 deg) = 18 um inside of the sphere, the
    # same part of both radii.
    for value in (error.rmsd, error.rmsd_truth_to_estimate, error.hausdorff_95):
        assert value == pytest.approx(0.004, abs=2e-5)
    assert error.edge_rmsd is None
    # Alike, but for neighbours of the nearest triangle: less than two triangles' angle, 4 deg.
    assert error.normal_error < np.deg2rad(4.0)


def test_a_shifted_cube_overlaps_by_its_shift(truth: Shape) -> None:
    error = surface_error(cube(0.2, (0.02, 0.0, 0.0)), truth, ON_CUBE, explored_radius=EVERYWHERE)
    # 18 of 20 cm are shared, 22 of them filled by either.
    assert error.iou == pytest.approx(18.0 / 22.0, rel=1e-9)


def test_an_open_estimate_has_no_volume_to_compare(truth: Shape) -> None:
    open_cube = trimesh.Trimesh(truth.mesh.vertices, truth.mesh.faces[1:], process=False)
    assert surface_error(open_cube, truth, ON_CUBE, explored_radius=EVERYWHERE).iou is None


def test_chamfer_and_f_scores_of_parallel_planes_follow_from_the_gaps(truth: Shape) -> None:
    # The upper face is 4 mm too high, the lower one right; each was touched in the middle.
    estimate = trimesh.creation.box(bounds=[[-0.1, -0.1, -0.1], [0.1, 0.1, 0.104]])
    z = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    error = surface_error(estimate, truth, touches(0.1 * z, z), explored_radius=0.05)
    # From the estimate, the upper disc within 5 cm of the contact 4 mm below it is a little
    # smaller, 50^2 - 4^2 of 50^2; the truth's discs are equal.
    upper = 50.0**2 - 4.0**2
    precision, recall = 50.0**2 / (50.0**2 + upper), 0.5
    few = 2.0 * precision * recall / (precision + recall)
    # Samples on the discs: 10 000 over the whole surface, 330 on a disc, good to its rim, 4 %.
    assert error.f_score_1mm == error.f_score_2mm == pytest.approx(few, rel=0.04)
    assert error.f_score_5mm == 1.0
    assert error.chamfer == pytest.approx(0.5 * 0.004 * (1.0 - precision + recall), rel=0.04)


def test_a_cube_made_smaller_is_off_by_half_the_difference(truth: Shape) -> None:
    error = surface_error(cube(0.18), truth, ON_CUBE, explored_radius=EVERYWHERE)
    d = 0.01
    assert error.rmsd == pytest.approx(d, rel=1e-9)  # from inside, the nearest face is d away
    # A point of an edge of the cube is d away along two axes; corners, d along the third for the
    # last centimetre at either end: mean of 2 d^2 + max(0, |x| - 9 cm)^2 over |x| < 10 cm.
    assert error.edge_rmsd == pytest.approx(np.sqrt(2.0 * d**2 + d**3 / (3.0 * 0.1)), rel=1e-4)
    # Faces: d along the normal, and the same mean for each of the other two axes.
    assert error.rmsd_truth_to_estimate == pytest.approx(
        np.sqrt(d**2 + 2.0 * d**3 / (3.0 * 0.1)), rel=2e-3
    )


def test_only_the_explored_part_counts(truth: Shape) -> None:
    # The estimate is right on top and 1 cm too deep below; only the top was touched.
    estimate = trimesh.creation.box(bounds=[[-0.1, -0.1, -0.11], [0.1, 0.1, 0.1]])
    on_top = touches([[0.0, 0.0, 0.1]], [[0.0, 0.0, 1.0]])
    error = surface_error(estimate, truth, on_top, explored_radius=0.05)
    assert error.rmsd == pytest.approx(0.0, abs=1e-9)
    assert error.edge_rmsd is None  # the edges are 10 cm away
    assert error.coverage == pytest.approx(np.pi * 0.05**2 / (6 * 0.2**2), rel=0.01)
    below = touches([[0.0, 0.0, -0.1]], [[0.0, 0.0, -1.0]])
    error = surface_error(estimate, truth, below, explored_radius=0.05)
    assert error.rmsd == pytest.approx(0.01, rel=1e-9)
    assert error.rmsd_truth_to_estimate == pytest.approx(0.01, rel=1e-9)
    assert error.hausdorff_95 == pytest.approx(0.01, rel=1e-9)


def test_edges_count_where_they_were_explored(truth: Shape) -> None:
    estimate = trimesh.creation.box(bounds=[[-0.1, -0.1, -0.1], [0.1, 0.1, 0.11]])
    near_top_edge = touches([[0.1, 0.0, 0.09]], [[1.0, 0.0, 0.0]])
    error = surface_error(estimate, truth, near_top_edge, explored_radius=0.05)
    # The true top edge lies on the estimate's side face.
    assert error.edge_rmsd == pytest.approx(0.0, abs=1e-9)
    lower = trimesh.creation.box(bounds=[[-0.1, -0.1, -0.1], [0.1, 0.1, 0.09]])
    error = surface_error(lower, truth, near_top_edge, explored_radius=0.05)
    assert error.edge_rmsd == pytest.approx(0.01, rel=1e-9)


def test_a_chamfer_raises_the_edge_error_most(truth: Shape) -> None:
    chamfer = truth.mesh.slice_plane([0.095, 0.0, 0.095], [-1.0, 0.0, -1.0], cap=True)
    contact = touches([[0.1, 0.0, 0.06]], [[1.0, 0.0, 0.0]])
    error = surface_error(chamfer, truth, contact, explored_radius=0.05)
    # The corner of a right-angled chamfer with legs of 1 cm: 1 cm / sqrt 2 off.
    assert error.edge_rmsd == pytest.approx(0.01 / np.sqrt(2.0), rel=1e-9)
    assert error.rmsd < 0.3 * error.edge_rmsd


def test_turning_everything_changes_nothing(truth: Shape) -> None:
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
    X[:3, 3] = [0.3, 0.1, -0.2]
    estimate = ball(0.11)
    contacts = ON_CUBE.subset([0, 1])
    moved = Contacts(contacts.points @ X[:3, :3].T + X[:3, 3], contacts.normals @ X[:3, :3].T)
    there = Shape("cube", truth.mesh.copy().apply_transform(X), _turned(truth.edges, X))
    first = surface_error(estimate, truth, contacts, explored_radius=0.12)
    second = surface_error(estimate.copy().apply_transform(X), there, moved, explored_radius=0.12)
    for field in dataclasses.fields(SurfaceError):
        # A sample on the brink of the explored part may fall to the other side by rounding.
        assert getattr(second, field.name) == pytest.approx(getattr(first, field.name), rel=1e-3)


def _turned(segments: npt.NDArray, X: npt.NDArray) -> npt.NDArray:
    return segments @ X[:3, :3].T + X[:3, 3]


def test_contacts_of_another_frame_are_refused(truth: Shape) -> None:
    far = touches([[5.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    with pytest.raises(InvalidContactsError) as error:
        surface_error(truth.mesh, truth, far, explored_radius=0.05)
    assert error.value.field == "points"
    with pytest.raises(InvalidContactsError):
        surface_error(truth.mesh, truth, Contacts.empty(), explored_radius=0.05)


def test_an_estimate_of_something_else_is_refused(truth: Shape) -> None:
    with pytest.raises(EstimationError):
        surface_error(cube(0.2, [5.0, 0.0, 0.0]), truth, ON_CUBE, explored_radius=0.05)


@pytest.mark.parametrize(
    ("option", "value"),
    [("samples", 0), *(("explored_radius", r) for r in (0.0, -1.0, np.nan, np.inf))],
)
def test_an_option_out_of_its_range_is_refused(truth: Shape, option: str, value: float) -> None:
    with pytest.raises(InvalidOptionError) as error:
        surface_error(truth.mesh, truth, ON_CUBE, **{"explored_radius": 1.0, option: value})
    assert error.value.option == option


def test_without_contacts_the_whole_surfaces_are_compared(truth: Shape) -> None:
    estimate = cube(0.2, (0.02, 0.0, 0.0))
    whole = surface_error(estimate, truth)
    explored = surface_error(estimate, truth, ON_CUBE, explored_radius=EVERYWHERE)
    assert whole.explored_radius is None
    assert dataclasses.replace(whole, explored_radius=EVERYWHERE) == explored


def test_a_mesh_can_be_the_truth(truth: Shape) -> None:
    estimate = cube(0.18)
    assert surface_error(estimate, truth.mesh) == surface_error(estimate, truth)


def test_contacts_and_their_radius_are_given_together(truth: Shape) -> None:
    with pytest.raises(InvalidOptionError):
        surface_error(truth.mesh, truth, ON_CUBE)
    with pytest.raises(InvalidOptionError):
        surface_error(truth.mesh, truth, explored_radius=0.05)


def _brute_force(points: npt.NDArray, mesh: trimesh.Trimesh) -> npt.NDArray:
    """Least distance to any triangle, by the region that it is seen from (Ericson 2005, 5.1.5)."""
    distances = []
    for point in points:
        repeated = np.broadcast_to(point, (len(mesh.faces), 3))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            nearest = trimesh.triangles.closest_point(mesh.triangles, repeated)
        distances.append(np.linalg.norm(nearest - point, axis=1).min())
    return np.array(distances)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(subdivisions=3, radius=0.1),
        trimesh.creation.box([0.2, 0.1, 0.01]),
        trimesh.creation.cylinder(0.06, 0.2, sections=48),  # slivers
        trimesh.creation.torus(0.07, 0.03),
    ],
    ids=["sphere", "plate", "cylinder", "torus"],
)
def test_distances_equal_brute_force_over_all_triangles(mesh: trimesh.Trimesh) -> None:
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (200, 3))
    points[:20] *= 0.01  # near the middle, where many triangles are about as far
    points[20:40] += 1.0
    distances, faces = distances_to_mesh(points, mesh)
    np.testing.assert_allclose(distances, _brute_force(points, mesh), atol=1e-9)
    single = [trimesh.Trimesh(mesh.vertices, mesh.faces[[f]], process=False) for f in faces[:20]]
    own = [_brute_force(p[None], m)[0] for p, m in zip(points, single, strict=False)]
    np.testing.assert_allclose(distances[:20], own, atol=1e-9)


def test_slivers_of_a_closed_mesh_do_not_change_its_distances() -> None:
    rng = np.random.default_rng(0)
    vertices, faces = list(cube(0.1).vertices), list(cube(0.1).faces)
    for _ in range(200):  # cut triangles at points beside an edge, down to no area at all
        a, b, c = faces.pop(rng.integers(len(faces)))
        along, beside = rng.uniform(0.1, 0.9), 10.0 ** rng.uniform(-18, -4)
        on_edge = vertices[a] + along * (vertices[b] - vertices[a])
        n = len(vertices)
        vertices.append((1.0 - beside) * on_edge + beside * vertices[c])
        faces += [np.array(face) for face in ([a, b, n], [b, c, n], [c, a, n])]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.area_faces.min() < 1e-18
    points = rng.uniform(-0.12, 0.12, (5000, 3))
    outside = np.abs(points) - 0.05
    beyond = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
    expected = np.where(beyond > 0.0, beyond, -outside.max(axis=1))
    np.testing.assert_allclose(distances_to_mesh(points, mesh)[0], expected, atol=1e-15)


def test_no_points_have_no_distances() -> None:
    distances, faces = distances_to_mesh(np.empty((0, 3)), cube(0.1))
    assert distances.shape == faces.shape == (0,)


def test_samples_spread_by_area() -> None:
    mesh = trimesh.creation.box([0.3, 0.2, 0.1])
    points, faces = sample_mesh(mesh, 6000)
    share = np.bincount(faces, minlength=12) / 6000
    # One sample for each 6000th of the area: a triangle's count is exact to one.
    np.testing.assert_allclose(share, mesh.area_faces / mesh.area, atol=1.0 / 6000)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-3)
    # Second moments of a shell: a face of area A at x = a has A a^2, one across x A a^2 / 3.
    area = 2.0 * np.array([0.2 * 0.1, 0.3 * 0.1, 0.3 * 0.2])
    half = np.array([0.15, 0.1, 0.05])
    moments = half**2 * (area + (area.sum() - area) / 3.0) / area.sum()
    np.testing.assert_allclose((points**2).mean(axis=0), moments, rtol=5e-3)


def test_samples_spread_by_length() -> None:
    segments = np.array([[[0, 0, 0], [3, 0, 0]], [[5, 5, 5], [5, 5, 5]], [[0, 0, 1], [0, 1, 1]]])
    points = sample_segments(segments.astype(float), 8)
    np.testing.assert_allclose(points[:6, 0], np.arange(0.25, 3.0, 0.5))
    np.testing.assert_allclose(points[6:], [[0, 0.25, 1], [0, 0.75, 1]])
