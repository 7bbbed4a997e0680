"""Samples of an uncertain surface have the moments of its model."""

import numpy as np
import pytest
import trimesh

from lis_grasp.grasping.surface_uncertainty import UncertainSurface

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.04)


def _uncertain(deviations: np.ndarray) -> UncertainSurface:
    mesh = BALL.copy()
    mesh.vertex_attributes["uncertainty"] = deviations
    return UncertainSurface.from_mesh(mesh)


def _two_contacts(apart: float) -> tuple[np.ndarray, np.ndarray]:
    angles = np.array([0.0, 2.0 * np.arcsin(apart / 0.08)])
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(2)])
    return 0.04 * normals[None], normals[None]


def test_contacts_move_along_their_normals_with_the_surfaces_deviation() -> None:
    surface = _uncertain(np.full(len(BALL.vertices), 0.002))
    points, normals = _two_contacts(0.08)
    moved, _ = surface.sample_contacts(points, normals, samples=4000, rng=np.random.default_rng(0))
    off = moved[0] - points[0]
    along = (off * normals[0]).sum(axis=-1)
    np.testing.assert_allclose(off, along[..., None] * normals[0], atol=1e-15)
    # 4000 draws: a deviation within 1 / sqrt(8000), 1.1 %, at three of which a test may fail.
    np.testing.assert_allclose(along.std(axis=0), 0.002, rtol=0.035)
    np.testing.assert_allclose(along.mean(axis=0), 0.0, atol=3 * 0.002 / np.sqrt(4000))


@pytest.mark.parametrize(("apart", "correlation"), [(0.002, 0.995), (0.02, 0.607), (0.08, 0.0)])
def test_errors_are_correlated_over_a_quarter_of_the_object(
    apart: float, correlation: float
) -> None:
    surface = _uncertain(np.full(len(BALL.vertices), 0.002))
    assert surface.correlation_length == pytest.approx(0.02, rel=1e-3)
    points, normals = _two_contacts(apart)
    moved, _ = surface.sample_contacts(points, normals, samples=4000, rng=np.random.default_rng(1))
    along = ((moved[0] - points[0]) * normals[0]).sum(axis=-1)
    # exp(-d^2 / 2 l^2); a correlation of 4000 draws is known to 0.016.
    assert np.corrcoef(along.T)[0, 1] == pytest.approx(correlation, abs=0.05)


def test_normals_tilt_by_the_slope_of_the_error() -> None:
    surface = _uncertain(np.full(len(BALL.vertices), 0.0004))
    points, normals = _two_contacts(0.08)
    _, tilted = surface.sample_contacts(points, normals, samples=4000, rng=np.random.default_rng(2))
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=-1), 1.0, atol=1e-12)
    slopes = tilted[0] - (tilted[0] * normals[0]).sum(axis=-1, keepdims=True) * normals[0]
    # Deviation over correlation length, in each of two directions.
    per_direction = np.sqrt((slopes**2).sum(axis=-1).mean() / 2.0)
    assert per_direction == pytest.approx(0.0004 / 0.02, rel=0.03)


def test_normals_tilt_where_the_deviation_grows() -> None:
    # A deviation that rises along z by 0.1 m/m, and is as good as none where the contact is: all of
    # the slope is the field's own value times 0.1, and it tilts the normal about y alone.
    surface = _uncertain(0.1 * BALL.vertices[:, 2] + 1e-9)
    points, normals = np.array([[[0.04, 0.0, 0.0]]]), np.array([[[1.0, 0.0, 0.0]]])
    _, tilted = surface.sample_contacts(points, normals, samples=4000, rng=np.random.default_rng(4))
    slopes = tilted[0, :, 0] / tilted[0, :, 0, :1]
    assert slopes[:, 2].std() == pytest.approx(0.1, rel=0.035)
    assert np.abs(slopes[:, 1]).max() < 1e-3


def test_normals_tilt_away_from_where_the_error_grows() -> None:
    # Where the surface is higher than estimated and the more so the higher z, its normal leans
    # towards lower z.
    surface = _uncertain(0.002 + 0.02 * BALL.vertices[:, 2])
    points, normals = np.array([[[0.04, 0.0, 0.0]]]), np.array([[[1.0, 0.0, 0.0]]])
    moved, tilted = surface.sample_contacts(
        points, normals, samples=4000, rng=np.random.default_rng(5)
    )
    heights = (moved - points[:, None])[0, :, 0, 0] / 0.002
    lean = tilted[0, :, 0, 2] / tilted[0, :, 0, 0]
    # Least squares over 4000 draws; the other term of the slope is noise of 0.002 / 0.02.
    slope = float(heights @ lean / (heights @ heights))
    assert slope == pytest.approx(-0.02, abs=3.0 * 0.1 / np.sqrt(4000))


def test_deviations_are_those_of_the_nearest_vertex_and_zero_without_uncertainty() -> None:
    deviations = np.where(BALL.vertices[:, 2] > 0.0, 0.001, 0.005)
    surface = _uncertain(deviations)
    points, normals = (
        np.array([[[0.0, 0.0, 0.04], [0.0, 0.0, -0.04]]]),
        np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]),
    )
    moved, _ = surface.sample_contacts(points, normals, samples=4000, rng=np.random.default_rng(6))
    spread = (moved - points[:, None])[0, ..., 2].std(axis=0)
    np.testing.assert_allclose(spread, [0.001, 0.005], rtol=0.035)
    certain = UncertainSurface.from_mesh(BALL)
    points, normals = _two_contacts(0.08)
    moved, tilted = certain.sample_contacts(
        points, normals, samples=3, rng=np.random.default_rng(3)
    )
    np.testing.assert_allclose(moved[0] - points[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(tilted[0] - normals[0], 0.0, atol=1e-15)
