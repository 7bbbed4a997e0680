"""The occluding contour: what the border of a seen object implies of the side that is not seen.

Where depth jumps back at the border, the surface passes out of sight. Either it turned away there,
and its normal is known: it is across the line of sight and across the contour. Or there is an
edge, behind which a wall is assumed to fall to the table. How the surface faces the camera near the
contour is evidence for one or the other: a surface of radius r that turns away faces the camera
with an angle whose sine is 1 - s / r at a distance s from the contour, a face before an edge with
a constant angle. Both assumptions are made, each with its probability: their precision is
multiplied by it, as in an expected log-likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import ndimage

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import apply_pose, rotate, unit
from lis_grasp.surfaces.contact_places import farthest_point_order
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views.camera import Intrinsics

# Places on the contour at most.
_MOST = 40
# Smoothing of the mask's border [px].
_SMOOTHING = 3.0
# The background is looked up this far outside of the contour [px], and is farther by this [m].
_OUTSIDE, _STEP = (4, 6, 9), 0.015
# Where the facing of the surface is compared with both hypotheses: distances from the contour [px].
_SAMPLES = np.array([4.0, 6.0, 8.0, 11.0, 15.0, 20.0])
# Contacts are this near to each other at most [px].
_SPARSE = 4.0
# Deviation of a facing angle, with the shape's departure from both hypotheses [rad].
_ANGLE_NOISE = 0.1
# Radii of surfaces that turn away [m], and angles of faces before an edge.
_RADII = np.geomspace(0.003, 0.05, 12)
_ANGLES = np.deg2rad(np.linspace(0.0, 80.0, 12))
# Noise of what is implied: positions [m] and normals [rad] at the contour, and of a wall below it.
_AT_CONTOUR, _OF_WALL = (0.0015, 0.2), (0.004, 0.3)
# Heights of a wall's contacts as fractions of the way down; a part of a normal that is level.
_DOWN, _LEAST_LEVEL = (0.0, 0.5, 1.0), 0.3
# A hypothesis of less probability is left out.
_LEAST_PROBABILITY = 0.1


class SeenByCamera(Protocol):
    """What the contour is computed from; see `DepthView`."""

    @property
    def depth(self) -> FloatArray: ...  # noqa: D102
    @property
    def intrinsics(self) -> Intrinsics: ...  # noqa: D102
    @property
    def X_WC(self) -> FloatArray: ...  # noqa: D102
    @property
    def object_mask(self) -> BoolArray: ...  # noqa: D102
    @property
    def contacts_in_camera(self) -> Contacts: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """Places on the occluding contour of an object, M of them."""

    pixels: FloatArray  # (M, 2) columns and rows
    outward: FloatArray  # (M, 2), unit, in the image
    points: FloatArray  # (M, 3) [m] in W, as far away as the surface seen next to them
    turned: FloatArray  # (M, 3) [m] in W, where the surface is if it turned away
    normals: FloatArray  # (M, 3), unit, across the line of sight, in W
    turning: FloatArray  # (M,): probability that the surface turned away, instead of an edge


def contour_guesses(view: SeenByCamera, support_height: float) -> Contacts:
    """Return the weak contacts that an object's contour implies; see the module's text.

    `support_height` [m] is the height of the table in W.
    """
    found = occluding_contour(view)
    turned, edge = found.turning, 1.0 - found.turning
    level = found.normals * [1.0, 1.0, 0.0]
    lengths = np.linalg.norm(level, axis=1)
    walls = np.flatnonzero((edge > _LEAST_PROBABILITY) & (lengths > _LEAST_LEVEL))
    round_ = np.flatnonzero(turned > _LEAST_PROBABILITY)
    parts = [_weak(found.turned[round_], found.normals[round_], _AT_CONTOUR, turned[round_])]
    for fraction in _DOWN:
        feet = found.points[walls]
        feet[:, 2] = (1.0 - fraction) * feet[:, 2] + fraction * support_height
        noise = _AT_CONTOUR if fraction == 0.0 else _OF_WALL
        parts.append(_weak(feet, unit(level[walls]), noise, edge[walls]))
    return sum(parts[1:], parts[0])


def _weak(
    points: FloatArray, normals: FloatArray, noise: tuple[float, float], probability: FloatArray
) -> Contacts:
    wider = 1.0 / np.sqrt(probability)
    return Contacts(points, normals, position_noise=noise[0] * wider, normal_noise=noise[1] * wider)


def occluding_contour(view: SeenByCamera) -> Contour:
    """Return places where the object's border is in front of what is behind it."""
    mask, depth = view.object_mask, view.depth
    flat, space = np.empty((0, 2)), np.empty((0, 3))
    nothing = Contour(flat, flat, space, space, space, np.empty(0))
    if not len(view.contacts_in_camera):
        return nothing
    distance = ndimage.distance_transform_edt(mask) - ndimage.distance_transform_edt(~mask)
    smooth = ndimage.gaussian_filter(distance, _SMOOTHING)
    slope_v, slope_u = np.gradient(-smooth)
    inner = ndimage.binary_erosion(mask)
    v, u = np.nonzero(mask & ~inner)
    outward = np.column_stack([slope_u[v, u], slope_v[v, u]])
    outward = outward / np.maximum(np.linalg.norm(outward, axis=1), 1e-9)[:, None]
    seen, facing = _seen_images(view)
    away, nearest = ndimage.distance_transform_edt(~seen, return_indices=True)
    facing = np.where(away < _SPARSE, facing[nearest[0], nearest[1]], np.nan)
    at = depth[nearest[0][v, u], nearest[1][v, u]]
    kept = np.flatnonzero(_is_occluding(mask, depth, np.column_stack([u, v]), outward, at))
    if not len(kept):
        return nothing
    v, u, outward, at = v[kept], u[kept], outward[kept], at[kept]
    # The border itself is where the smooth distance is 0.
    pixels = np.column_stack([u, v]) + smooth[v, u][:, None] * outward
    rays = view.intrinsics.rays_at(pixels[:, 0], pixels[:, 1])
    chosen, _ = farthest_point_order(at[:, None] * rays, _MOST)
    pixels, outward, rays, at = pixels[chosen], outward[chosen], rays[chosen], at[chosen]
    inside = away[v, u][chosen] + 0.5  # [px]
    # The plane through the eye and the contour's tangent.
    camera = view.intrinsics
    across = outward * [camera.fx, camera.fy]
    normals = unit(np.column_stack([across, -np.einsum("nk,nk->n", across, rays[:, :2])]))
    turning, radius = _turning(pixels, outward, facing, at / camera.fx)
    # The nearest contact is before the contour by the height of a circle's cap.
    cap = np.minimum(inside * at / camera.fx, radius)
    behind = at + np.sqrt(cap * (2.0 * radius - cap))
    return Contour(
        pixels,
        outward,
        apply_pose(view.X_WC, at[:, None] * rays),
        apply_pose(view.X_WC, behind[:, None] * rays),
        rotate(view.X_WC, normals),
        turning,
    )


def _seen_images(view: SeenByCamera) -> tuple[BoolArray, FloatArray]:
    """Return which pixels have contacts, and the sine of the angle to the line of sight, (H, W)."""
    contacts = view.contacts_in_camera
    u, v, _ = np.round(view.intrinsics.project(contacts.points)).astype(np.intp).T
    cosine = -np.einsum("nk,nk->n", contacts.normals, unit(contacts.points))
    seen, angle = np.zeros(view.depth.shape, dtype=bool), np.full(view.depth.shape, np.nan)
    seen[v, u], angle[v, u] = True, np.arccos(np.clip(cosine, -1.0, 1.0))
    return seen, angle


def _is_occluding(
    mask: BoolArray, depth: FloatArray, pixels: FloatArray, outward: FloatArray, at: FloatArray
) -> BoolArray:
    """Return whether what is outside of border pixels (N, 2) is behind them, (N,)."""
    height, width = depth.shape
    behind: BoolArray = np.zeros(len(pixels), dtype=bool)
    for step in _OUTSIDE:
        place = np.round(pixels + step * outward).astype(np.intp)
        inside = np.all((place >= 0) & (place < [width, height]), axis=1)
        u, v = np.where(inside[:, None], place, 0).T
        behind |= inside & ~mask[v, u] & np.greater(depth[v, u], at + _STEP)
    return np.asarray(behind)


def _turning(
    pixels: FloatArray, outward: FloatArray, angle: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probability (M,) that the surface turned away, and its radius then (M,) [m].

    `angle` (H, W) is the angle between the normal and the line of sight, NaN where unknown; `size`
    (M,) [m] is that of a pixel on the object. Radii and angles are integrated over their grids.
    """
    place = pixels[:, None] - _SAMPLES[:, None] * outward[:, None]  # (M, S, 2)
    column, row = np.round(place).astype(np.intp).transpose(2, 0, 1)
    height, width = angle.shape
    seen = angle[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]  # (M, S)
    known: BoolArray = np.array(np.isfinite(seen))
    seen = np.where(known, seen, 0.0)
    distance = _SAMPLES * size[:, None]  # (M, S) [m]
    ratio = np.clip(1.0 - distance[:, None] / _RADII[:, None], 0.0, 1.0)  # (M, R, S)
    of_round, likely = _evidence(seen[:, None] - np.arcsin(ratio), known)
    of_edge, _ = _evidence(seen[:, None] - _ANGLES[:, None], known)
    probability = 1.0 / (1.0 + np.exp(np.clip(of_edge - of_round, -50.0, 50.0)))
    return np.asarray(probability), np.exp(likely @ np.log(_RADII))


def _evidence(residuals: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the log of the mean likelihood of residuals (M, G, S) over a grid, (M,).

    Returns the posterior of the grid's values, (M, G), too.
    """
    squares = np.where(known[:, None], (residuals / _ANGLE_NOISE) ** 2, 0.0).sum(axis=2)
    best = squares.min(axis=1)
    likelihoods = np.exp(-0.5 * (squares - best[:, None]))
    total = likelihoods.sum(axis=1)
    log_mean = np.log(total / likelihoods.shape[1]) - 0.5 * best
    return np.asarray(log_mean), likelihoods / total[:, None]
