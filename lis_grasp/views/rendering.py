"""Depth images of meshes without a display: an exact z-buffer in numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.geometry import apply_inverse, rotate
from lis_grasp.shapes.fragments import nearest_triangles, screen_planes
from lis_grasp.typing import FloatArray, IntArray
from lis_grasp.views.camera import Intrinsics

# What is nearer to a camera than this is not seen [m].
_NEAREST = 0.01


def render_depth(
    solids: Sequence[trimesh.Trimesh],
    intrinsics: Intrinsics,
    shape: tuple[int, int],
    X_WC: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """Return the depth along the axis of a camera (H, W) [m], and which solid each pixel shows.

    The depth is exact at pixel centres. It is inf, and the label -1, where there is no solid.

    >>> from lis_grasp.views import look_at
    >>> ball = trimesh.creation.icosphere(4, 0.05)
    >>> camera = Intrinsics(100.0, 100.0, 50.0, 50.0)
    >>> depth, label = render_depth([ball], camera, (101, 101), look_at([0.5, 0, 0], [0, 0, 0]))
    >>> round(depth[50, 50], 4), int(label[50, 50]), int(label[0, 0])
    (0.45, 0, -1)
    """
    corners = [np.empty((0, 3, 3))]
    owners = [np.empty(0, dtype=np.int64)]
    for index, solid in enumerate(solids):
        placed = clipped(apply_inverse(X_WC, np.asarray(solid.vertices))[solid.faces])
        corners.append(placed)
        owners.append(np.full(len(placed), index))
    triangles, owner = np.concatenate(corners), np.concatenate(owners)
    flat = intrinsics.project(triangles)
    flat[..., 2] = 1.0 / flat[..., 2]  # linear in the image, larger is nearer
    # Pixel centres of the z-buffer are at 0.5.
    nearest = nearest_triangles(flat + [0.5, 0.5, 0.0], (shape[1], shape[0]))
    planes = np.zeros((len(triangles) + 1, 3))  # the last for no triangle
    planes[:-1] = screen_planes(flat, flat[:, :, 2:])[:, :, 0]
    a, b, c = planes[nearest].transpose(2, 0, 1)
    with np.errstate(divide="ignore"):
        depth = 1.0 / (a * np.arange(shape[1]) + b * np.arange(shape[0])[:, None] + c)
    label = np.append(owner, -1)[nearest]
    return np.where(nearest >= 0, depth, np.inf), label


def plane_depth(
    intrinsics: Intrinsics, shape: tuple[int, int], X_WC: FloatArray, height: float
) -> FloatArray:
    """Return the depth (H, W) [m] of the plane z = `height` [m] in W; inf where it is not seen."""
    rays = rotate(X_WC, intrinsics.rays(shape))[..., 2]
    with np.errstate(divide="ignore"):
        depth = (height - X_WC[2, 3]) / rays
    return np.where((depth > _NEAREST) & np.isfinite(depth), depth, np.inf)


def clipped(triangles: FloatArray) -> FloatArray:
    """Return the parts of triangles (F, 3, 3) in C that are before a camera, as triangles.

    A triangle with one corner behind it becomes two, one with two corners behind it a smaller one
    (Sutherland and Hodgman 1974).
    """
    ahead = triangles[..., 2] > _NEAREST  # (F, 3)
    count = ahead.sum(axis=1)
    whole = triangles[count == 3]
    # The corner that differs from the other two comes first; the order of the corners stays.
    one = _rolled(triangles[count == 1], ahead[count == 1])
    two = _rolled(triangles[count == 2], ~ahead[count == 2])
    first, second = _cut(one[:, 0], one[:, 1]), _cut(one[:, 0], one[:, 2])
    tips = np.stack([one[:, 0], first, second], axis=1)
    left, right = _cut(two[:, 0], two[:, 1]), _cut(two[:, 0], two[:, 2])
    lower = np.stack([left, two[:, 1], two[:, 2]], axis=1)
    upper = np.stack([left, two[:, 2], right], axis=1)
    return np.concatenate([whole, tips, lower, upper])


def _rolled(triangles: FloatArray, is_first: npt.NDArray[np.bool_]) -> FloatArray:
    start = np.argmax(is_first, axis=1)
    order = (start[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles, order[:, :, None], axis=1)


def _cut(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return where edges from a to b, (F, 3), cross the nearest plane, (F, 3)."""
    fraction = (_NEAREST - a[:, 2]) / (b[:, 2] - a[:, 2])
    return np.asarray(a + fraction[:, None] * (b - a))
