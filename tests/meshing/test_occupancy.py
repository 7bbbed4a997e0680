"""Which nodes of a coarse grid are inside, against the function at every node."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_surfaces import Analytic, Function, box, cube_bounds, sphere, torus, union

from lis_grasp.meshing.occupancy import occupied_nodes

CELL = 0.1 / 24


def _tilted_sheet(points: np.ndarray) -> np.ndarray:
    """Return the function of a square sheet as thick as a cell, oblique to the grid."""
    R = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    return box((0.04, 0.04, 0.5 * CELL), R)(points)


SHAPES: dict[str, Function] = {
    "sphere": sphere(0.045),
    "ring": torus(0.035, 0.01),
    "two bars": union(box((0.05, 0.006, 0.006)), box((0.006, 0.05, 0.006))),
    "sheet": _tilted_sheet,
}


@pytest.mark.parametrize("name", SHAPES)
def test_nodes_are_inside_where_the_function_is_negative(name: str) -> None:
    surface = Analytic(SHAPES[name], cube_bounds(0.07))
    lowest, inside = occupied_nodes(surface, surface.bounds, CELL)
    evaluated = sum(surface.asked)
    nodes = lowest + CELL * np.moveaxis(np.indices(inside.shape), 0, -1)
    np.testing.assert_array_equal(inside, SHAPES[name](nodes) < 0.0)
    assert inside.any()
    assert evaluated < 0.5 * inside.size


def test_a_cavity_is_filled() -> None:
    def shell(points: np.ndarray) -> np.ndarray:
        return np.abs(sphere(0.03)(points)) - 0.01

    surface = Analytic(shell, cube_bounds(0.07))
    _, inside = occupied_nodes(surface, surface.bounds, CELL)
    assert inside[tuple(np.array(inside.shape) // 2)]
