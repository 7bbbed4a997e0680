"""Stills: what they show, their frame, and pictures of a run in files and notebooks."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from IPython.core.formatters import DisplayFormatter
from made_grasps import jaw_grasp
from PIL import Image
from random_directions import random_directions

import lis_grasp as lg
from lis_grasp import pipeline
from lis_grasp._displays import register
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.visualization._arm_layer import link_looks
from lis_grasp.visualization.camera import View
from lis_grasp.visualization.colours import VIRIDIS, srgb
from lis_grasp.visualization.hand_layers import LINK_COLOUR
from lis_grasp.visualization.still import PIXELS, Still
from lis_grasp.world import ALONE, Body, Surroundings

AXES = np.vstack([np.eye(3), -np.eye(3)])
CONTACTS = lg.Contacts(0.03 * AXES, AXES)
BALL = trimesh.creation.icosphere(3, 0.03)
HAND = lg.Hand.load("wsg50")
GRASP = jaw_grasp(HAND, np.zeros(3), 0.06)
VIEW = View(np.deg2rad(20.0), np.deg2rad(24.0))


def _pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)), dtype=int)


def _places(picture: np.ndarray, colour: str, tolerance: float = 0.02) -> np.ndarray:
    """Return columns and rows (N, 2) of the pixels with the hue of a colour."""
    rgb = picture[..., :3] / 255.0
    ratio = rgb / np.maximum(rgb.max(axis=-1, keepdims=True), 1e-9)
    own = srgb(colour) / srgb(colour).max()
    rows, columns = np.nonzero(
        (np.abs(ratio - own) < tolerance).all(axis=-1) & (picture[..., 3] > 250)
    )
    return np.column_stack([columns, rows]) + 0.5


def test_contacts_are_marked_where_they_are_seen_and_hidden_behind_the_solid() -> None:
    still = Still(solid=BALL, contacts=CONTACTS, bad_contacts=[2])
    window = still.window(VIEW)
    picture = still.draw(window)
    radius = 0.03 / window.pixel
    for colour, row in (("#ff4d4d", 0), ("#8e44ad", 2)):  # at +x, and at +z, doubted
        place = window.place(CONTACTS.points[row])[:2]
        near = _places(picture, colour)
        assert np.linalg.norm(near - place, axis=1).min() < 0.1 * radius
        assert np.linalg.norm(near - place, axis=1).max() < 0.2 * radius or colour == "#ff4d4d"
    behind = window.place(CONTACTS.points[3])[:2]  # at -x
    assert np.linalg.norm(_places(picture, "#ff4d4d") - behind, axis=1).min() > 0.1 * radius


@pytest.mark.parametrize("solid", [BALL, None])
def test_object_and_hand_are_whole(solid: trimesh.Trimesh | None) -> None:
    still = Still(solid=solid, hand=HAND, grasp=GRASP)
    for view in (still.best_view(), VIEW):
        window = still.window(view)
        links = HAND.forward_kinematics(GRASP.X_OH, GRASP.joint_positions)
        looks = [(X, look) for name, X in links.items() for look in link_looks(HAND, name)]
        shown = [np.asarray(trimesh.transform_points(look.vertices, X)) for X, look in looks]
        place = window.place(np.vstack(shown if solid is None else [*shown, solid.vertices]))
        assert np.all(place[:, :2] > 0.0)
        assert np.all(place[:, :2] < PIXELS)
        # Nothing but margins of a twentieth of the object is beside them, in one direction.
        wide = 1.0 - np.ptp(place[:, :2], axis=0) / PIXELS
        assert wide.min() < 0.1
    assert len(_places(still.draw(window), LINK_COLOUR)) > 100


def test_of_a_cloud_every_nth_point_is_marked() -> None:
    directions = random_directions(5500, np.random.default_rng(0))
    cloud = lg.Contacts(0.03 * directions, directions)
    discs, ribbons = Still(contacts=cloud)._solids(VIEW)
    assert len(ribbons.mesh.faces) == 2 * 917  # every sixth
    assert len(discs.mesh.faces) == 10 * 917


def test_equal_contents_give_equal_bytes_and_nothing_is_white() -> None:
    still = Still(solid=BALL, contacts=CONTACTS, hand=HAND, grasp=GRASP)
    assert still.png() == still.png()
    assert _pixels(Still().png()).min() == 255
    assert _pixels(Still(contacts=CONTACTS[:1]).png()).min() < 255


def test_bodies_beside_the_object_are_glass_and_hide_nothing() -> None:
    wall = Body.box("wall", (0.2, 0.01, 0.1), (0.0, -0.08, 0.0))  # before the ball
    can = Body.box("can", (0.03, 0.03, 0.03), (0.09, 0.0, 0.0), mass=0.1)
    alone, among = (Still(solid=BALL, surroundings=s) for s in (ALONE, Surroundings((wall, can))))
    front = View(-0.5 * np.pi, 0.0)
    window = among.window(front)
    assert window.width > 1.5 * alone.window(front).width
    with_bodies, without = among.draw(window), alone.draw(window)
    ball = without[..., 3] == 255
    difference = np.abs(with_bodies[ball].astype(int) - without[ball])
    assert (with_bodies[ball][:, 3] == 255).all()
    assert 0 < difference.max() <= 0.25 * 255 + 1
    beside = (without[..., 3] == 0) & (with_bodies[..., 3] > 0)
    assert set(np.unique(with_bodies[beside][:, 3])) <= set(range(1, 66))
    assert np.count_nonzero(beside) > 5000


def test_a_scene_s_picture_shows_the_truth_only_without_an_estimate() -> None:
    truth = lg.shapes.build("box").mesh
    alone = lg.Scene(truth=truth).png()
    estimated = lg.Scene(truth=truth, estimate=BALL, contacts=CONTACTS).png()
    assert _pixels(alone).shape == (480, 640, 3)
    assert alone != lg.Scene(estimate=truth).png()
    # The scale of colours is that of the object's size; a mesh without uncertainty has none.
    assert estimated == lg.Scene(estimate=BALL, contacts=CONTACTS).png()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "box"
    task = lg.Task.of("box", known=True, hand="wsg50", prober="kinematic", touches=6)
    pipeline.explore_object(task, folder)
    source = pipeline.ContactSource(folder / "contacts.ply")
    estimated = pipeline.estimate_file([source], folder)
    pipeline.grasp_file(estimated.path, folder, grasps=2)
    return folder


@pytest.mark.slow
def test_a_notebook_shows_pictures_of_surfaces_grasps_and_runs(folder: Path) -> None:
    formatter, run = DisplayFormatter(), lg.Run.load(folder)
    register(formatter)

    def shown(content: object) -> dict:
        return formatter.format(content)[0]

    for surface in (run.surface, lg.estimate(CONTACTS, "gpis"), lg.estimate(CONTACTS, "patch")):
        assert _pixels(shown(surface)["image/png"]).shape == (480, 640, 3)
    estimate = pipeline.SurfaceEstimate(CONTACTS)
    assert _pixels(shown(estimate)["image/png"]).shape == (480, 640, 3)
    assert shown(run.grasps)["text/html"].count("<img") == 2
    assert "<img" not in shown(GraspSearch((), {"collision": 3}, 3))["text/html"]
    assert shown(run)["text/html"].count("<img") == 1
    assert _pixels(shown(run)["image/png"]).shape == (480, 640, 3)


def test_a_surface_is_violet_where_it_is_certain_and_yellow_where_it_is_not() -> None:
    ball = BALL.copy()
    ball.vertex_attributes["uncertainty"] = np.where(ball.vertices[:, 2] > 0.0, np.inf, 0.0)
    picture = Still(solid=ball).draw(Still(solid=ball).window(View(0.0, 0.0)))
    yellow, violet = (_places(picture, colour)[:, 1] for colour in (VIRIDIS[-1], VIRIDIS[0]))
    assert min(len(yellow), len(violet)) > 10_000
    assert yellow.max() < violet.min()
