"""Contacts of displaced pads follow from closed forms; uncertain surfaces have their moments."""

import numpy as np
import pytest
import trimesh

from lis_grasp.grasping.grasp_batch import GraspBatch
from lis_grasp.grasping.surface_uncertainty import PadContacts, UncertainSurface
from lis_grasp.robots.hand import Hand

ALLEGRO, WSG50 = Hand.load("allegro"), Hand.load("wsg50")
BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.04)


def _uncertain(deviations: np.ndarray) -> UncertainSurface:
    mesh = BALL.copy()
    mesh.vertex_attributes["uncertainty"] = deviations
    return UncertainSurface.from_mesh(mesh)


def _two_contacts(apart: float) -> tuple[np.ndarray, np.ndarray]:
    angles = np.array([0.0, 2.0 * np.arcsin(apart / 0.08)])
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(2)])
    return 0.04 * normals[None], normals[None]


def repeated(
    points: np.ndarray, normals: np.ndarray, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    return points[:, None].repeat(samples, axis=1), normals[:, None].repeat(samples, axis=1)


def test_contacts_move_along_their_normals_with_the_surfaces_deviation() -> None:
    surface = _uncertain(np.full(len(BALL.vertices), 0.002))
    points, normals = _two_contacts(0.08)
    moved, _ = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(0)
    )
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
    moved, _ = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(1)
    )
    along = ((moved[0] - points[0]) * normals[0]).sum(axis=-1)
    # exp(-d^2 / 2 l^2); a correlation of 4000 draws is known to 0.016.
    assert np.corrcoef(along.T)[0, 1] == pytest.approx(correlation, abs=0.05)


def test_normals_tilt_by_the_slope_of_the_error() -> None:
    surface = _uncertain(np.full(len(BALL.vertices), 0.0004))
    points, normals = _two_contacts(0.08)
    _, tilted = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(2)
    )
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
    _, tilted = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(4)
    )
    slopes = tilted[0, :, 0] / tilted[0, :, 0, :1]
    assert slopes[:, 2].std() == pytest.approx(0.1, rel=0.035)
    assert np.abs(slopes[:, 1]).max() < 1e-3


def test_normals_tilt_away_from_where_the_error_grows() -> None:
    # Where the surface is higher than estimated and the more so the higher z, its normal leans
    # towards lower z.
    surface = _uncertain(0.002 + 0.02 * BALL.vertices[:, 2])
    points, normals = np.array([[[0.04, 0.0, 0.0]]]), np.array([[[1.0, 0.0, 0.0]]])
    moved, tilted = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(5)
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
    moved, _ = surface.sample_contacts(
        *repeated(points, normals, 4000), rng=np.random.default_rng(6)
    )
    spread = (moved - points[:, None])[0, ..., 2].std(axis=0)
    np.testing.assert_allclose(spread, [0.001, 0.005], rtol=0.035)
    certain = UncertainSurface.from_mesh(BALL)
    points, normals = _two_contacts(0.08)
    moved, tilted = certain.sample_contacts(
        *repeated(points, normals, 3), rng=np.random.default_rng(3)
    )
    np.testing.assert_allclose(moved[0] - points[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(tilted[0] - normals[0], 0.0, atol=1e-15)


def _pads(
    hand: Hand, mesh: trimesh.Trimesh, point: np.ndarray, normal: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return contacts (S, 3), normals (S, 3) and touches (S,) of pad 0, which is off by (S, 3)."""
    pads = len(hand.pads)
    used = np.arange(pads)[None] == 0
    batch = GraspBatch(
        np.where(used[..., None], point, 0.0),
        np.where(used[..., None], normal, 0.0),
        used,
        np.eye(4)[None],
        np.zeros((1, len(hand.joint_names))),
    )
    everywhere = np.broadcast_to(off[:, None], (len(off), pads, 3))
    found = PadContacts.on(mesh, hand).close(batch, everywhere)
    return found[0][0, :, 0], found[1][0, :, 0], found[2][0, :, 0]


def test_a_ball_on_an_edge_gets_the_normal_that_ball_and_edge_have_there() -> None:
    radius = ALLEGRO.pads[0].radius
    box = trimesh.creation.box((0.06, 0.05, 0.04))
    # Planned on the side x = 30 mm, one millimetre below the edge at z = 20 mm.
    rise = np.array([-0.005, 0.0, 0.0009, 0.0015, 0.002, 0.001 + 0.8 * radius])
    off = np.column_stack([0.002 * np.ones(6), np.zeros(6), rise])
    points, normals, touches = _pads(
        ALLEGRO, box, np.array([0.03, 0.0, 0.019]), np.array([1.0, 0.0, 0.0]), off
    )
    assert touches.all()
    beyond = np.maximum(rise - 0.001, 0.0) / radius  # sine of the ball's elevation over the edge
    expected = np.column_stack([np.sqrt(1.0 - beyond**2), np.zeros(6), beyond])
    np.testing.assert_allclose(normals, expected, atol=1e-3)  # after four of Newton's steps
    np.testing.assert_allclose(points[:, 2], np.minimum(0.019 + rise, 0.02), atol=1e-9)
    _, _, misses = _pads(
        ALLEGRO,
        box,
        np.array([0.03, 0.0, 0.019]),
        np.array([1.0, 0.0, 0.0]),
        np.array([[0.0, 0.0, 0.001 + 1.05 * radius]]),
    )
    assert not misses.any()


def test_a_ball_on_a_ball_turns_its_normal_by_the_offset_over_both_radii() -> None:
    fine = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    off = np.column_stack([np.zeros(5), np.linspace(-0.004, 0.004, 5), np.zeros(5)])
    _, normals, _ = _pads(ALLEGRO, fine, np.array([0.04, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), off)
    expected = off[:, 1] / (0.04 + ALLEGRO.pads[0].radius)
    # Facets of the mesh are 1.2 mm wide: their normals differ by 0.03 from the sphere's.
    np.testing.assert_allclose(normals[:, 1], expected, atol=0.02)


def test_a_flat_pad_keeps_its_own_normal_on_an_edge() -> None:
    wedge = trimesh.creation.box((0.05, 0.05, 0.05))
    wedge.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4.0, [0.0, 0.0, 1.0]))
    tip = np.array([0.025 * np.sqrt(2.0), 0.0, 0.0])
    off = np.array([[0.0, 0.0, 0.0], [0.001, 0.002, 0.001], [0.0, -0.0055, 0.0]])
    points, normals, touches = _pads(WSG50, wedge, tip, np.array([1.0, 0.0, 0.0]), off)
    assert touches.all()
    np.testing.assert_allclose(normals, np.tile([1.0, 0.0, 0.0], (3, 1)), atol=1e-9)
    assert np.abs(points[:, 1]).max() < 0.002  # the pad's points are at most 4 mm apart
