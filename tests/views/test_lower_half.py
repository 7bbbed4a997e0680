"""The lower half of an object that is alike above and below, and of others, against true shapes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_pose
from lis_grasp.views import (
    DepthCamera,
    DepthView,
    Views,
    draw_camera_pose,
    simulate_view,
)

RADIUS = 0.035
BALL = trimesh.creation.icosphere(5, RADIUS).apply_translation([0.0, 0.0, RADIUS])
ROD = trimesh.creation.cylinder(0.02, 0.12, sections=96)
ROD.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0]))
ROD.apply_translation([0.0, 0.0, 0.02])
BOX = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.0, 0.0, 0.025])
CONE = trimesh.creation.cone(0.04, 0.07, sections=96)
DOME = trimesh.intersections.slice_mesh_plane(
    trimesh.creation.icosphere(5, 0.05), [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], cap=True
)
NOTHING = Contacts.empty()


def _view(mesh: trimesh.Trimesh, seed: int) -> DepthView:
    rng = np.random.default_rng(seed)
    X_WC = draw_camera_pose([0.0, 0.0, 0.03], rng=rng)
    return simulate_view([mesh], X_WC, DepthCamera(), rng=rng)


def _images(view: DepthView, touches: Contacts = NOTHING) -> Contacts:
    return Views((view,), 0.0)._lower_half(touches)


@pytest.mark.parametrize(
    ("mesh", "seed"),
    [(BALL, 0), (BALL, 1), (ROD, 1), (ROD, 2)],
    ids=["ball", "ball again", "rod", "rod again"],
)
def test_the_mirror_image_of_what_is_alike_above_and_below_is_on_its_surface(
    mesh: trimesh.Trimesh, seed: int
) -> None:
    images = _images(_view(mesh, seed))
    assert len(images) > 10
    assert (images.normals[:, 2] < 0.0).mean() > 0.9
    _, away, _ = trimesh.proximity.closest_point(mesh, images.points)
    assert np.sqrt(np.mean(away**2)) < 0.002  # half a millimetre is the camera's noise


@pytest.mark.parametrize("mesh", [BOX, CONE, DOME], ids=["box", "cone", "dome"])
@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_mirrored_of_what_is_not_alike(mesh: trimesh.Trimesh, seed: int) -> None:
    """The walls of a box are their own image: they are no evidence."""
    assert len(_images(_view(mesh, seed))) == 0


def test_touches_leave_what_they_confirm_and_remove_what_they_contradict() -> None:
    views = Views((_view(BALL, 0),), 0.0)
    angles = 2.0 * np.pi * np.arange(12) / 12.0
    down = np.column_stack([0.8 * np.cos(angles), 0.8 * np.sin(angles), np.full(12, -0.6)])
    center = np.array([0.0, 0.0, RADIUS])

    def low(distance: float) -> int:
        touches = Contacts(center + distance * down, down)
        guesses = views.guesses(touches)
        offsets = guesses.points[:, None] - touches.points
        near = np.linalg.norm(offsets, axis=2).min(axis=1) < 0.025
        return int((near & (guesses.normals[:, 2] < -0.5)).sum())

    assert low(RADIUS) > 10
    assert low(RADIUS + 0.012) == 0  # a foot that the view does not show


def test_the_image_of_a_touch_is_implied_too() -> None:
    view = _view(BALL, 0)
    center, away = np.array([0.0, 0.0, RADIUS]), view.X_WC[:3, 3] * [-1.0, -1.0, 0.0]
    up = np.array([0.8, 0.8, 0.6]) * (away / np.linalg.norm(away) + [0.0, 0.0, 1.0])
    touch = Contacts([center + RADIUS * up], [up])
    images = _images(view, touch)
    expected = center + RADIUS * up * [1.0, 1.0, -1.0]
    assert np.linalg.norm(images.points - expected, axis=1).min() < 0.002


def test_a_turn_about_the_vertical_turns_the_mirror_image() -> None:
    view = _view(ROD, 1)
    turn = trimesh.transformations.rotation_matrix(0.8, [0.0, 0.0, 1.0], [0.1, 0.2, 0.0])
    moved = DepthView(view.depth, view.intrinsics, turn @ view.X_WC, view.mask)
    images, turned = _images(view), _images(moved)
    assert len(images) == len(turned) > 0
    order = np.lexsort(np.round(turned.points, 6).T)
    expected = apply_pose(turn, images.points)
    expected = expected[np.lexsort(np.round(expected, 6).T)]
    np.testing.assert_allclose(turned.points[order], expected, atol=1e-9)


def test_a_view_that_shows_nothing_implies_no_lower_half() -> None:
    view = _view(BALL, 0)
    empty = view.with_mask(np.zeros(view.depth.shape, dtype=bool))
    assert len(Views((empty,), 0.0).guesses(NOTHING)) == 0


def test_the_end_of_a_rod_does_not_show_that_its_sides_are_round() -> None:
    """The view is along the rod: no surface is seen together with its mirror image."""
    assert len(_images(_view(ROD, 0))) == 0
