"""A depth image of an object: its contacts, and the space that it shows to be free."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidViewError
from lis_grasp.geometry import apply_inverse, inverse_pose, require_pose, unit
from lis_grasp.records import ByValue, Record, read_only
from lis_grasp.typing import BoolArray, FloatArray
from lis_grasp.views._free_space import SeenFreeSpace
from lis_grasp.views._local_planes import ImageNoise, LocalPlanes, fit_local_planes
from lis_grasp.views.camera import HandEye, Intrinsics
from lis_grasp.views.contour import contour_guesses
from lis_grasp.views.depth_noise import DepthNoise

# Neighbours whose depths differ by more are not on one surface: metres, and deviations.
_JUMP, _JUMP_DEVIATIONS = 0.012, 8.0
# A pixel farther from its plane is between two surfaces [deviations].
_OFF_PLANE = 4.0
# A surface that faces the camera less, as a cosine, is too oblique to measure.
_LEAST_FACING = 0.25
# Errors of places, with those at edges, over the noise of planes.
_AT_EDGES = 1.15
# Pixels that contacts are made of: more say nothing new, because the noise of neighbours is alike.
_MOST_PIXELS = 2500
# Least deviation of a normal [rad]: planes in an image have curvature.
_LEAST_NORMAL_NOISE = 0.02


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class DepthView(ByValue, Record):
    """A depth image, with the camera's intrinsics and pose, and the pixels of one object.

    Parameters
    ----------
    depth
        Shape (H, W) [m], along the optical axis: NaN or 0 where it is unknown (a hole), inf beyond
        the camera's far limit.
    intrinsics
        Of the camera; the centre of the first pixel is at u = v = 0.
    X_WC
        Pose (4, 4) of the camera in the frame of the contacts: x to the right of the image, y down,
        z forward.
    mask
        Shape (H, W), the object's pixels. None: to be found (`segment_object`).
    noise
        Of the depth.
    hand_eye
        Prior of the error of `X_WC`.

    Raises
    ------
    InvalidViewError
        If a shape is wrong, a depth is negative, or most depths are in millimetres.
    InvalidOptionError
        If the pose is no rigid transform.
    """

    depth: FloatArray
    intrinsics: Intrinsics
    X_WC: FloatArray
    mask: BoolArray | None = None
    noise: DepthNoise = field(default_factory=DepthNoise)
    hand_eye: HandEye = field(default_factory=lambda: HandEye(0.0, 0.0))

    def __post_init__(self) -> None:
        depth = _checked_depth(self.depth)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "X_WC", require_pose("X_WC", self.X_WC))
        if self.mask is not None:
            object.__setattr__(self, "mask", _checked_mask(self.mask, depth.shape))

    def __repr__(self) -> str:
        height, width = self.depth.shape
        pixels = "no mask" if self.mask is None else f"{np.count_nonzero(self.mask)} of the object"
        return f"DepthView({width} x {height} pixels, {pixels})"

    def with_mask(self, mask: npt.ArrayLike) -> DepthView:
        """Return the view with the pixels of an object, (H, W)."""
        return replace(self, mask=np.asarray(mask))

    def in_frame(self, X_WF: npt.ArrayLike) -> DepthView:
        """Return the view with contacts in a frame F with pose X_WF (4, 4) in this one."""
        return self.posed(inverse_pose(X_WF) @ self.X_WC)

    @property
    def object_mask(self) -> BoolArray:
        """The object's pixels (H, W). Raises `InvalidViewError` if they are to be found."""
        if self.mask is None:
            raise InvalidViewError(
                "the view has no mask: give the object's pixels, or find them above the table with"
                " segment_object(view, support_height)",
                field="mask",
            )
        return self.mask

    @cached_property
    def contacts(self) -> Contacts:
        """All usable pixels of the object as contacts in W, with their noise.

        A pixel is used if it is no border of the mask, no step in depth, and on a plane with its
        neighbours that faces the camera. The noise is that of the plane: it has the part of the
        camera's noise that neighbouring pixels have in common.
        """
        return self.contacts_in_camera.in_frame(inverse_pose(self.X_WC))

    @cached_property
    def contacts_in_camera(self) -> Contacts:
        """The contacts in the camera's frame C, on the rays of their pixels."""
        rows, columns = np.nonzero(self._usable)
        if not len(rows):
            return Contacts.empty()
        inverse = np.where(self._usable, 1.0 / self.depth, np.nan)
        stride = int(np.ceil(np.sqrt(len(rows) / _MOST_PIXELS)))
        grid = (rows % stride == 0) & (columns % stride == 0)
        rows, columns = rows[grid], columns[grid]
        noise = ImageNoise(self.noise.rough, self.noise.correlated_pixels, self.intrinsics.fx)
        planes = fit_local_planes(inverse, rows, columns, noise)
        return self._contacts_of(planes, self.intrinsics.rays_at(columns, rows))

    def posed(self, X_WC: FloatArray) -> DepthView:
        """Return the view with another pose of its camera (4, 4)."""
        moved = replace(self, X_WC=X_WC)
        for name in ("contacts_in_camera", "_usable", "_free_in_camera"):
            if name in self.__dict__:  # they do not depend on the pose
                moved.__dict__[name] = self.__dict__[name]
        return moved

    def guesses(self, support_height: float) -> Contacts:
        """Return what the object's occluding contour implies of the surface that is not seen.

        They are weak contacts, with their own noise: never measurements, never to be saved with
        them. `support_height` [m] is the height of the table in W.
        """
        return contour_guesses(self, support_height)

    def depths(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return how deep points (P, 3) [m] are in space that is seen to be free.

        Returns the depths (P,) [m], below 0 outside of it and -inf where the space is not known to
        be free, and their slopes (P, 3).
        """
        return self._free.depths(np.asarray(points, np.float64))

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Return column, row [px] and depth [m] of points (P, 3) in W, shape (P, 3)."""
        return self.intrinsics.project(apply_inverse(self.X_WC, np.asarray(points, np.float64)))

    @cached_property
    def unknown(self) -> BoolArray:
        """Holes of the depth image, (H, W)."""
        return np.isnan(self.depth)

    @cached_property
    def _free(self) -> SeenFreeSpace:
        return replace(self._free_in_camera, X_WC=self.X_WC)

    @cached_property
    def _free_in_camera(self) -> SeenFreeSpace:
        return SeenFreeSpace.of(
            self.depth, self.object_mask, self.intrinsics, np.eye(4), self.noise.deviation
        )

    @cached_property
    def _usable(self) -> BoolArray:
        """Pixels of the object that show one surface, (H, W)."""
        known = np.isfinite(self.depth)
        near = ndimage.minimum_filter(np.where(known, self.depth, np.inf), 3)
        far = ndimage.maximum_filter(np.where(known, self.depth, -np.inf), 3)
        jump = _JUMP + _JUMP_DEVIATIONS * self.noise.deviation(np.where(known, self.depth, 0.0))
        with np.errstate(invalid="ignore"):
            smooth = far - near < jump
        return np.asarray(ndimage.binary_erosion(self.object_mask) & known & smooth)

    def _contacts_of(self, planes: LocalPlanes, rays: FloatArray) -> Contacts:
        """Return the contacts in C where planes meet rays (N, 3)."""
        normals, normal_noise = _normals_of(planes, rays, self.intrinsics, self.noise)
        depths = 1.0 / planes.values
        points = depths[:, None] * rays
        across = -np.einsum("nk,nk->n", normals, rays)  # depth along the normal, of depth 1
        facing = across / np.linalg.norm(rays, axis=1)
        rough = np.minimum(planes.covariances[:, 0, 0], self.noise.rough**2)
        inverse_noise = np.sqrt(rough + self.noise.smooth**2)
        position_noise = _AT_EDGES * inverse_noise * depths**2 * across
        tolerated = _OFF_PLANE * np.maximum(self.noise.rough, 1e-4 * planes.values)
        good = planes.found & (facing > _LEAST_FACING) & (np.abs(planes.residuals) < tolerated)
        good &= planes.values > 0.0
        return Contacts(
            points[good],
            normals[good],
            position_noise=position_noise[good],
            normal_noise=normal_noise[good],
        )


def _normals_of(
    planes: LocalPlanes, rays: FloatArray, camera: Intrinsics, noise: DepthNoise
) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (N, 3) in C towards the camera, and their noise (N,) [rad]."""
    # 1 / z = g . (x, y, 1) at the direction (x, y, 1), with g along the inward normal.
    focal = np.array([camera.fx, camera.fy])
    g = np.empty((len(rays), 3))
    g[:, :2] = planes.slopes * focal
    g[:, 2] = planes.values - np.einsum("nk,nk->n", g[:, :2], rays[:, :2])
    lengths = np.linalg.norm(g, axis=1)
    normals = -unit(g, least=float(np.finfo(np.float64).tiny))
    # Of values and slopes to g, (N, 3, 3).
    turn = np.zeros((len(rays), 3, 3))
    turn[:, 0, 1], turn[:, 1, 2] = camera.fx, camera.fy
    turn[:, 2, 0], turn[:, 2, 1:] = 1.0, -rays[:, :2] * focal
    smooth = noise.smooth**2 * np.array([1.0, *[0.5 / noise.smooth_length**2] * 2])
    covariance = planes.covariances.copy()
    covariance[:, np.arange(3), np.arange(3)] += smooth
    covariance = turn @ covariance @ turn.transpose(0, 2, 1)
    trace = np.trace(covariance, axis1=1, axis2=2)
    along = np.einsum("ni,nij,nj->n", normals, covariance, normals)
    deviations = np.sqrt(np.maximum(trace - along, 0.0) / 2.0) / lengths
    return normals, np.hypot(deviations, _LEAST_NORMAL_NOISE)


def _checked_depth(depth: npt.ArrayLike) -> FloatArray:
    image = np.array(depth, dtype=np.float64)
    if image.ndim != 2 or min(image.shape) < 3:
        raise InvalidViewError(
            f"depth must be an image of rows and columns (H, W); its shape is {image.shape}",
            field="depth",
        )
    image[image == 0.0] = np.nan
    if (image < 0.0).any():
        raise InvalidViewError(
            f"depth must be positive, along the optical axis; the least is {np.nanmin(image):.4g}",
            field="depth",
        )
    return read_only(image)


def _checked_mask(mask: npt.ArrayLike, shape: tuple[int, ...]) -> BoolArray:
    pixels = np.array(mask, dtype=bool)
    if pixels.shape != shape:
        raise InvalidViewError(
            f"mask must have the shape of the depth image, {shape}; it has {pixels.shape}",
            field="mask",
        )
    return read_only(pixels)
