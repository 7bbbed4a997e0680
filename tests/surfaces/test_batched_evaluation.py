"""Batches of points: octree blocks, patches at once, weights of pairs, active patches."""

from __future__ import annotations

import numpy as np
import pytest

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces import PatchImplicitSurface
from lis_grasp.surfaces._kernel_mean import KernelMean
from lis_grasp.surfaces._kernels import (
    Matern52,
    Matern72,
    SquaredExponential,
    ThinPlate,
)
from lis_grasp.surfaces._patch_csg import active_patches, solid_values
from lis_grasp.surfaces.queries import compact_blocks


@pytest.mark.parametrize("count", [0, 1, 256, 257, 3000])
@pytest.mark.parametrize("extent", [np.inf, 0.3])
def test_blocks_divide_the_points_and_are_compact(count: int, extent: float) -> None:
    points = np.random.default_rng(0).normal(size=(count, 3))
    blocks = list(compact_blocks(points, 1000, extent=extent))
    assert np.array_equal(np.sort(np.concatenate([np.empty(0, int), *blocks])), np.arange(count))
    for block in blocks:
        assert len(block) <= 1000
        # One cell in 2^10 of the cube's side more, by rounding to cells.
        limit = extent + np.ptp(points, axis=0).max() / 2**10
        assert len(block) <= 256 or np.ptp(points[block], axis=0).max() <= limit


def test_points_at_one_place_make_blocks_of_the_wanted_size() -> None:
    assert [len(block) for block in compact_blocks(np.ones((2500, 3)), 1000)] == [1000, 1000, 500]


@pytest.mark.parametrize(
    "kernel", [SquaredExponential(0.7), Matern52(0.7), Matern72(0.7), ThinPlate(5.0)]
)
def test_combined_kernels_equal_their_parts(
    kernel: SquaredExponential | Matern52 | ThinPlate,
) -> None:
    rng = np.random.default_rng(1)
    r, values, slopes = rng.uniform(0, 3, (6, 9)), rng.normal(size=(6, 1)), rng.normal(size=(6, 9))
    expected = values * kernel.value(r) + slopes * kernel.first(r)
    np.testing.assert_allclose(kernel.combined(r**2, values, slopes), expected, atol=1e-13)


def bumpy_contacts(count: int) -> Contacts:
    """Contacts of random normals on a ball: many patches."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(count, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1, keepdims=True)
    normals = 10.0 * points + 0.4 * rng.normal(size=(count, 3))
    return Contacts(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def test_patches_at_once_equal_patches_one_by_one() -> None:
    surface = PatchImplicitSurface.from_contacts(
        bumpy_contacts(40), position_noise=0.0, normal_noise=0.01
    )
    assert len(surface.patches) > 3
    # Far from the origin of the joined coordinates, too.
    queries = np.random.default_rng(3).uniform(-0.3, 0.3, (200, 3))
    expected = np.stack([patch.value(queries) for patch in surface.patches])
    np.testing.assert_allclose(surface.joined.values(queries), expected, rtol=1e-10, atol=1e-13)
    chosen = np.array([0, 2, len(surface.patches) - 1])
    np.testing.assert_allclose(
        surface.joined.some(chosen).values(queries), expected[chosen], rtol=1e-10, atol=1e-13
    )


def test_the_active_patch_has_the_solid_s_value_and_is_the_first_of_equal_ones() -> None:
    values = np.random.default_rng(4).integers(-2, 3, (5, 400)).astype(float)  # many ties
    expressions = [((0,),), ((1, 2), (0, 3)), ((2, 4), (1,), (0, 3, 4))]
    active = active_patches(expressions, values)
    for row, expression in enumerate(expressions):
        for column in range(values.shape[1]):
            heights = [max(values[p, column] for p in term) for term in expression]
            solid = min(heights)
            term = expression[heights.index(solid)]
            first = next(p for p in term if values[p, column] == solid)
            assert solid_values(expressions, values)[row, column] == solid
            assert active[row, column] == first


def test_weights_of_pairs_equal_those_of_all_nodes() -> None:
    rng = np.random.default_rng(5)
    nodes = rng.uniform(-1, 1, (300, 3))
    mean = KernelMean.of(nodes, 0.1, rng.uniform(0.2, 5.0, 300))
    points = 0.1 * rng.normal(size=(40, 3)) + [0.5, 0.5, 0.5]
    logs = mean.log_weights - 0.5 * ((points[:, None] - nodes) ** 2).sum(axis=2) / 0.1**2
    expected = np.exp(logs - logs.max(axis=1, keepdims=True))
    expected /= expected.sum(axis=1, keepdims=True)  # (P, N)
    node, point, weights = mean.sparse_weights(points)
    found = np.zeros_like(expected)
    found[point, node] = weights
    np.testing.assert_allclose(found, expected, atol=1e-12)  # terms below 1e-13 are left out
    near, dense = mean.weights(points)
    found = np.zeros_like(expected)
    found[:, near] = dense.T
    np.testing.assert_allclose(found, expected, atol=1e-12)
