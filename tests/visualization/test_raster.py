"""Z-buffer renderer: silhouettes, depth, order, shared edges, shades and colours."""

import numpy as np
import pytest
import trimesh

from lis_grasp.shapes.fragments import nearest_triangles
from lis_grasp.visualization.camera import LIGHT, View
from lis_grasp.visualization.colours import srgb
from lis_grasp.visualization.raster import Solid, Window, render

VIEW = View(np.deg2rad(-55.0), np.deg2rad(24.0))


def _window(width: float, pixels: tuple[int, int], middle=(0.0, 0.0)) -> Window:
    return Window(VIEW, np.array(middle), width, pixels)


def _seen(mesh: trimesh.Trimesh, window: Window) -> np.ndarray:
    return nearest_triangles(window.place(mesh.vertices)[mesh.faces], window.pixels)


@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.0131, -0.0077)])
def test_a_sphere_covers_the_area_of_a_disc(middle: tuple[float, float]) -> None:
    radius, window = 0.05, _window(0.16, (640, 640), middle)
    ball = trimesh.creation.icosphere(4, radius)
    inner = float(np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center).min())
    count = np.count_nonzero(_seen(ball, window) >= 0)
    # The silhouette is between the discs of the inscribed and the circumscribed ball. The number of
    # grid points in a closed curve differs from its area by less than its length (Jarnik).
    low, high = (np.pi * (r / window.pixel) ** 2 for r in (inner, radius))
    length = 2.0 * np.pi * radius / window.pixel
    assert low - length < count < high + length


def test_the_nearest_triangle_is_that_of_a_loop_over_all() -> None:
    rng = np.random.default_rng(0)
    triangles = rng.uniform([-5.0, -5.0, 0.0], [35.0, 25.0, 9.0], (60, 3, 3))
    nearest = nearest_triangles(triangles, (30, 20))
    edges = np.concatenate([triangles[:, :, :2], np.ones((60, 3, 1))], axis=2)  # (F, 3, 3)
    for row, column in np.ndindex(20, 30):
        weights = np.linalg.solve(edges.transpose(0, 2, 1), [[column + 0.5], [row + 0.5], [1.0]])
        weights = weights[..., 0]
        depth = np.where(weights.min(axis=1) >= 0.0, (weights * triangles[..., 2]).sum(axis=1), -1)
        shown = nearest[row, column]
        assert (shown >= 0) == (depth.max() >= 0.0)
        if shown >= 0:
            assert depth[shown] == pytest.approx(depth.max(), abs=1e-4)  # single precision


def test_two_planes_that_cross_change_places_at_their_common_line() -> None:
    corners = np.array([[-10.0, -10.0], [50.0, -10.0], [50.0, 50.0], [-10.0, 50.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    rising = np.column_stack([corners, corners[:, 0]])
    falling = np.column_stack([corners, 25.0 - corners[:, 0]])
    nearest = nearest_triangles(np.concatenate([rising[faces], falling[faces]]), (40, 30))
    shows_rising = nearest < 2
    assert np.array_equal(shows_rising, np.tile(np.arange(40) + 0.5 > 12.5, (30, 1)))


def test_a_pixel_at_a_common_edge_belongs_to_one_triangle() -> None:
    corners = np.array([[2.5, 2.5, 0.0], [12.5, 2.5, 0.0], [12.5, 12.5, 0.0], [2.5, 12.5, 0.0]])
    halves = corners[np.array([[0, 1, 2], [0, 2, 3]])]  # the diagonal passes through centres
    counts = [np.count_nonzero(nearest_triangles(half[None], (20, 20)) >= 0) for half in halves]
    assert sum(counts) == np.count_nonzero(nearest_triangles(halves, (20, 20)) >= 0) == 100


def test_the_picture_does_not_depend_on_the_fragments_in_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ball, window = trimesh.creation.icosphere(2, 0.05), _window(0.12, (60, 60))
    whole = _seen(ball, window)
    monkeypatch.setattr("lis_grasp.shapes.fragments._MOST_FRAGMENTS", 100)
    assert np.array_equal(_seen(ball, window), whole)


def _card(direction: np.ndarray, half: float = 1.0) -> trimesh.Trimesh:
    """Return a square whose normal is a direction in the view's axes."""
    square = [[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]]
    turn = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], VIEW.axes.T @ direction)
    card = trimesh.Trimesh(square, [[0, 1, 2], [0, 2, 3]], process=False)
    return card.apply_transform(turn)


def test_a_surface_towards_the_light_has_its_own_colour_and_others_are_darker() -> None:
    window = _window(0.1, (8, 8))
    lit = render([Solid(_card(LIGHT), "#808040")], window)
    assert np.abs(lit[..., :3] / 255.0 - srgb("#808040")).max() < 1.0 / 255.0
    assert np.all(lit[..., 3] == 255)
    aside = render([Solid(_card(np.array([0.0, -0.6, 0.8])), "#808040")], window)
    assert np.all(aside[..., :3] < lit[..., :3])
    inverted = _card(LIGHT)
    inverted.invert()
    assert np.array_equal(render([Solid(inverted, "#808040")], window), lit)


def test_colours_of_vertices_are_linear_between_them() -> None:
    card, window = _card(LIGHT, half=0.05), _window(0.02, (8, 8))
    slope = np.array([4.0, -3.0, 2.0])  # per metre in O
    colours = 0.5 + np.outer(card.vertices @ slope, np.ones(3))
    shown = render([Solid(card, colours)], window)[..., :3] / 255.0
    column, row = np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5)
    right, up = (column - 4.0) * window.pixel, (4.0 - row) * window.pixel
    depth = -(right * LIGHT[0] + up * LIGHT[1]) / LIGHT[2]  # of the card, which contains 0
    points = np.stack([right, up, depth], axis=-1) @ VIEW.axes
    # A pixel is the mean of its samples, which is the value at its centre; half a step rounds.
    assert np.abs(shown - (0.5 + points @ slope)[..., None]).max() < 0.51 / 255.0


def test_an_edge_is_smooth_and_empty_places_are_transparent() -> None:
    ball, window = trimesh.creation.icosphere(4, 0.05), _window(0.16, (160, 160))
    opacity = render([Solid(ball, "#ffffff")], window)[..., 3]
    assert set(np.unique(opacity)) == {0, 64, 128, 191, 255}
    fine = np.count_nonzero(_seen(ball, window.finer(2)) >= 0)
    # Each of the values is rounded by at most a quarter of a step of 255.
    assert opacity.sum() / 255.0 == pytest.approx(fine / 4.0, abs=0.25 / 255.0 * opacity.size)
    assert not render([], window).any()
