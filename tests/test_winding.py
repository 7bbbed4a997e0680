import numpy as np
import pytest
import trimesh

from lis_grasp.winding import any_inside, winding_number


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
