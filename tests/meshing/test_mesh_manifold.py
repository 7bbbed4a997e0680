"""Meshes of functions at their worst: several sheets in one cell, noise, jumps, infinities."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from analytic_surfaces import Analytic, box, cube_bounds, union
from mesh_laws import fans, require_closed
from scipy.spatial.transform import Rotation

from lis_grasp.meshing import extract_mesh

BOUNDS = cube_bounds(0.15)


@pytest.mark.parametrize("gap", [0.05, 0.3, 0.9])
def test_two_sheets_in_one_cell_stay_two_sheets(gap: float) -> None:
    # Two blocks with less than a cell between them, cut by a plane that is not along the grid.
    cell = 0.005
    tilt = Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix()
    offset = tilt[:, 2] * (0.04 + 0.5 * gap * cell)
    half = np.array([0.05, 0.05, 0.04])
    blocks = union(box(half, tilt, offset), box(half, tilt, -offset))
    mesh = extract_mesh(Analytic(blocks, cube_bounds(0.13)), resolution=cell)
    require_closed(mesh)
    assert fans(mesh) == len(mesh.vertices)


@pytest.mark.by_default("0.2-0", "0.5-1", "0.8-2")
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("inside", [0.2, 0.5, 0.8])
def test_noise_makes_a_manifold(inside: float, seed: int) -> None:
    # Every node inside or outside by chance: every kind of cell, every ambiguity, and jumps.
    signs = np.random.default_rng(seed).uniform(-inside, 1.0 - inside, (12, 12, 12))

    def noise(p: npt.NDArray) -> npt.NDArray:
        x, y, z = np.moveaxis(np.clip(np.rint(p).astype(int), 0, 11), -1, 0)
        return signs[x, y, z]

    bounds = np.array([[0.0] * 3, [11.0] * 3]) + np.array([[-0.25], [0.25]])
    mesh = extract_mesh(Analytic(noise, bounds), resolution=1.0)
    require_closed(mesh)
    assert fans(mesh) == len(mesh.vertices)


def test_a_checkerboard_makes_a_manifold() -> None:
    def board(p: npt.NDArray) -> npt.NDArray:
        return np.where(np.rint(p).astype(int).sum(axis=-1) % 2 == 0, -1.0, np.inf)

    mesh = extract_mesh(Analytic(board, cube_bounds(5.25)), resolution=1.0)
    require_closed(mesh)
    assert fans(mesh) == len(mesh.vertices)


def test_a_jump_is_found_where_it_is() -> None:
    # Hardly inside, then very far outside: a secant step would hardly move.
    def cliff(p: npt.NDArray) -> npt.NDArray:
        return np.where(np.linalg.norm(p, axis=-1) < 0.1, -1e-3, 5.0)

    mesh = extract_mesh(Analytic(cliff, BOUNDS))
    require_closed(mesh)
    radii = np.linalg.norm(mesh.vertices, axis=1)
    # No normals: vertices are the crossings' means, up to 3 h^2 / 8 R inside; the crossings
    # themselves are bracketed to 1/16 of a cell and better.
    cell = 0.3 / 64
    assert radii.min() > 0.1 - 3.0 * cell**2 / 0.8 - cell / 16.0
    assert radii.max() < 0.1 + cell / 16.0


def test_infinite_values_are_signs() -> None:
    def shell(p: npt.NDArray) -> npt.NDArray:
        d = np.linalg.norm(p, axis=-1) - 0.1
        return np.where(d > 0.03, np.inf, np.where(d < -0.03, -np.inf, d))

    mesh = extract_mesh(Analytic(shell, BOUNDS))
    require_closed(mesh)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 0.1**3, rel=0.01)
