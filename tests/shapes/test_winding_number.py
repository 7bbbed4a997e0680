"""Winding numbers against closed forms and a literal sum of solid angles."""

import numpy as np
import pytest
import reference
import trimesh
from random_directions import random_directions

from lis_grasp import shapes
from lis_grasp.shapes.mesh_distance import (
    InsideTest,
    any_inside,
    distances_to_mesh,
    winding_numbers,
)


def test_a_ball_winds_once_round_its_inside() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    directions = random_directions(60, np.random.default_rng(0))
    for radius, expected in ((0.9, 1.0), (1.1, 0.0)):
        found = winding_numbers(radius * directions, mesh.vertices, mesh.faces)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_cavity_is_outside() -> None:
    outer, inner = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    assert not any_inside(shell, np.zeros((1, 3)))
    assert any_inside(shell, np.array([[0.75, 0.0, 0.0]]))


def test_two_equal_boxes_wind_twice() -> None:
    box = trimesh.creation.box((2, 2, 2))
    faces = np.concatenate([box.faces, box.faces])
    found = winding_numbers(np.zeros((1, 3)), box.vertices, faces)
    np.testing.assert_allclose(found, 2.0, atol=1e-12)


def test_winding_numbers_are_sums_of_solid_angles() -> None:
    torn = shapes.build("pentagon").mesh.copy()
    torn.update_faces(np.arange(len(torn.faces)) % 9 > 0)
    points = np.random.default_rng(0).uniform(*torn.bounds, (4, 3))
    expected = [reference.winding_number(p, np.asarray(torn.triangles)) for p in points]
    # 4000 angles of rounding 1e-16.
    found = winding_numbers(points, torn.vertices, torn.faces)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.by_default("box", "pentagon")
@pytest.mark.parametrize("name", ["box", "mallet", "hollow_cylinder", "pentagon"])
def test_counting_faces_above_agrees_with_the_winding_number(name: str) -> None:
    mesh = shapes.build(name).mesh
    rng = np.random.default_rng(0)
    points = rng.uniform(*mesh.bounds, (60, 3))
    # Lines upward from half of the points meet corners and edges of the tessellation.
    points[30:, :2] = mesh.vertices[rng.integers(len(mesh.vertices), size=30), :2]
    points = points[distances_to_mesh(points, mesh)[0] > 1e-6]  # on the surface it is undefined
    assert len(points) > 30
    inside = winding_numbers(points, mesh.vertices, mesh.faces) > 0.5
    assert [any_inside(mesh, point[None]) for point in points] == inside.tolist()


def test_a_point_in_two_overlapping_boxes_is_inside() -> None:
    # The winding number is 2 in both boxes; the parity of a ray's crossings would be even.
    first, second = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((2, 2, 2))
    second.apply_translation([0.9, 0.8, 0.7])
    both = trimesh.util.concatenate([first, second])
    assert any_inside(both, np.array([[0.45, 0.41, 0.33]]))
    assert not any_inside(both, np.array([[-0.5, 1.5, 0.1]]))


def test_an_open_mesh_still_has_an_inside() -> None:
    box = trimesh.creation.box((2, 2, 2))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    assert any_inside(open_box, np.array([[0.1, 0.2, 0.3]]))


@pytest.mark.parametrize("name", ["box", "hollow_cylinder"])
def test_cells_of_a_grid_agree_with_the_winding_number(name: str) -> None:
    mesh = shapes.build(name).mesh
    rng = np.random.default_rng(1)
    low, high = mesh.bounds
    near = mesh.sample(300, seed=2) + rng.normal(scale=1e-4, size=(300, 3))
    points = np.vstack([rng.uniform(low - 0.01, high + 0.01, (700, 3)), near])
    inside = winding_numbers(points, mesh.vertices, mesh.faces) > 0.5
    assert 100 < inside.sum() < 900
    test = InsideTest(mesh)
    for part in (points, points[::-1][:5], points):  # a few, and again in cells that are known
        expected = winding_numbers(part, mesh.vertices, mesh.faces) > 0.5
        np.testing.assert_array_equal(test.inside(part), expected)
