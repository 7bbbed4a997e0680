"""Depth images of meshes: against rays cast one by one, closed forms, and what is behind."""

import numpy as np
import pytest
import trimesh

from lis_grasp.geometry import rotate
from lis_grasp.views import Intrinsics, look_at, render_depth
from lis_grasp.views.rendering import plane_depth

CAMERA, SHAPE = Intrinsics(90.0, 95.0, 39.3, 29.8), (60, 80)


def _cast(mesh: trimesh.Trimesh, X_WC: np.ndarray) -> np.ndarray:
    """Return the depth by Moeller and Trumbore's intersection of each ray with each triangle."""
    rays = rotate(X_WC, CAMERA.rays(SHAPE)).reshape(-1, 1, 3)
    a, b, c = np.asarray(mesh.triangles).transpose(1, 0, 2)
    p, q, origin = b - a, c - a, X_WC[:3, 3] - a
    h = np.cross(rays, q)
    determinant = np.einsum("rtk,tk->rt", h, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("rtk,tk->rt", h, origin) / determinant
        v = np.einsum("tk,rk->rt", np.cross(origin, p), rays[:, 0]) / determinant
        t = np.einsum("tk,tk->t", np.cross(origin, p), q) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0.01)
    return np.where(hit, t, np.inf).min(axis=1).reshape(SHAPE)


@pytest.mark.by_default("0")
@pytest.mark.parametrize("seed", range(4))
def test_the_depth_is_that_of_rays_cast_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.box(rng.uniform(0.05, 0.1, 3)),
            trimesh.creation.icosphere(2, 0.03).apply_translation(rng.uniform(-0.05, 0.05, 3)),
        ]
    )
    X_WC = look_at(rng.uniform(-0.3, 0.3, 3) + [0.0, 0.0, 0.4], rng.uniform(-0.02, 0.02, 3))
    depth, label = render_depth([mesh], CAMERA, SHAPE, X_WC)
    cast = _cast(mesh, X_WC)
    assert np.array_equal(label == 0, np.isfinite(cast))  # no centre is on an edge
    seen = np.isfinite(cast)
    assert np.count_nonzero(seen) > 100
    # The nearest triangle is found in single precision: 1e-7 of a depth below 1 m, per pixel.
    assert np.abs(depth[seen] - cast[seen]).max() < 1e-6


def test_a_plane_that_passes_the_camera_is_cut_before_it() -> None:
    big = trimesh.Trimesh(
        [[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]],
        [[0, 1, 2], [0, 2, 3]],
    )
    X_WC = look_at([0.3, 0.1, 0.5], [0.0, 0.0, 0.2])
    depth, _ = render_depth([big], CAMERA, SHAPE, X_WC)
    exact = plane_depth(CAMERA, SHAPE, X_WC, 0.0)
    near = exact < 5.0  # the square ends
    assert np.count_nonzero(near) > 1000
    assert np.abs(depth[near] - exact[near]).max() < 1e-9 * 5.0**2 / 0.01
    points = X_WC[:3, 3] + depth[..., None] * rotate(X_WC, CAMERA.rays(SHAPE))
    assert np.abs(points[near][:, 2]).max() < 1e-5


def test_the_nearest_solid_has_the_label() -> None:
    near = trimesh.creation.box([0.02, 0.02, 0.02]).apply_translation([0.1, 0.0, 0.0])
    far = trimesh.creation.box([0.02, 0.2, 0.2])
    X_WC = look_at([0.5, 0.0, 0.0], [0.0, 0.0, 0.0])
    depth, label = render_depth([far, near], CAMERA, SHAPE, X_WC)
    assert set(np.unique(label)) == {-1, 0, 1}
    assert label[30, 39] == 1
    assert depth[30, 39] == pytest.approx(0.39, abs=1e-9)
    assert np.all(np.isinf(depth) == (label == -1))


def test_nothing_is_seen_behind_the_camera() -> None:
    behind = trimesh.creation.box([0.1, 0.1, 0.1]).apply_translation([1.0, 0.0, 0.0])
    _, label = render_depth([behind], CAMERA, SHAPE, look_at([0.5, 0.0, 0.0], [0.0, 0.0, 0.0]))
    assert (label == -1).all()
