"""Depth views against closed forms: spheres, boxes, noise of cameras, rigid motions."""

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import NothingSeenError
from lis_grasp.geometry import angle_between, apply_inverse, unit
from lis_grasp.views import (
    DepthCamera,
    DepthNoise,
    DepthView,
    HandEye,
    Intrinsics,
    Views,
    draw_camera_pose,
    look_at,
    segment_object,
    simulate_view,
)
from lis_grasp.views.contour import occluding_contour
from lis_grasp.views.rendering import plane_depth

EXACT = DepthCamera(noise=DepthNoise.none())
BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])
CYLINDER = trimesh.creation.cylinder(0.03, 0.09, sections=96).apply_translation([0.0, 0.0, 0.045])
BALL = trimesh.creation.icosphere(5, 0.035).apply_translation([0.0, 0.0, 0.035])
OBJECTS = {"box": BOX, "cylinder": CYLINDER, "ball": BALL}


def _view(mesh: trimesh.Trimesh, seed: int, camera: DepthCamera = EXACT) -> DepthView:
    rng = np.random.default_rng(seed)
    return simulate_view([mesh], draw_camera_pose([0.0, 0.0, 0.03], rng=rng), camera, rng=rng)


def _sphere_view(radius: float, X_WC: np.ndarray) -> DepthView:
    """Return the exact view of a sphere about the origin, by the closed form of each ray."""
    camera, shape = Intrinsics(385.0, 385.0, 319.5, 239.5), (480, 640)
    rays = camera.rays(shape)
    center = apply_inverse(X_WC, np.zeros(3))
    a, b = np.einsum("hwk,hwk->hw", rays, rays), rays @ center
    root = b**2 - a * (center @ center - radius**2)
    hit = root >= 0.0
    depth = np.where(hit, (b - np.sqrt(np.where(hit, root, 0.0))) / a, np.inf)
    return DepthView(depth, camera, X_WC, hit, DepthNoise.none())


@pytest.mark.parametrize("seed", range(3))
def test_contacts_of_an_exact_sphere_are_on_it(seed: int) -> None:
    X_WC = draw_camera_pose([0.0, 0.0, 0.0], rng=np.random.default_rng(seed))
    contacts = _sphere_view(0.04, X_WC).contacts
    assert len(contacts) > 500
    assert np.abs(np.linalg.norm(contacts.points, axis=1) - 0.04).max() < 1e-4
    angles = np.rad2deg(angle_between(contacts.normals, unit(contacts.points)))
    assert np.median(angles) < 0.25
    # The quadratic of a window departs from a sphere where it is nearly edge-on.
    facing = -np.einsum("nk,nk->n", contacts.normals, unit(contacts.points - X_WC[:3, 3]))
    assert angles[facing > 0.5].max() < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_the_contour_normals_of_a_sphere_are_its_normals(seed: int) -> None:
    X_WC = draw_camera_pose([0.0, 0.0, 0.0], rng=np.random.default_rng(seed))
    contour = occluding_contour(_sphere_view(0.04, X_WC))
    sight = unit(contour.points - X_WC[:3, 3])
    nearest = X_WC[:3, 3] + np.einsum("nk,k->n", sight, -X_WC[:3, 3])[:, None] * sight
    true = unit(nearest)  # where the line of sight is nearest to the centre
    angles = np.rad2deg(angle_between(contour.normals, true))
    assert len(angles) == 40
    assert np.median(angles) < 1.0
    # The border of the mask is known to half a pixel, over some pixels.
    assert angles.max() < 4.0
    # The radius of curvature is a mean over a grid of radii.
    assert np.median(np.abs(np.linalg.norm(contour.turned, axis=1) - 0.04)) < 0.001
    assert contour.turning.min() > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_contacts_of_an_exact_box_are_on_its_faces(seed: int) -> None:
    contacts = _view(BOX, seed).contacts
    outside = np.abs(contacts.points - [0.0, 0.0, 0.025]) - [0.05, 0.03, 0.025]
    assert np.abs(outside.max(axis=1)).max() < 1e-4
    axis = np.argmax(outside, axis=1)
    side = np.sign((contacts.points - [0.0, 0.0, 0.025])[np.arange(len(contacts)), axis])
    angles = np.rad2deg(angle_between(contacts.normals, side[:, None] * np.eye(3)[axis]))
    within = np.sort(outside, axis=1)[:, 1] < -3e-3  # two pixels from an edge
    assert angles[within].max() < 0.5


@pytest.mark.by_default("0.5")
@pytest.mark.parametrize("distance", [0.3, 0.5, 1.0])
def test_the_noise_of_a_plane_grows_with_the_square_of_its_depth(distance: float) -> None:
    noise = DepthNoise(step=0.0, mixed=0.0)
    true = np.full((480, 640), distance)
    errors = []
    for seed in range(5):
        depth = noise.measured(true, 385.0, rng=np.random.default_rng(seed))
        errors.append((noise.focal_baseline / depth - noise.focal_baseline / true).ravel())
    inverse = np.concatenate(errors)
    stated = noise.deviation(distance) * noise.focal_baseline / distance**2
    # The smooth part has 170 independent places an image: 5 of them determine it to 3 %.
    assert np.nanstd(inverse) == pytest.approx(stated, rel=0.05)


def test_the_noise_is_correlated_as_stated() -> None:
    noise = DepthNoise(smooth_disparity=0.0, step=0.0, mixed=0.0)
    depth = noise.measured(np.full((480, 640), 0.5), 385.0, rng=np.random.default_rng(0))
    errors = np.nan_to_num(1.0 / depth - 2.0)
    errors /= errors.std()
    for lag in (1, 2, 3):
        correlation = (errors[:, lag:] * errors[:, :-lag]).mean()
        assert correlation == pytest.approx(np.exp(-(lag**2) / 4.0), abs=0.02)


@pytest.mark.by_default("box")
@pytest.mark.parametrize("name", OBJECTS)
def test_the_stated_noise_covers_the_errors_after_thinning(name: str) -> None:
    """Within 2.2 deviations is 97 % of a Gaussian; edges are no Gaussian."""
    covered = []
    for seed in range(4):
        contacts = Views((_view(OBJECTS[name], seed, DepthCamera()),), 0.0).contacts(300)
        _, distance, _ = trimesh.proximity.closest_point(OBJECTS[name], contacts.points)
        covered.append(distance < 2.2 * contacts.position_noise)
    assert np.mean(covered) >= 0.95


@pytest.mark.by_default("box")
@pytest.mark.parametrize("name", OBJECTS)
def test_no_free_space_is_inside_of_the_object(name: str) -> None:
    mesh = OBJECTS[name]
    inside = trimesh.sample.volume_mesh(mesh, 30_000)
    inside = inside[inside[:, 2] > 0.0]
    for seed in range(3):
        depths, _ = _view(mesh, seed, DepthCamera()).depths(inside)
        assert np.count_nonzero(depths > 0.0) <= 1e-4 * len(inside)


def test_a_rigid_motion_moves_contacts_and_implied_ones() -> None:
    view = _view(CYLINDER, 0, DepthCamera())
    turn = trimesh.transformations.rotation_matrix(0.8, [0.0, 0.0, 1.0], [0.1, 0.2, 0.0])
    moved = DepthView(view.depth, view.intrinsics, turn @ view.X_WC, view.mask)
    for mine, other in (
        (moved.contacts, view.contacts),
        (moved.guesses(0.0), view.guesses(0.0)),
    ):
        expected = other.in_frame(np.linalg.inv(turn))
        assert len(mine) == len(expected) > 0
        assert np.abs(mine.points - expected.points).max() < 1e-9
        assert np.abs(mine.normals - expected.normals).max() < 1e-9


def test_a_mask_that_is_a_pixel_too_large_changes_errors_little() -> None:
    from scipy import ndimage

    view = _view(BOX, 0, DepthCamera())
    wide = view.with_mask(ndimage.binary_dilation(view.object_mask))
    narrow = view.with_mask(ndimage.binary_erosion(view.object_mask))
    errors = [
        np.sqrt(np.mean(trimesh.proximity.closest_point(BOX, v.contacts.points)[1] ** 2))
        for v in (view, wide, narrow)
    ]
    assert errors[1] < 1.1 * errors[0]
    assert errors[2] < 1.1 * errors[0]


def test_a_hole_is_never_free() -> None:
    rng = np.random.default_rng(0)
    X_WC = look_at([0.4, 0.0, 0.3], [0.0, 0.0, 0.02])
    view = simulate_view([BOX], X_WC, rng=rng, is_transparent=True)
    assert np.isnan(view.depth[view.object_mask]).all()
    v, u = np.nonzero(view.object_mask)
    for depth in (0.1, 0.3, 0.5):
        points = X_WC[:3, 3] + depth * view.intrinsics.rays_at(u, v) @ X_WC[:3, :3].T
        assert (view.depths(points)[0] <= 0.0).all()


@pytest.mark.parametrize("name", OBJECTS)
def test_glass_is_unknown_and_never_free(name: str) -> None:
    """It has no contact and implies none; with the camera's noise no point in it is free."""
    mesh = OBJECTS[name]
    rng = np.random.default_rng(1)
    X_WC = draw_camera_pose([0.0, 0.0, 0.03], rng=rng)
    view = simulate_view([mesh], X_WC, DepthCamera(), rng=rng, is_transparent=True)
    views = Views((view,), 0.0)
    assert len(views.contacts(400)) == len(views.guesses(Contacts.empty())) == 0
    inside = trimesh.sample.volume_mesh(mesh, 10_000)
    assert not (views.free.depths(inside[inside[:, 2] > 0.0])[0] > 0.0).any()
    with pytest.raises(NothingSeenError):  # a hole is no object that stands on the table
        segment_object(view, 0.0)
    touches = _touches(mesh, X_WC, 5, 0)
    assert not views.given(touches).is_dropped


def test_a_plane_without_noise_is_at_its_height() -> None:
    X_WC = look_at([0.3, 0.2, 0.45], [0.0, 0.0, 0.0])
    camera = EXACT.intrinsics
    depth = plane_depth(camera, (480, 640), X_WC, 0.01)
    contacts = DepthView(depth, camera, X_WC, np.isfinite(depth), DepthNoise.none()).contacts
    assert np.abs(contacts.points[:, 2] - 0.01).max() < 1e-4
    assert np.rad2deg(np.arccos(contacts.normals[:, 2].clip(-1.0, 1.0))).max() < 0.5


def _touches(
    mesh: trimesh.Trimesh, X_WC: np.ndarray, count: int, seed: int, *, steepest: float = 1.0
) -> Contacts:
    """Return touches of the seen side with 0.5 mm and 3 degrees of noise.

    Vertical parts of normals are below `steepest`.
    """
    rng = np.random.default_rng(seed)
    points, faces = trimesh.sample.sample_surface(mesh, 4000, seed=seed)
    normals = mesh.face_normals[faces]
    seen = np.einsum("nk,nk->n", normals, X_WC[:3, 3] - points) > 0.15
    seen &= (points[:, 2] > 0.0135) & (np.abs(normals[:, 2]) <= steepest)
    chosen = rng.choice(np.flatnonzero(seen), count, replace=False)
    noise = 0.0005 * rng.standard_normal((count, 1))
    tilted = unit(normals[chosen] + np.deg2rad(3.0) * rng.standard_normal((count, 3)))
    return Contacts(
        points[chosen] + noise * normals[chosen],
        tilted,
        position_noise=np.full(count, 0.0005),
    )


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 6])
def test_the_posterior_of_the_pose_covers_the_true_one(count: int) -> None:
    camera = DepthCamera(hand_eye=HandEye(0.002, np.deg2rad(0.5)))
    squares, given, left = [], [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        mesh = list(OBJECTS.values())[seed % 2]
        X_WC = draw_camera_pose([0.0, 0.0, 0.03], rng=rng)
        view = simulate_view([mesh], X_WC, camera, rng=rng)
        touches = _touches(mesh, X_WC, count, seed) if count else Contacts.empty()
        views = Views((view,), 0.0).given(touches)
        assert not views.is_dropped
        center = view.contacts_in_camera.points.mean(axis=0)
        error = _places(views.corrected[0].X_WC, center) - _places(X_WC, center)
        covariance = views.calibrations[0].displacement_covariance(_places(X_WC, center)[None])[0]
        squares.append(error @ np.linalg.solve(covariance + 1e-12 * np.eye(3), error))
        left.append(np.linalg.norm(error))
        given.append(np.linalg.norm(_places(view.X_WC, center) - _places(X_WC, center)))
    # 95 % of chi squared with three degrees of freedom; 12 cases: at least 9 (binomial, 0.2 %).
    assert np.count_nonzero(np.array(squares) < 7.81) >= 9
    assert np.median(left) < np.median(given)


def _places(X_WC: np.ndarray, point: np.ndarray) -> np.ndarray:
    from lis_grasp.geometry import apply_pose

    return apply_pose(X_WC, point)


@pytest.mark.slow
def test_the_correction_depends_on_the_poses_as_given_only() -> None:
    view = _view(BOX, 3, DepthCamera(hand_eye=HandEye(0.002, np.deg2rad(0.5))))
    touches = _touches(BOX, view.X_WC, 5, 0)
    once = Views((view,), 0.0).given(touches)
    twice = Views((view,), 0.0).given(touches[:2]).given(touches)
    assert np.array_equal(once.calibrations[0].X_WC, twice.calibrations[0].X_WC)
    assert once.contacts(100) == twice.contacts(100)


def test_touches_of_curved_surface_beside_the_seen_one_do_not_move_the_camera() -> None:
    """A chord of a circle is across the mean of the normals at its ends, whatever the radius."""
    view = _view(CYLINDER, 0, DepthCamera(noise=DepthNoise.none(), hand_eye=HandEye(0.002, 0.009)))
    true = _view(CYLINDER, 0).X_WC
    away = np.arctan2(*(true[:2, 3][::-1]))
    angles = away + np.deg2rad([-72.0, -66.0, -60.0, 0.0, 60.0, 66.0, 72.0])
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(7)])
    touches = Contacts(0.03 * normals + [0.0, 0.0, 0.05], normals, position_noise=np.full(7, 1e-4))
    views = Views((view.posed(true),), 0.0).given(touches)  # the prior's error is not there
    seen = views.corrected[0].contacts.points
    moved = view.posed(true).contacts.points - seen
    assert np.linalg.norm(moved[:, :2], axis=1).max() < 4e-4


@pytest.mark.by_default("0")
@pytest.mark.parametrize("seed", range(4))
def test_a_displaced_cloud_is_dropped(seed: int) -> None:
    hand_eye = HandEye(0.002, np.deg2rad(0.5))
    view = _view(BOX, seed, DepthCamera(hand_eye=hand_eye))
    wrong = view.X_WC.copy()
    wrong[:2, 3] += (-1.0) ** seed * 0.02 * unit(np.append(wrong[:2, 2], 0.0))[:2]
    # A displacement along the touched face is not to be noticed.
    touches = _touches(BOX, view.X_WC, 8, seed, steepest=0.5)
    views = Views((view.posed(wrong),), 0.0).given(touches)
    assert views.is_dropped
    assert views.reason
    assert len(views.contacts(100)) == len(views.guesses(touches)) == 0
    assert np.isneginf(views.free.depths(BOX.vertices)[0]).all()
    assert not Views((view,), 0.0).given(touches).is_dropped
