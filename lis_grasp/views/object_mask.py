"""The pixels of an object: what stands on the table that a depth image shows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from lis_grasp.exceptions import InvalidViewError, NothingSeenError
from lis_grasp.geometry import apply_pose, rotate
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views.depth_view import DepthView

LOWEST = 0.003
"""What is lower above the table is not distinguished from it [m]."""

# The same in deviations.
_DEVIATIONS = 2.5
FEWEST = 30
"""An object, or a table, has so many pixels."""

# Of these, so many are clearly above the table, by this multiple.
_FEW, _CLEARLY = 10, 2.0
# The table is looked for this far from where the pose of the camera says [m].
_NEAR_TABLE = 0.04
# Rounds of the robust plane, and deviations of pixels on it.
_ROUNDS, _ON_TABLE = 10, 3.0


def segment_object(
    view: DepthView, support_height: float, bounds: npt.ArrayLike | None = None
) -> DepthView:
    """Return a view with the mask of the largest object that stands on the table.

    The table is the plane that the image shows near z = `support_height` in W: the error of the
    camera's pose is corrected for this only.

    Parameters
    ----------
    view
        A depth image; a mask that it has is replaced.
    support_height
        Height of the table in W [m].
    bounds
        Lowest and highest corner of where the object is in W, (2, 3) [m]; None for anywhere above
        the table.

    Raises
    ------
    NothingSeenError
        If nothing stands on the table: it may be too flat.
    InvalidViewError
        If the image shows no table there.
    """
    height, deviation = heights_above_table(view, support_height)
    least = np.maximum(LOWEST, _DEVIATIONS * deviation)
    with np.errstate(invalid="ignore"):
        above = height > least
    if bounds is not None:
        low, high = np.asarray(bounds, np.float64)
        rays = view.intrinsics.rays(view.depth.shape)
        with np.errstate(invalid="ignore"):  # depths beyond the range are infinite
            points = apply_pose(view.X_WC, view.depth[..., None] * rays)
            above &= ((points[..., :2] >= low[:2]) & (points[..., :2] <= high[:2])).all(axis=-1)
            above &= height <= high[2] - support_height
    parts, count = ndimage.label(above)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    with np.errstate(invalid="ignore"):
        clearly = np.bincount(parts[above & (height > _CLEARLY * least)], minlength=count + 1)
    sizes[clearly < _FEW] = 0  # noise
    sizes[0] = 0
    border = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    if bounds is None and len(np.setdiff1d(np.flatnonzero(sizes >= FEWEST), border)):
        sizes[border] = 0  # walls and other things that the image cuts
    if not count or sizes.max() < FEWEST:
        lowest = float(np.median(least))
        raise NothingSeenError(
            f"no object stands on the table at z = {support_height:g} m: it must be higher than"
            f" {1e3 * lowest:.1f} mm to be found; for a flatter one give its mask, else check the"
            " pose of the camera and the height of the table",
            height=lowest,
        )
    return view.with_mask(ndimage.binary_fill_holes(parts == np.argmax(sizes)))


def heights_above_table(view: DepthView, support_height: float) -> tuple[FloatArray, FloatArray]:
    """Return the heights of pixels above the table that the image shows, (H, W) [m].

    Returns their standard deviations, too, (H, W) [m]. Heights are NaN where there is no depth.
    """
    slopes, known, z = _slopes(view)
    fitted = table_in_image(view, support_height)
    # Between the table's depth on the same ray and the pixel's.
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = _smoothed(1.0 / z, known)
        height = -slopes * (1.0 / fitted - 1.0 / smooth)
        deviation = -slopes * view.noise.deviation(z)
    return np.where(known, height, np.nan), np.maximum(deviation, 0.0)


def table_in_image(view: DepthView, support_height: float) -> FloatArray:
    """Return the inverse depths (H, W) [1/m] of the table that the image shows near a height [m].

    Raises `InvalidViewError` if it shows none there.
    """
    slopes, known, z = _slopes(view)
    given = view.X_WC[2, 3] + z * slopes - support_height
    near = known & (np.abs(given) < _NEAR_TABLE)
    return _table(1.0 / z, near, view.noise.deviation(1.0))


def _slopes(view: DepthView) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return each pixel's change of height along its ray, whether it has a depth, and that.

    An unknown depth [m] is 1.
    """
    rays = view.intrinsics.rays(view.depth.shape)
    known = np.isfinite(view.depth)
    return rotate(view.X_WC, rays)[..., 2], known, np.where(known, view.depth, 1.0)


def _smoothed(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return the median of known values about each pixel, (H, W); robust against mixed pixels."""
    filled = np.where(known, values, 0.0)
    weights = ndimage.uniform_filter(known.astype(float), 3)
    means = ndimage.uniform_filter(filled, 3) / np.maximum(weights, 1e-9)
    return np.asarray(ndimage.median_filter(np.where(known, values, means), 3))


def _table(inverse: FloatArray, near: BoolArray, deviation: float) -> FloatArray:
    """Return the inverse depths (H, W) of the plane through most of such pixels."""
    rows, columns = np.nonzero(near)
    if len(rows) < FEWEST:
        raise InvalidViewError(
            f"the image shows no table at this height: {len(rows)} of its pixels are within"
            f" {1e3 * _NEAR_TABLE:.0f} mm of it; check the pose of the camera (of the camera in the"
            " frame of the table, z forward), the unit of depth and the height of the table",
            field="X_WC",
        )
    step = max(len(rows) // 20_000, 1)
    v, u = rows[::step], columns[::step]
    values, basis = inverse[v, u], np.column_stack([np.ones(len(v)), u, v])
    scale = _ON_TABLE * max(deviation, 1e-4)
    weights = np.ones(len(v))
    wide = 1.0 / np.arange(1, _ROUNDS + 1)
    for factor in wide / wide[-1]:  # from all pixels to those on the table
        plane = np.linalg.lstsq(basis * weights[:, None], values * weights, rcond=None)[0]
        weights = 1.0 / (1.0 + ((values - basis @ plane) / (factor * scale)) ** 2)
    height, width = inverse.shape
    return np.asarray(
        plane[0] + plane[1] * np.arange(width) + plane[2] * np.arange(height)[:, None]
    )
