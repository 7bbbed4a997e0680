"""Depth cameras: intrinsics, poses that look at an object, and errors of the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from lis_grasp.exceptions import require_at_least, require_positive
from lis_grasp.geometry import cross, make_pose, unit
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray

# Poses of simulated cameras: distance [m], elevation [deg], how far beside the object they aim [m].
_DISTANCE, _ELEVATION, _BESIDE = (0.45, 0.6), (30.0, 60.0), 0.02


@dataclass(frozen=True, slots=True)
class Intrinsics(Record):
    """Focal lengths and principal point of a camera without distortion [px].

    The centre of the pixel in row 0 and column 0 is at u = v = 0, as in ROS, OpenCV, and Drake's
    `DepthImageToPointCloud`. A program whose pixel centres are at 0.5, as Drake's `RgbdSensor`, has
    a principal point that is larger by 0.5.

    >>> Intrinsics(385.0, 385.0, 319.5, 239.5).rays((480, 640)).shape
    (480, 640, 3)
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        require_positive(fx=self.fx, fy=self.fy)
        require_at_least(-1e6, cx=self.cx, cy=self.cy)

    def rays(self, shape: tuple[int, int]) -> FloatArray:
        """Return the directions of all pixels, with depth 1, (H, W, 3), in the camera's frame C."""
        v, u = np.mgrid[: shape[0], : shape[1]]
        return self.rays_at(u, v)

    def rays_at(self, u: npt.ArrayLike, v: npt.ArrayLike) -> FloatArray:
        """Return the directions, with depth 1, (..., 3), of columns u and rows v (...), in C."""
        x, y = (np.asarray(u) - self.cx) / self.fx, (np.asarray(v) - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def project(self, points: FloatArray) -> FloatArray:
        """Return column, row and depth (..., 3) of points (..., 3) in C in front of the camera."""
        z = points[..., 2]
        return np.stack(
            [
                self.fx * points[..., 0] / z + self.cx,
                self.fy * points[..., 1] / z + self.cy,
                z,
            ],
            axis=-1,
        )


@dataclass(frozen=True, slots=True)
class HandEye(Record):
    """Prior of the error of a camera's pose in the hand's frame: root mean squares of its size.

    >>> HandEye(position=0.002, rotation=0.0087).is_exact
    False
    """

    position: float  #: root mean square distance between true and given place [m]
    rotation: float  #: root mean square angle between true and given orientation [rad]

    def __post_init__(self) -> None:
        require_at_least(0.0, position=self.position, rotation=self.rotation)

    @property
    def is_exact(self) -> bool:
        """Whether there is no error."""
        return self.position == 0.0 and self.rotation == 0.0

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (6,) of a rotation vector [rad] and a translation [m] in C."""
        return np.repeat([self.rotation, self.position], 3) / np.sqrt(3.0)

    def draw(self, *, rng: np.random.Generator) -> FloatArray:
        """Return a pose (4, 4) of the true camera in the given one."""
        return small_motion(self.deviations * rng.standard_normal(6))


def small_motion(parameters: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a rotation vector [rad] and a translation [m], (6,)."""
    return make_pose(Rotation.from_rotvec(parameters[:3]).as_matrix(), parameters[3:])


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike) -> FloatArray:
    """Return the pose (4, 4) of a camera at `eye` (3,) [m] that looks at `target`, with z upward.

    >>> look_at([0.5, 0.0, 0.0], [0.0, 0.0, 0.0])[:3, 2]
    array([-1.,  0.,  0.])
    """
    place = np.asarray(eye, np.float64)
    z = unit(np.asarray(target, np.float64) - place)
    upward = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    x = unit(cross(z, upward))
    return make_pose(np.column_stack([x, cross(z, x), z]), place)


def draw_camera_pose(center: npt.ArrayLike, *, rng: np.random.Generator) -> FloatArray:
    """Return the pose X_WC (4, 4) of a camera that looks near a place `center` (3,) [m].

    It is 0.45 to 0.6 m away, 30 to 60 degrees above, at any azimuth.
    """
    middle = np.asarray(center, np.float64)
    distance = rng.uniform(*_DISTANCE)
    elevation, azimuth = np.deg2rad(rng.uniform(*_ELEVATION)), rng.uniform(0.0, 2.0 * np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    direction = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
    beside = _BESIDE * unit(rng.standard_normal(3))
    return look_at(middle + distance * direction, middle + beside)
