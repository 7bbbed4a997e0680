import numpy as np
import pytest
import trimesh

from lis_grasp import shapes
from lis_grasp.evaluation.mesh_distance import distances_to_mesh
from lis_grasp.shapes.winding_number import any_inside, winding_number


@pytest.mark.parametrize("seed", range(3))
def test_points_of_a_ball_and_of_nowhere_near_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for d in directions:
        assert winding_number(0.9 * d, mesh.triangles) == pytest.approx(1.0, abs=1e-9)
        assert winding_number(1.1 * d, mesh.triangles) == pytest.approx(0.0, abs=1e-9)


def test_a_cavity_is_outside() -> None:
    outer, inner = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    assert not any_inside(shell, np.zeros((1, 3)))
    assert any_inside(shell, np.array([[0.75, 0.0, 0.0]]))


def test_two_sheets_wind_twice() -> None:
    box = trimesh.creation.box((2, 2, 2))
    twice = np.concatenate([box.triangles, box.triangles])
    assert winding_number(np.zeros(3), twice) == pytest.approx(2.0, abs=1e-12)


@pytest.mark.parametrize("name", ["box", "mallet", "hollow_cylinder", "pentagon"])
def test_counting_faces_above_agrees_with_adding_up_angles(name: str) -> None:
    mesh = shapes.build(name).mesh
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    anywhere = rng.uniform(low, high, (60, 3))
    # Lines upward from these meet corners and edges of the tessellation.
    chosen = mesh.vertices[rng.integers(len(mesh.vertices), size=60)]
    below_corners = np.column_stack([chosen[:, :2], rng.uniform(low[2], high[2], 60)])
    points = np.vstack([anywhere, below_corners])
    off = distances_to_mesh(points, mesh)[0] > 1e-6  # what is on the surface is neither
    assert off.sum() > 60
    for point in points[off]:
        assert any_inside(mesh, point[None]) == (winding_number(point, mesh.triangles) > 0.5)


def test_sheets_that_overlap_are_inside() -> None:
    # Two boxes that share a part, each closed: there the number is 2, and a parity would be even.
    first, second = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((2, 2, 2))
    second.apply_translation([0.9, 0.8, 0.7])
    both = trimesh.util.concatenate([first, second])
    assert any_inside(both, np.array([[0.45, 0.41, 0.33]]))
    assert not any_inside(both, np.array([[-0.5, 1.5, 0.1]]))


def test_a_mesh_with_a_hole_is_judged_by_its_angles() -> None:
    box = trimesh.creation.box((2, 2, 2))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    assert any_inside(open_box, np.array([[0.1, 0.2, 0.3]]))
