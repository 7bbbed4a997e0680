"""Contacts, free space and masks of depth views: closed forms, and bounds by the true shape."""

import numpy as np
import pytest
import trimesh

from lis_grasp.exceptions import InvalidOptionError, InvalidViewError, NothingSeenError
from lis_grasp.geometry import make_pose
from lis_grasp.views import (
    DepthCamera,
    DepthNoise,
    DepthView,
    HandEye,
    Views,
    draw_camera_pose,
    segment_object,
    simulate_view,
)

EXACT = DepthCamera(noise=DepthNoise.none())
BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])


def _view(mesh: trimesh.Trimesh, seed: int, camera: DepthCamera = EXACT) -> DepthView:
    rng = np.random.default_rng(seed)
    return simulate_view([mesh], draw_camera_pose([0.0, 0.0, 0.03], rng=rng), camera, rng=rng)


@pytest.mark.parametrize("seed", range(3))
def test_no_noise_puts_contacts_on_a_box(seed: int) -> None:
    contacts = _view(BOX, seed).contacts
    outside = np.abs(contacts.points - [0.0, 0.0, 0.025]) - [0.05, 0.03, 0.025]
    assert len(contacts) > 500
    assert np.median(np.abs(outside.max(axis=1))) < 1e-6


@pytest.mark.by_default("0")
@pytest.mark.parametrize("seed", range(3))
def test_space_that_is_seen_to_be_free_is_outside_of_the_object(seed: int) -> None:
    view = _view(BOX, seed, DepthCamera())
    rng = np.random.default_rng(seed)
    inside = rng.uniform([-0.05, -0.03, 0.0], [0.05, 0.03, 0.05], (20_000, 3))
    depths, _ = view.depths(inside)
    assert np.count_nonzero(depths > 0.0) <= 2  # 1e-4 of them


def test_slopes_are_those_of_the_depths() -> None:
    view = _view(BOX, 0)
    points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.0], [0.1, 0.1, 0.12], (500, 3))
    depths, slopes = view.depths(points)
    step = 1e-6
    for axis in range(3):
        offset = step * np.eye(3)[axis]
        higher, lower = view.depths(points + offset)[0], view.depths(points - offset)[0]
        known = np.isfinite(higher) & np.isfinite(lower) & np.isfinite(depths)
        known &= np.abs(higher + lower - 2.0 * depths)[...] < 1e-8  # no jump between pixels
        numeric = (higher - lower)[known] / (2.0 * step)
        assert np.count_nonzero(known) > 200
        # The jump of a step of a pixel is excluded; within one, depths are bilinear.
        assert np.abs(numeric - slopes[known, axis]).max() < 1e-2


def test_a_view_in_another_frame_has_the_contacts_of_that_frame() -> None:
    view = _view(BOX, 1, DepthCamera())
    turn = trimesh.transformations.rotation_matrix(0.7, [0.3, 0.2, 0.9])
    X_WF = make_pose(turn[:3, :3], [0.1, -0.2, 0.3])
    moved, there = view.in_frame(X_WF).contacts, view.contacts.in_frame(X_WF)
    assert np.abs(moved.points - there.points).max() < 1e-12
    assert np.abs(moved.normals - there.normals).max() < 1e-12


@pytest.mark.by_default("2", "3")
@pytest.mark.parametrize("seed", range(4))
def test_the_mask_is_found_above_the_table(seed: int) -> None:
    view = _view(BOX, seed, DepthCamera(hand_eye=HandEye(0.002, np.deg2rad(0.5))))
    found, true = segment_object(view, 0.0).object_mask, view.object_mask
    assert np.count_nonzero(found & true) > 0.85 * np.count_nonzero(found | true)


def test_an_empty_table_has_no_object() -> None:
    far = BOX.copy().apply_translation([0.0, 0.0, -1.0])  # below the table
    with pytest.raises(NothingSeenError) as caught:
        segment_object(_view(far, 0), 0.0)
    assert caught.value.height == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"depth": np.ones(5)}, "depth"),
        ({"depth": -np.ones((480, 640))}, "depth"),
        ({"mask": np.ones((3, 4), dtype=bool)}, "mask"),
    ],
)
def test_a_malformed_view_is_refused(change: dict[str, np.ndarray], field: str) -> None:
    view = _view(BOX, 0)
    given = {"depth": view.depth, "mask": view.mask} | change
    with pytest.raises(InvalidViewError) as caught:
        DepthView(given["depth"], view.intrinsics, view.X_WC, given["mask"])
    assert caught.value.field == field


def test_a_pose_must_be_rigid() -> None:
    view = _view(BOX, 0)
    with pytest.raises(InvalidOptionError) as caught:
        DepthView(view.depth, view.intrinsics, 2.0 * view.X_WC)
    assert caught.value.option == "X_WC"


def test_views_need_a_mask() -> None:
    view = _view(BOX, 0)
    with pytest.raises(InvalidViewError) as caught:
        Views((DepthView(view.depth, view.intrinsics, view.X_WC),), 0.0)
    assert caught.value.field == "mask"


def test_thinned_contacts_keep_the_noise_that_neighbours_have_in_common() -> None:
    views = Views((_view(BOX, 0, DepthCamera()),), 0.0)
    few, all_of_them = views.contacts(200), views.views[0].contacts
    assert len(few) == 200
    assert np.median(few.position_noise) > 0.8 * np.median(all_of_them.position_noise)
