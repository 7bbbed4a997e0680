"""Space that a depth image shows to be free: in front of what it sees, and beside the object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from lis_grasp.geometry import apply_inverse, rotate
from lis_grasp.records import Record
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views.camera import Intrinsics

# Points nearer to the camera are not judged [m].
_NEAREST = 0.01
# A hole this near to the object may be a part of it [px].
_NEAR_OBJECT = 6
# Free space ends so many deviations before what was seen.
_DEVIATIONS = 3.0
# Beyond the camera's far limit: free up to here [m].
_FAR = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class SeenFreeSpace(Record):
    """Depths in free space by one image lookup a point."""

    ends: FloatArray  # (H, W) [m]: free up to this depth along the axis; -inf for nothing
    blocked: BoolArray  # (H, W): the object, and holes that may be a part of it
    beside: FloatArray  # (H, W) [px]: distance to what is blocked
    intrinsics: Intrinsics
    X_WC: FloatArray

    @classmethod
    def of(
        cls,
        depth: FloatArray,
        mask: BoolArray,
        intrinsics: Intrinsics,
        X_WC: FloatArray,
        deviation: Callable[[FloatArray], FloatArray],
    ) -> SeenFreeSpace:
        """Return the free space of a depth image (H, W) with an object's mask (H, W)."""
        hole = np.isnan(depth)
        about = ndimage.binary_dilation(mask, iterations=_NEAR_OBJECT)
        # Beside a hole of the object, what is seen may be mixed with the background.
        unknown = hole | ndimage.binary_dilation(hole & about, np.ones((3, 3), bool))
        far = np.minimum(np.where(hole, _FAR, depth), _FAR)
        # A mixed pixel is behind the nearest surface about it.
        ends = ndimage.minimum_filter(far, 3)
        ends = np.where(unknown, -np.inf, ends - _DEVIATIONS * deviation(ends))
        blocked = mask | (unknown & about)
        beside = np.full(depth.shape, float(sum(depth.shape)))
        if blocked.any():
            beside = ndimage.distance_transform_edt(~blocked) - 1.0
        return cls(ends, blocked, beside, intrinsics, X_WC)

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the depths (P,) of points (P, 3) [m] in free space, and their slopes (P, 3)."""
        in_camera = apply_inverse(self.X_WC, points)
        z = in_camera[:, 2]
        height, width = self.ends.shape
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, _ = self.intrinsics.project(in_camera).T
            seen = (z > _NEAREST) & (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
        u, v = np.where(seen, u, 0.0), np.where(seen, v, 0.0)
        row, column = np.round(v).astype(np.intp), np.round(u).astype(np.intp)
        depths = np.where(seen, self.ends[row, column] - z, -np.inf)
        slopes = np.zeros((len(points), 3))
        slopes[:, 2] = -1.0
        outside = np.flatnonzero(seen & ~self.blocked[row, column] & np.isfinite(depths))
        value, along_u, along_v = _bilinear(self.beside, u[outside], v[outside])
        fx, fy = self.intrinsics.fx, self.intrinsics.fy
        sideways = value * z[outside] / fx
        nearer = sideways < depths[outside]
        chosen = outside[nearer]
        depths[chosen] = sideways[nearer]
        a, b = along_u[nearer], along_v[nearer] * fy / fx
        x, y, along = in_camera[chosen].T
        slopes[chosen] = np.column_stack([a, b, (value[nearer] / fx - (a * x + b * y) / along)])
        return depths, rotate(self.X_WC, slopes)


def _bilinear(
    image: FloatArray, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return values of an image at columns u and rows v (P,), and slopes along both, (P,)."""
    row = np.clip(np.floor(v).astype(np.intp), 0, image.shape[0] - 2)
    column = np.clip(np.floor(u).astype(np.intp), 0, image.shape[1] - 2)
    b, a = v - row, u - column
    p, q = image[row, column], image[row, column + 1]
    r, s = image[row + 1, column], image[row + 1, column + 1]
    along_u = (1.0 - b) * (q - p) + b * (s - r)
    along_v = (1.0 - a) * (r - p) + a * (s - q)
    return (1.0 - b) * ((1.0 - a) * p + a * q) + b * ((1.0 - a) * r + a * s), along_u, along_v
