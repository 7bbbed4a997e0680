"""Figures: projection, hidden surfaces, colour scales, error lines, charts."""

from __future__ import annotations

import io
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from lis_grasp import shapes
from lis_grasp.contacts import Contacts
from lis_grasp.evaluation.surface_error import sample_mesh, surface_error
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import tangent_frame
from lis_grasp.shapes import Shape
from lis_grasp.surfaces import LocalImplicitSurface, PatchImplicitSurface, judge_contacts
from lis_grasp.typing import FloatArray
from lis_grasp_studies.figures import (
    CHART_CAPTIONS,
    FIGURES,
    bars,
    calibration,
    curve_panels,
    png_of,
)
from lis_grasp_studies.figures._convexity import angular_kernel, around
from lis_grasp_studies.figures._errors import error_lines
from lis_grasp_studies.figures._objects import _owners, bad_contacts, bad_set, patch_map
from lis_grasp_studies.figures._planar import (
    OUTLINE,
    convexity_towards,
    draw_field,
    planar_contacts,
    step_contacts,
)
from lis_grasp_studies.figures._solids import two_tone_patches, view_on
from lis_grasp_studies.figures.painter import (
    Patches,
    View,
    cut_segments,
    cut_triangles,
    edge_patches,
    frame_of,
    line_patches,
    mesh_patches,
    paint,
    point_patches,
    triangle_patches,
)
from lis_grasp_studies.figures.palette import (
    ESTIMATORS,
    QUIET,
    convexity_colours,
    error_colours,
    estimator_colour,
    estimator_label,
    rgba,
)
from lis_grasp_studies.paper.trials import explored

LOOK = View(np.deg2rad(25.0), np.deg2rad(30.0))
RED, BLUE = "#ff0000", "#0000ff"
UNIT_FRAME = np.array([[-1.0, -1.0], [1.0, 1.0]])


# --- projection and painting ---------------------------------------------------------------------


def test_a_view_from_plus_x_has_y_to_the_right_and_z_up() -> None:
    places, depths = View(0.0, 0.0).project([[1.0, 2.0, 3.0], [-4.0, 0.0, 0.0]])
    assert_allclose(places, [[2.0, 3.0], [0.0, 0.0]], atol=1e-15)
    assert_allclose(depths, [1.0, -4.0], atol=1e-15)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.3, 0.5), (-2.0, 1.2), (3.0, -0.4)])
def test_a_views_axes_are_a_right_handed_frame_and_z_is_vertical(
    azimuth: float, elevation: float
) -> None:
    view = View(azimuth, elevation)
    assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
    assert_allclose(np.linalg.det(view.axes), 1.0, atol=1e-15)
    top, depth = view.project([0.0, 0.0, 1.0])
    assert_allclose([*top, depth], [0.0, np.cos(elevation), np.sin(elevation)], atol=1e-15)


def _pixels(patches: list[Patches], frame: FloatArray = UNIT_FRAME) -> npt.NDArray[np.uint8]:
    figure = Figure(figsize=(1.0, 1.0), dpi=100, facecolor="white")
    paint(figure.add_axes((0.0, 0.0, 1.0, 1.0)), patches, frame=frame)
    stream = io.BytesIO()
    figure.savefig(stream, format="rgba", dpi=100)
    return np.frombuffer(stream.getvalue(), dtype=np.uint8).reshape(100, 100, 4)


def _is(pixel: npt.NDArray[np.uint8], colour: str) -> bool:
    """Return whether a pixel has a colour's hue: shading scales it."""
    shown = pixel[:3] / max(int(pixel[:3].max()), 1)
    return bool(np.allclose(shown, rgba(colour)[:3], atol=0.02))


def _triangle(depth: float, colour: str) -> Patches:
    """Return a triangle round the middle of the picture, seen square on, this near to the eye."""
    corners = np.array([[-0.8, -0.8, depth], [0.8, -0.8, depth], [0.0, 0.9, depth]])
    return triangle_patches(
        LOOK, (corners @ LOOK.axes)[None], LOOK.axes[2][None], rgba(colour)[None]
    )


@pytest.mark.parametrize("near_first", [True, False])
def test_a_nearer_triangle_hides_a_farther_one_in_any_order(
    near_first: bool,
) -> None:
    near, far = _triangle(0.5, RED), _triangle(-0.5, BLUE)
    assert _is(_pixels([near, far] if near_first else [far, near])[50, 50], RED)
    assert _is(_pixels([far])[50, 50], BLUE)


@pytest.mark.parametrize(("depth", "seen"), [(0.3, RED), (-0.3, BLUE)])
def test_lines_and_points_are_hidden_by_nearer_triangles(depth: float, seen: str) -> None:
    wall = _triangle(0.0, BLUE)
    across = np.array([[[-0.5, 0.0, depth], [0.5, 0.0, depth]]]) @ LOOK.axes
    line = line_patches(LOOK, across, RED, width=0.1, piece=0.05)
    point = point_patches(LOOK, across.mean(axis=1), RED, radius=0.1)
    assert _is(_pixels([line, wall])[50, 50], seen)
    assert _is(_pixels([point, wall])[50, 50], seen)


def test_a_lifted_line_is_visible_on_the_surface_that_it_is_in() -> None:
    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    surface = mesh_patches(LOOK, cube, BLUE, piece=0.1)
    corner = edge_patches(LOOK, cube, RED, width=0.05, lift=0.1)
    # The near upright edge, in the middle of its height.
    near = max(cube.vertices, key=lambda vertex: LOOK.project(vertex)[1])
    (x, y), _ = LOOK.project([near[0], near[1], 0.0])
    row, column = round(50 * (1.0 - y)), round(50 * (1.0 + x))
    assert _is(_pixels([corner, surface])[row, column], RED)


def _areas(outlines: FloatArray) -> FloatArray:
    a, b = (outlines[:, k] - outlines[:, 0] for k in (1, 2))
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


@pytest.mark.parametrize("name", ["box", "hollow_cylinder"])
def test_a_mesh_is_drawn_as_its_faces_towards_the_eye_foreshortened(name: str) -> None:
    mesh = shapes.build(name).mesh
    cosines = np.clip(mesh.face_normals @ LOOK.axes[2], 0.0, None)
    drawn = mesh_patches(LOOK, mesh, BLUE, piece=0.004)
    assert_allclose(_areas(drawn.outlines).sum(), mesh.area_faces @ cosines, rtol=1e-9)


def test_a_cube_shows_nine_of_its_twelve_edges() -> None:
    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    edges = edge_patches(LOOK, cube, RED, width=0.01, lift=0.0)
    far_corner = min(LOOK.project(v)[1] for v in cube.vertices)
    assert len(line_patches(LOOK, shapes.sharp_edges(cube), RED, width=0.01).depths) == 12 * 250
    assert len(edges.depths) == 9 * 250  # pieces of 4 mm
    assert edges.depths.min() > far_corner


def test_cut_triangles_are_small_and_cover_the_same() -> None:
    rng = np.random.default_rng(5)
    triangles = rng.normal(size=(20, 3, 3))
    pieces, owners = cut_triangles(triangles, 0.4)
    sides = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
    assert sides.max() <= 0.4

    def area(t: FloatArray) -> FloatArray:
        return 0.5 * np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)

    assert_allclose(np.bincount(owners, area(pieces)), area(triangles), rtol=1e-9)


def test_cut_lines_are_equal_parts_in_order() -> None:
    pieces, owners = cut_segments(
        np.array([[[0.0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0.3, 0]]]), 0.25
    )
    assert_array_equal(owners, [0, 0, 0, 0, 1, 1])
    assert_allclose(pieces[:4, 0, 0], [0.0, 0.25, 0.5, 0.75])
    assert_allclose(pieces[4:, :, 1], [[0.0, 0.15], [0.15, 0.3]])


def test_a_frame_contains_all_patches() -> None:
    patches = point_patches(LOOK, np.array([[0.0, 0, 0], [0, 0, 1]]), RED, radius=0.1)
    frame = frame_of([patches], margin=0.0)
    assert_allclose(frame[:, 1], [-0.1, np.cos(LOOK.elevation) + 0.1], atol=1e-12)


# --- colours -------------------------------------------------------------------------------------


def test_convex_is_blue_concave_is_red_and_flat_is_neither() -> None:
    convex, flat, concave = convexity_colours([-0.8, 0.0, 0.8])[:, :3]
    assert convex[2] > convex[0] + 0.3
    assert concave[0] > concave[2] + 0.3
    assert np.ptp(flat) < 0.02
    assert flat.min() > 0.9
    assert_array_equal(convexity_colours(-3.0), convexity_colours(-1.0))


def test_small_errors_are_green_large_ones_red_and_larger_ones_darker() -> None:
    small, large, largest = error_colours([0.0, 0.012, 1.0], 0.015)[:, :3]
    assert small.argmax() == 1
    assert large.argmax() == 0
    assert largest.sum() < large.sum() < small.sum()


def test_every_estimator_has_a_colour_of_its_own() -> None:
    own = {colour for colour, _ in ESTIMATORS.values()} - {QUIET}
    colours = [rgba(colour)[:3] for colour in own]
    apart = np.linalg.norm(np.array(colours)[:, None] - colours, axis=2) + np.eye(len(colours))
    assert apart.min() > 0.15  # of the cube's side of 1
    assert len(own) == 12
    assert estimator_colour("someone_elses") == QUIET
    assert estimator_label("someone_elses") == "someone_elses"


# --- drawings match the computed values ----------------------------------------------------------


def test_f_changes_sign_on_the_zero_line() -> None:
    contacts = step_contacts()
    surface = LocalImplicitSurface.from_contacts(contacts)
    axes = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    frame = np.array([[-0.06, -0.03], [0.06, 0.08]])
    zero = draw_field(axes, surface, frame, largest=0.04)
    line = np.concatenate([path.vertices for path in zero.get_paths()])
    assert len(line) > 300
    # The line is within a cell of the grid, 0.4 mm wide, of the sign's change.
    around_line = line[:, None] + 0.0004 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]])
    values = surface.evaluate(np.dstack([around_line, np.zeros(around_line.shape[:2])]))
    assert np.all((values.min(axis=1) <= 0.0) & (values.max(axis=1) >= 0.0))
    assert axes.images[0].get_array().shape == (276, 301)


def test_the_zero_line_of_one_contact_is_its_plane() -> None:
    surface = LocalImplicitSurface.from_contacts(planar_contacts([[0.0, 0.01]], [[0.0, 1.0]]))
    axes = Figure().add_axes((0.0, 0.0, 1.0, 1.0))
    zero = draw_field(axes, surface, 0.05 * UNIT_FRAME, largest=0.04)
    line = np.concatenate([path.vertices for path in zero.get_paths()])
    assert_allclose(line[:, 1], 0.01, atol=1e-12)  # f is linear: interpolation is exact


@pytest.mark.parametrize(("side", "sign"), [(1.0, -1.0), (-1.0, 1.0)])
def test_circles_show_the_sine_of_the_only_neighbours_height(side: float, sign: float) -> None:
    corner = planar_contacts([[0.0, side * 0.05], [side * 0.05, 0.0]], [[0.0, 1.0], [1.0, 0.0]])
    surface = LocalImplicitSurface.from_contacts(corner)
    for contact in (0, 1):
        beta = convexity_towards(
            surface, contact, np.array([[0.01, 0.02, 0.0], [-0.02, 0.01, 0.0]])
        )
        assert_allclose(beta, sign * np.sqrt(0.5), atol=1e-12)  # 45 degrees below, or above


def test_the_steps_middle_contact_is_convex_upwards_and_concave_downwards() -> None:
    surface = LocalImplicitSurface.from_contacts(step_contacts())
    up, down = convexity_towards(surface, 1, np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]))
    assert up < -0.5
    assert down > 0.5


def test_the_steps_contacts_are_on_its_outline() -> None:
    for point in step_contacts().points[:, :2]:
        detours = [
            np.linalg.norm(point - a) + np.linalg.norm(point - b) - np.linalg.norm(b - a)
            for a, b in pairwise(OUTLINE)
        ]
        assert_allclose(min(detours), 0.0, atol=1e-12)


def test_corrected_beta_overshoots_corners_less_than_none_and_the_published_sign_more() -> None:
    contacts = step_contacts()
    x = np.linspace(0.002, 0.03, 30)
    overshoot = {}
    for beta in ("corrected", "none", "as_published"):
        surface = LocalImplicitSurface.from_contacts(
            contacts, beta=beta, sigma=0.3 * contacts.spacing
        )
        y = np.linspace(0.05, 0.08, 601)
        values = surface.evaluate(np.stack([*np.meshgrid(x, y), np.zeros((601, 30))], axis=-1))
        overshoot[beta] = y[np.argmax(values > 0.0, axis=0)].max() - 0.05
    assert overshoot["corrected"] < 0.5 * overshoot["none"] < overshoot["as_published"]
    assert overshoot["none"] < overshoot["as_published"]


def test_the_angular_kernel_has_its_closed_form_values() -> None:
    values = angular_kernel([0.0, np.pi, -np.pi, np.pi / 2], width=0.5, height=0.8)
    assert_allclose(values, 0.8 * np.exp([0.0, -2.0, -2.0, -1.0]), rtol=1e-12)


def test_two_neighbours_merge_by_the_angular_kernel_as_drawn() -> None:
    sigma = 0.04
    points = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, -0.01], [0.0, 0.04, 0.02]])
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    surface = LocalImplicitSurface.from_contacts(Contacts(points, normals), sigma=sigma)
    plane = tangent_frame(normals[0])
    phi = np.linspace(-3.0, 3.0, 13)
    x_axis = np.arctan2(*plane[:, 0][::-1])  # the plane's angle of +x, of neighbour 1
    y_axis = np.arctan2(*plane[:, 1][::-1])
    merged, total = np.zeros(13), np.zeros(13)
    for j, angle in ((1, x_axis), (2, y_axis)):
        far, height = np.linalg.norm(points[j]), points[j, 2]
        kernel = angular_kernel(
            phi - angle,
            width=np.exp(-0.5 * (height / sigma) ** 2),
            height=np.exp(-0.5 * (far / sigma) ** 2),
        )
        merged, total = merged + kernel * height / far, total + kernel
    assert_allclose(convexity_towards(surface, 0, around(phi, plane)), merged / total, rtol=1e-9)


def _shrunk_box(by: float) -> tuple[Shape, trimesh.Trimesh, Contacts]:
    """Return a cube of 10 cm, an estimate `by` inside of it, and contacts all over."""
    truth = Shape.from_mesh(trimesh.creation.box((0.1, 0.1, 0.1)), "cube")
    estimate = trimesh.creation.box((0.1 - 2 * by,) * 3)
    axes = np.vstack([np.eye(3), -np.eye(3)])
    return truth, estimate, Contacts(0.05 * axes, axes)


def test_error_lines_are_as_long_as_the_distances_and_end_on_the_estimate() -> None:
    by = 0.004
    truth, estimate, contacts = _shrunk_box(by)
    lines = error_lines(estimate, truth, contacts, radius=1.0)
    # From a piece's middle to the inner cube: `by` along two axes, and along the third the
    # distance of the middle beyond the inner cube's end.
    middles = lines.pieces.mean(axis=1)
    beyond = np.clip(np.abs(middles) - (0.05 - by), 0.0, None)
    assert_allclose(lines.lines[:, 0], middles, atol=1e-15)
    assert_allclose(lines.errors, np.linalg.norm(beyond, axis=1), rtol=1e-7)
    assert_allclose(np.abs(lines.lines[:, 1]).max(axis=1), 0.05 - by, atol=1e-9)
    assert_allclose(np.linalg.norm(np.diff(lines.pieces, axis=1), axis=2).sum(), 1.2, rtol=1e-9)


def test_the_noted_error_is_that_of_the_evaluation() -> None:
    truth, estimate, contacts = _shrunk_box(0.004)
    lines = error_lines(estimate, truth, contacts, radius=0.06)
    error = surface_error(estimate, truth, contacts, explored_radius=0.06)
    # The explored part of an edge, some 66 mm, ends at a whole number of pieces of 2.5 mm or not.
    assert lines.rmsd is not None
    assert error.edge_rmsd is not None
    assert_allclose(lines.rmsd, error.edge_rmsd, rtol=2.5 / 66)
    assert lines.note == f"{1e3 * lines.rmsd:.1f} mm"


def test_unexplored_edges_get_no_lines() -> None:
    truth, estimate, contacts = _shrunk_box(0.004)
    one = contacts.subset([0])
    lines = error_lines(estimate, truth, one, radius=0.06)
    assert 0 < len(lines.pieces) < len(error_lines(estimate, truth, contacts, radius=0.06).pieces)
    assert cKDTree(one.points).query(lines.lines[:, 0])[0].max() <= 0.06
    none = error_lines(estimate, truth, one, radius=0.01)
    assert none.rmsd is None
    assert none.note == "no edge explored"


def test_the_yellow_fraction_of_the_visible_area_is_the_explored_fraction() -> None:
    shape, walk = explored("box", 100)
    contacts, mesh = walk.until(0.5), shape.mesh
    view = view_on(contacts)
    patches = two_tone_patches(view, mesh, contacts, 0.05, ("#ffff00", "#ff0000"), piece=0.001)
    yellow = patches.colours[:, 1] > 0.1
    areas = _areas(patches.outlines)
    points, faces = sample_mesh(mesh, 20_000)
    cosines = np.clip(mesh.face_normals[faces] @ view.axes[2], 0.0, None)
    known = cKDTree(contacts.points).query(points)[0] <= 0.05
    # Even samples of a region of some 10^4 hit its area to about 1 %.
    assert_allclose(
        areas[yellow].sum() / areas.sum(), cosines[known].sum() / cosines.sum(), atol=0.01
    )


def test_contacts_face_the_view_that_is_chosen_for_them() -> None:
    normals = np.array([[-1.0, 0.0, 0.0], [-0.8, 0.6, 0.0]])
    view = view_on(Contacts(0.1 * normals, normals))
    assert np.all(normals @ view.axes[2] > 0.5)


# --- charts --------------------------------------------------------------------------------------


def test_bars_are_as_high_as_the_means() -> None:
    values = {"gpis": {"box": [1.0, 3.0], "mallet": [5.0, 7.0]}, "lis": {"box": [1.0, np.nan]}}
    figure = bars(values, title="t", ylabel="mm")
    axes = figure.axes[0]
    drawn = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    heights = [patch.get_height() for patch in drawn if patch.get_width() < 0.9]
    assert_allclose(heights, [2.0, 6.0, 4.0, 1.0, 1.0])  # box, mallet, mean; box, mean
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["GPIS (4.0)", "LIS (1.0)"]
    assert axes.get_ylim()[0] == 0.0


def test_bars_need_values() -> None:
    with pytest.raises(InvalidOptionError) as error:
        bars({"lis": {"box": [np.nan]}}, title="t", ylabel="mm")
    assert error.value.option == "values"


def test_curves_go_through_the_means_with_nothing_cut_off() -> None:
    values = np.array([[1.0, 3.0], [4.0, np.nan], [5.0, 9.0]])
    figure = curve_panels(
        ["a", "b", "c"], {"left": {"lis": values}, "right": {"gpis": 3 * values}},
        xlabel="noise", ylabel="mm",
    )  # fmt: skip
    left, right = figure.axes
    assert_allclose(left.lines[0].get_ydata(), [2.0, 4.0, 7.0])
    assert left.get_ylim() == right.get_ylim()
    assert right.get_ylim()[1] > 27.0  # mean and deviation of the largest, 21 + 6


def test_curves_of_another_number_of_levels_are_refused() -> None:
    with pytest.raises(InvalidOptionError) as error:
        curve_panels(["a", "b"], {"t": {"lis": np.zeros((3, 4))}}, xlabel="", ylabel="")
    assert error.value.option == "lis"


def test_calibration_shows_observed_beside_predicted_coverage() -> None:
    observed = {"lis": np.array([[0.5, 0.7], [0.9, 1.0]]), "gpis": [0.68, 0.95]}
    first, second = calibration([0.683, 0.95], observed, title="t").axes
    assert_allclose([line.get_xdata()[0] for line in first.lines], [0.683, 0.6, 0.68])
    assert_allclose([line.get_xdata()[0] for line in second.lines], [0.95, 0.95, 0.95])
    with pytest.raises(InvalidOptionError) as error:
        calibration([0.683, 0.95], {"lis": [0.5]}, title="t")
    assert error.value.option == "lis"


# --- whole figures -------------------------------------------------------------------------------

# Options that make the longest ones short.
SHORT: dict[int, dict[str, object]] = {
    1: {"names": ("gpis", "blend")},
    8: {"names": ("lis",)},
    11: {"objects": ("mallet",), "names": ("gpis", "blend")},
}


def _width(png: bytes) -> int:
    return int.from_bytes(png[16:20], "big")  # of the header (ISO/IEC 15948, 11.2.2)


SLOW = (7, 8)  # seconds each


@pytest.mark.parametrize(
    "number", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in FIGURES]
)
def test_every_figure_is_as_wide_as_two_columns(number: int) -> None:
    figure = FIGURES[number]
    assert _width(png_of(figure.draw(**SHORT.get(number, {})), dots_per_inch=100)) == 716
    assert figure.title
    assert len(figure.caption) > 100


def test_equal_seeds_draw_equal_bytes() -> None:
    def draw(seed: int) -> bytes:
        explored.cache_clear()
        return png_of(FIGURES[5].draw(names=("box",), seed=seed), dots_per_inch=50)

    first, again, other = draw(100), draw(100), draw(101)
    assert first == again
    assert first != other


@pytest.mark.slow
def test_figure_11_shows_all_six_objects_that_have_edges() -> None:
    figure = FIGURES[11].draw()
    scenes = [a for a in figure.axes if any(isinstance(c, PolyCollection) for c in a.collections)]
    assert len([a for a in scenes if not a.axison]) == 6 * 3
    assert _width(png_of(figure)) == 1790


def test_charts_have_captions_too() -> None:
    assert sorted([*FIGURES, *CHART_CAPTIONS]) == [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12]


def test_matplotlib_is_loaded_for_figures_only_and_pyplot_never() -> None:
    program = (
        "import sys, lis_grasp.visualization; assert 'matplotlib' not in sys.modules;"
        "import lis_grasp_studies.figures as f; f.FIGURES[4].draw();"
        "assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_at_a_contact_the_map_shows_the_patch_of_the_contact() -> None:
    contacts = explored("box", 0)[1].contacts
    surface = PatchImplicitSurface.from_contacts(contacts)
    patch_of = surface.patch_of
    # A box: contacts with equal normals are in one patch, and those of opposite faces may be.
    cosines = contacts.normals @ contacts.normals.T
    one_patch = patch_of[:, None] == patch_of
    assert one_patch[cosines > 0.99].all()
    assert not one_patch[np.abs(cosines) < 0.01].any()
    owners = _owners(surface, surface.points)
    assert_array_equal(patch_of[owners], patch_of)
    assert png_of(patch_map(names=("box",)), dots_per_inch=50)[:4] == b"\x89PNG"


def test_the_bad_contacts_of_the_picture_are_those_that_the_page_names() -> None:
    told, bad = bad_set()
    verdicts = judge_contacts(told)
    assert_array_equal(np.flatnonzero(verdicts.bad), bad)
    page = Path(__file__).parents[2] / "docs" / "how-to" / "own-contacts.md"
    assert f"warning: {verdicts.sentence()}" in page.read_text("utf-8")
    assert len(bad_contacts().axes) == 2
