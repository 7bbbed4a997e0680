"""Organised point clouds, with the rows and columns of a depth image, as views."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lis_grasp.exceptions import InvalidViewError
from lis_grasp.typing import FloatArray
from lis_grasp.views.camera import Intrinsics

# Half of the points are this near to the pixels of a camera without distortion [px].
_PIXELS_OFF = 0.5
# Least number of points that determine a camera.
_FEWEST = 30


# The camera in the frame of a cloud with z backward and y up, as in OpenGL.
_TURNED = np.diag([1.0, -1.0, -1.0, 1.0])


def depth_of_points(points: npt.ArrayLike) -> tuple[FloatArray, Intrinsics, FloatArray]:
    """Return the depth image (H, W) [m], the intrinsics and the camera of an organised cloud.

    The column of a pixel is linear in x / z, and its row in y / z: their least squares are the
    camera's focal lengths and principal point. The camera is a pose (4, 4) in the frame of the
    cloud: the identity, or a half turn about x.

    Parameters
    ----------
    points
        Shape (H, W, 3) [m], in the frame of the camera: z forward and y down, or z backward and
        y up; NaN where there is no depth.

    Raises
    ------
    InvalidViewError
        If the points are not those of the pixels of a camera.

    Examples
    --------
    >>> camera = Intrinsics(385.0, 380.0, 159.5, 119.5)
    >>> depth, found, _ = depth_of_points(0.5 * camera.rays((240, 320)))
    >>> bool(np.allclose(depth, 0.5)), [round(f, 6) for f in (found.fx, found.fy)]
    (True, [385.0, 380.0])
    """
    image = np.asarray(points, dtype=np.float64)
    if image.ndim != 3 or image.shape[2] != 3 or min(image.shape[:2]) < 3:
        raise InvalidViewError(
            f"an organised cloud must have rows and columns (H, W, 3); its shape is {image.shape}",
            field="points",
        )
    z, X_SC = image[..., 2], np.eye(4)
    if np.nanmedian(z) < 0.0:
        image, X_SC = image * np.diag(_TURNED)[:3], _TURNED
        z = image[..., 2]
    known = np.isfinite(image).all(axis=2) & (z != 0.0)
    v, u = np.nonzero(known)
    if len(v) < _FEWEST:
        raise InvalidViewError(f"the cloud has {len(v)} points: too few", field="points")
    x, y = (image[v, u, k] / z[v, u] for k in (0, 1))
    fx, cx, off_u = _line(x, u)
    fy, cy, off_v = _line(y, v)
    off = max(off_u, off_v)
    if off > _PIXELS_OFF or min(fx, fy) <= 0.0 or (z[v, u] < 0.0).any():
        raise InvalidViewError(
            f"half of the cloud's points are {off:.2g} pixels from their pixels: they must be in"
            " the frame of the camera, z forward, as the driver of the camera gives them",
            field="points",
        )
    return np.where(known, z, np.nan), Intrinsics(fx, fy, cx, cy), X_SC


def _line(values: FloatArray, pixels: npt.NDArray[np.intp]) -> tuple[float, float, float]:
    """Return slope and offset of pixels as a line of values (N,), and the median distance."""
    basis = np.column_stack([values, np.ones(len(values))])
    slope, offset = np.linalg.lstsq(basis, pixels.astype(np.float64), rcond=None)[0].tolist()
    return slope, offset, float(np.median(np.abs(pixels - slope * values - offset)))
