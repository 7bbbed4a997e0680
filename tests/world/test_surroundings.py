"""The bodies beside the object: distances, frames, and names, against closed forms."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.disturbance import Disturbance
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose
from lis_grasp.stages.scenario import Scenario
from lis_grasp.task.task import Task
from lis_grasp.world import ALONE, Body, Surroundings

SIDES = (0.06, 0.08, 0.1)
CRATE = Body.box("crate", SIDES, (0.2, 0.0, 0.05), mass=0.3)
WALL = Body.box("wall", (0.02, 0.4, 0.2), (-0.15, 0.0, 0.1))
BESIDE = Surroundings((CRATE, WALL))
X_EF = make_pose(Rotation.from_rotvec([0.2, -0.3, 0.9]).as_matrix(), [0.03, -0.02, 0.01])


def _box_distance(points: np.ndarray, center: tuple[float, ...], sides: tuple[float, ...]):
    """Signed distance from a box along the axes, in closed form."""
    q = np.abs(points - center) - 0.5 * np.array(sides)
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
    return outside + np.minimum(q.max(axis=1), 0.0)


def test_signed_distances_of_boxes_are_those_of_the_closed_form() -> None:
    points = np.random.default_rng(3).uniform(-0.4, 0.4, (500, 3))
    expected = np.stack(
        [
            _box_distance(points, (0.2, 0.0, 0.05), SIDES),
            _box_distance(points, (-0.15, 0.0, 0.1), (0.02, 0.4, 0.2)),
        ],
        axis=1,
    )
    np.testing.assert_allclose(BESIDE.distances(points), expected, atol=1e-12)
    np.testing.assert_array_equal(BESIDE.contain(points), (expected < 0.0).any(axis=1))


def test_the_text_of_bodies_is_a_line_of_their_names_and_kinds() -> None:
    assert repr(BESIDE) == "Surroundings(crate: free box, wall: fixed box)"
    tray = replace(WALL, name="tray", geometries=(*WALL.geometries, *CRATE.geometries))
    assert repr(Surroundings((tray,))) == "Surroundings(tray: fixed 2 x box)"
    assert repr(ALONE) == "Surroundings(alone)"


def test_a_free_box_has_the_inertia_of_a_box() -> None:
    assert CRATE.inertial is not None
    a, b, c = SIDES
    expected = 0.3 / 12.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    np.testing.assert_allclose(np.diag(CRATE.inertial.inertia_L), expected)
    assert WALL.is_fixed
    assert not CRATE.is_fixed
    assert BESIDE.free == (CRATE,)


def test_distances_do_not_depend_on_the_frame() -> None:
    points = np.random.default_rng(4).uniform(-0.3, 0.3, (100, 3))
    in_F = BESIDE.in_frame(X_EF)
    points_F = apply_pose(inverse_pose(X_EF), points)
    np.testing.assert_allclose(in_F.distances(points_F), BESIDE.distances(points), atol=1e-12)
    back = in_F.in_frame(inverse_pose(X_EF))
    for body, same in zip(BESIDE, back, strict=True):
        np.testing.assert_allclose(body.X_EB, same.X_EB, atol=1e-15)


def test_the_mesh_of_all_bodies_is_theirs() -> None:
    assert ALONE.mesh is None
    assert BESIDE.mesh is not None
    assert BESIDE.mesh.volume == pytest.approx(np.prod(SIDES) + 0.02 * 0.4 * 0.2)
    moved = BESIDE.placed({"crate": np.eye(4)})
    np.testing.assert_allclose(moved.bodies[0].mesh.bounds.mean(axis=0), 0.0, atol=1e-15)
    assert moved.bodies[1] is WALL


def test_a_point_is_of_the_nearest_body_within_the_band() -> None:
    points = np.array([[0.165, 0.0, 0.05], [-0.139, 0.0, 0.1], [0.0, 0.0, 0.05]])
    assert BESIDE.whose(points, band=0.002) == [None, "wall", None]
    assert BESIDE.whose(points, band=0.006) == ["crate", "wall", None]
    assert ALONE.whose(points, band=1.0) == [None, None, None]


def test_an_open_mesh_has_distances_and_no_inside() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    open_box = trimesh.Trimesh(box.vertices, box.faces[:-2])
    body = Body.of_mesh("crate", open_box)
    assert body.distances(np.zeros((1, 3)))[0] == pytest.approx(0.05)


def test_a_scenario_with_bodies_goes_to_other_processes() -> None:
    task = Task.of("box", hand="wsg50", known=True, world=BESIDE)
    scenario = Scenario.from_config(task)
    points = np.zeros((1, 3))
    expected = scenario.truth.surroundings.distances(points)
    assert scenario.agent.known_bodies is not None
    np.testing.assert_array_equal(
        scenario.agent.known_bodies.distances(points), expected.min(axis=1)
    )
    pushed = Disturbance(contacts={"crate": 1}, forces={"crate": 0.3}, poses={"crate": np.eye(4)})
    scenario = replace(scenario, truth=replace(scenario.truth, disturbance=pushed))
    there = pickle.loads(pickle.dumps(scenario))  # noqa: S301 -- our own bytes
    np.testing.assert_array_equal(there.truth.surroundings.distances(points), expected)
    assert pushed.equals(there.truth.disturbance)


def test_two_bodies_of_one_name_are_refused() -> None:
    with pytest.raises(InvalidOptionError) as raised:
        Surroundings((WALL, WALL))
    assert raised.value.option == "world"
    assert "wall" in str(raised.value)
