"""Contacts of tactile patches: a ball and an edge pressed into a plane gel, by closed forms."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_directions import random_directions
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from lis_grasp import Contacts
from lis_grasp.cli.main import main
from lis_grasp.exceptions import InvalidFileError, InvalidOptionError
from lis_grasp.geometry import make_pose, tangent_frame
from lis_grasp.logs import PatchDetection, TactilePatches, contacts_from_patches

PITCH = np.array([6e-5, 5e-5])  # [m], of columns and rows: no square
ROWS, COLUMNS = np.mgrid[:200, :240]
X, Y = PITCH[0] * (COLUMNS - 119.5), PITCH[1] * (ROWS - 99.5)
RADIUS, DEPTH = 0.015, 1e-3
BALL = np.maximum(np.sqrt(RADIUS**2 - X**2 - Y**2) - (RADIUS - DEPTH), 0.0)
# A roof with slopes of 30 and 50 degrees; its edge is along y.
SLOPES = np.tan(np.deg2rad([30.0, 50.0]))
ROOF = np.maximum(1.5e-3 - np.where(X < 0.0, -SLOPES[0] * X, SLOPES[1] * X), 0.0)


def _poses(directions: np.ndarray) -> np.ndarray:
    """Return sensors that look at the origin along the directions, DEPTH into a ball there."""
    axes = np.concatenate([tangent_frame(directions), directions[:, None]], axis=1)
    return make_pose(np.swapaxes(axes, 1, 2), -(RADIUS - DEPTH) * directions)


def test_a_ball_is_where_it_was_pressed_from_every_side() -> None:
    poses = _poses(random_directions(6, np.random.default_rng(1)))
    made = contacts_from_patches(TactilePatches(np.repeat(BALL[None], 6, axis=0), poses, PITCH))
    # Quadrics of a sphere are off by their next terms, x^4 / 8 R^3 at the border of the window.
    assert_allclose(np.linalg.norm(made.points, axis=1), RADIUS, atol=1e-8)
    assert_allclose(made.normals, made.points / RADIUS, atol=1e-4)
    assert made.normal_noise is not None
    assert made.normal_noise.max() < 5 * PITCH.max() * 1.5 / RADIUS  # turns within a window
    one = contacts_from_patches(TactilePatches(BALL, np.eye(4), PITCH)).points
    assert len(one) > 10
    assert pdist(one).min() > 2e-3


def test_the_normal_is_uncertain_at_an_edge_and_sure_beside_it() -> None:
    pose = make_pose(Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), [0.1, 0.2, 0.3])
    made = contacts_from_patches(TactilePatches(ROOF, pose, PITCH), PatchDetection(spacing=1e-9))
    made = made.in_frame(pose)  # in S
    x, window = made.points[:, 0], 5 * PITCH[0]
    faces = np.array([[SLOPES[0], 0.0, 1.0], [-SLOPES[1], 0.0, 1.0]])
    faces /= -np.linalg.norm(faces, axis=1, keepdims=True)
    off = np.linalg.norm(made.normals - faces[(x > 0.0).astype(int)], axis=1)
    at_edge = np.abs(x) <= window
    assert made.normal_noise is not None
    assert np.abs(off[~at_edge]).max() < 1e-6
    assert made.normal_noise[~at_edge].max() < 1e-6
    assert made.normal_noise[np.abs(x) < PITCH[0]].min() > np.deg2rad(30.0)
    assert (off[at_edge] <= 1.5 * made.normal_noise[at_edge] + 1e-6).all()
    sparse = contacts_from_patches(TactilePatches(ROOF, np.eye(4), PITCH))
    assert len(sparse) < 50
    assert sparse.normal_noise is not None
    assert sparse.normal_noise.max() < 1e-6  # on the faces


@pytest.mark.slow
def test_the_noise_of_contacts_is_that_of_the_heights() -> None:
    rng, noise = np.random.default_rng(2), 1e-5
    flat = 1e-3 + 0.3 * X + noise * rng.normal(size=(4, *X.shape))
    poses = np.repeat(np.eye(4)[None], 4, axis=0)
    patches = TactilePatches(flat, poses, PITCH)
    made = contacts_from_patches(patches, PatchDetection(spacing=1e-9))
    assert made.position_noise is not None
    assert made.normal_noise is not None
    truth = np.array([-0.3, 0.0, -1.0]) / np.hypot(0.3, 1.0)
    across = np.cross(made.normals, truth) @ tangent_frame(truth).T  # (N, 2)
    # Scatter of 115 degrees of freedom: 7 %; its median over many windows is nearer.
    assert_allclose(made.position_noise, noise * -truth[2], rtol=0.1)
    stated = np.sqrt(np.mean(made.normal_noise**2))
    # Slopes along the tilt count less, and a curvature of noise is taken for one at times.
    assert np.sqrt(np.mean(across**2)) < stated < 1.7 * np.sqrt(np.mean(across**2))


@pytest.mark.parametrize(
    ("heights", "poses", "pitch", "word"),
    [
        (1e3 * BALL, np.eye(4), PITCH, "metres"),
        (BALL, np.eye(4), 1e5 * PITCH, "metres"),
        (-BALL, np.eye(4), PITCH, "sign"),
        (BALL, 2.0 * np.eye(4), PITCH, "rigid"),
        (BALL, np.eye(4)[None].repeat(2, axis=0), PITCH, "shapes"),
        (BALL, np.eye(4), 0.0, "above 0"),
        (np.full((9, 9), np.inf), np.eye(4), 1e-4, "metres"),
    ],
)
def test_implausible_patches_are_refused(
    heights: np.ndarray, poses: np.ndarray, pitch: np.ndarray, word: str
) -> None:
    with pytest.raises(InvalidOptionError, match=word):
        TactilePatches(heights, poses, pitch)


def test_the_verb_writes_contacts_of_patches_in_the_frame_of_the_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses, X_FO = _poses(random_directions(4, np.random.default_rng(3))), np.eye(4)
    X_FO[:3, 3] = 0.4, -0.1, 0.2
    path, half = tmp_path / "p.npz", BALL.astype(np.float32)
    unknown = np.where(BALL > 0.0, half, np.nan)
    np.savez(path, heights=np.stack([unknown] * 4), poses=X_FO @ poses, pitch=PITCH)
    arguments = ["--object-frame", "0.4", "-0.1", "0.2", "--spacing", "0.001"]
    assert main(["contacts", str(path), *arguments]) == 0
    made = Contacts.load(tmp_path / "contacts.ply")
    assert len(made) > 40
    assert_allclose(np.linalg.norm(made.points, axis=1), RADIUS, atol=1e-6)
    assert main(["contacts", str(path), "--indentation", "0.1"]) == 2
    assert "give a lower --indentation" in capsys.readouterr().err
    np.savez(path, heights=BALL)
    with pytest.raises(InvalidFileError) as error:
        TactilePatches.load(path)
    assert error.value.path == path
