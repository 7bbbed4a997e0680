"""Contacts of tactile patches: height maps of gel sensors (GelSight, DIGIT) and sensor poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_erosion, correlate
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import (
    InvalidFileError,
    InvalidInputError,
    InvalidOptionError,
    require_positive,
)
from lis_grasp.geometry import apply_pose, are_rigid, rotate, unit
from lis_grasp.io.limits import read_arrays
from lis_grasp.io.option import POSITIVE, option, record_of_options
from lis_grasp.logs._doubts import require_places
from lis_grasp.logs.reading import PATCHES
from lis_grasp.records import read_only
from lis_grasp.typing import BoolArray, FloatArray, IndexArray

_DEEPEST = 0.02  # [m]: largest indentation of a gel
_STEEPEST = 1.0  # largest median slope of a pressed gel
_HALF_WIDTH = 5  # [pixels] of a fit's square window
_SURE = 2.0  # standard deviations of a curvature beyond noise


@dataclass(frozen=True, slots=True, eq=False)
class TactilePatches:
    """Height maps of a gel sensor, and its poses.

    The sensor's frame S has its origin in the middle of the image on the gel at rest, x along the
    columns, y along the rows, and z out of the gel towards the object.

    Parameters
    ----------
    heights
        Shape (K, H, W) or (H, W): how far each pixel of the gel is pressed in [m], positive; NaN
        where it is unknown.
    poses
        Shape (K, 4, 4) or (4, 4): X_OS, of the sensor in the object's frame.
    pitch
        Distance between neighbouring pixels [m], or two: between columns and between rows.

    Raises
    ------
    InvalidOptionError
        If shapes disagree, a pose is not rigid, or a length is implausible.
    """

    heights: FloatArray
    poses: FloatArray
    pitch: npt.ArrayLike

    def __post_init__(self) -> None:
        heights, poses, pitch = (
            np.array(values, dtype=np.float64) for values in (self.heights, self.poses, self.pitch)
        )
        heights = heights[None] if heights.ndim == 2 else heights
        poses = poses[None] if poses.ndim == 2 else poses
        if heights.ndim != 3 or poses.shape != (len(heights), 4, 4) or pitch.size not in (1, 2):
            raise InvalidOptionError(
                "tactile patches are heights (K, H, W), poses (K, 4, 4) and a pitch or two; the"
                f" shapes are {heights.shape}, {poses.shape} and {pitch.shape}",
                option="heights",
            )
        if not are_rigid(poses):
            raise InvalidOptionError("poses must be rigid transforms X_OS", option="poses")
        pitch = np.broadcast_to(pitch.ravel(), 2)
        require_positive(**{"pitch of columns": pitch[0], "pitch of rows": pitch[1]})
        low, high = np.nanmin(heights, initial=0.0), np.nanmax(heights, initial=0.0)
        if max(high, -low, pitch.max()) > _DEEPEST:
            raise InvalidOptionError(
                f"heights and pitch must be in metres, at most {_DEEPEST:g}; they reach"
                f" {max(high, -low, pitch.max()):.3g}: multiply millimetres by 0.001, and depths in"
                " pixels by the metres of a pixel",
                option="heights",
            )
        if -low > high:
            raise InvalidOptionError(
                f"heights must be positive where the gel is pressed in; they are {low:.3g} to"
                f" {high:.3g} m: change their sign",
                option="heights",
            )
        for name, array in (("heights", heights), ("poses", poses), ("pitch", pitch)):
            object.__setattr__(self, name, read_only(np.array(array)))

    @classmethod
    def load(cls, path: Path | str) -> TactilePatches:
        """Read an .npz file with the arrays ``heights``, ``poses`` and ``pitch``.

        Raises `InvalidFileError` if the file is missing or damaged, lacks an array, or has
        implausible ones.
        """
        try:
            return cls(*read_arrays(Path(path), ("heights", "poses", "pitch")).values())
        except (InvalidOptionError, TypeError, ValueError) as error:
            raise InvalidFileError.of(Path(path), f"has no valid patches: {error}") from None


@record_of_options
class PatchDetection:
    """Which pixels of a patch become contacts; those on flat surface are taken first."""

    threshold: float = option(
        1e-4,
        "least indentation of a pixel that touches",
        PATCHES,
        metavar="METRES",
        check=POSITIVE,
    )
    spacing: float = option(2e-3, "distance of contacts", PATCHES, metavar="METRES", check=POSITIVE)
    position_noise: float | None = option(
        None,
        "standard deviation of the heights and of the sensor's position",
        PATCHES,
        metavar="METRES",
        words="the scatter of the heights",
        check=POSITIVE,
    )


def contacts_from_patches(
    patches: TactilePatches, detection: PatchDetection = PatchDetection()
) -> Contacts:
    """Return the contacts of tactile patches in O, each with its noise.

    A quadric is fitted to the heights in a window of 11 x 11 pixels that all touch (Savitzky and
    Golay 1964, in two dimensions). Its value and slopes in the middle give point and normal. The
    normal's standard deviation combines that of the slopes and its change from the middle of the
    window to the border: at an edge of the object the normal is uncertain.

    Examples
    --------
    A ball of radius 20 mm, pressed 1 mm into a gel that faces along +x:

    >>> import numpy as np
    >>> from lis_grasp.logs import TactilePatches, contacts_from_patches
    >>> y, x = 1e-4 * (np.mgrid[:120, :160] - [[[59.5]], [[79.5]]])
    >>> heights = np.maximum(np.sqrt(0.02**2 - x**2 - y**2) - 0.019, 0.0)
    >>> X_OS = np.array([[0, 0, 1, -0.019], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    >>> touched = contacts_from_patches(TactilePatches(heights, X_OS, 1e-4))
    >>> bool(np.allclose(np.linalg.norm(touched.points, axis=1), 0.02, atol=1e-6))
    True
    """
    pitch = np.asarray(patches.pitch)
    fits = [_fit(heights, pitch, detection) for heights in patches.heights]
    _require_gel(fits)
    scatter = [fit.scatter for fit in fits if len(fit.scatter)]
    noise = detection.position_noise
    if noise is None:
        noise = float(np.median(np.concatenate(scatter))) if scatter else 0.0
    contacts = Contacts.empty()
    for fit, X_OS in zip(fits, patches.poses, strict=True):
        contacts = contacts.append(fit.contacts(X_OS, noise, detection.spacing))
    require_places(contacts.points, "give the positions of the sensor's poses in metres")
    return contacts


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Quadrics about P pixels of one patch, in S."""

    points: FloatArray  # (P, 3) [m]
    slopes: FloatArray  # (P, 2)
    curvature: FloatArray  # (P,) [1/m]: Frobenius norm of the second derivatives
    scatter: FloatArray  # (P,) [m]: of the heights about the quadric
    slope_noise: float  # [1/m]: of the slopes, per standard deviation of a height
    curvature_noise: float  # [1/m^2]: likewise
    reach: float  # [m] from the middle of the window to its border

    def contacts(self, X_OS: FloatArray, noise: float, spacing: float) -> Contacts:
        """Return contacts at least `spacing` apart, those on flat surface first."""
        normals = unit(np.column_stack([-self.slopes, -np.ones(len(self.slopes))]))
        bent = self.curvature**2 - (_SURE * noise * self.curvature_noise) ** 2
        turn = self.reach * np.sqrt(np.maximum(bent, 0.0))
        # A slope s is an angle atan(s).
        to_angle = normals[:, 2] ** 2
        normal_noise = np.hypot(noise * self.slope_noise * to_angle, np.arctan(turn * to_angle))
        # Order by the turn alone: the noise of slopes must not decide.
        chosen = _apart(self.points, np.argsort(turn, kind="stable"), spacing)
        return Contacts(
            apply_pose(X_OS, self.points[chosen]),
            rotate(X_OS, normals[chosen]),
            position_noise=noise * -normals[chosen, 2],
            normal_noise=normal_noise[chosen],
        )


def _require_gel(fits: list[_Fit]) -> None:
    """Raise if surfaces are steeper than a gel is pressed in: heights and pitch differ in units."""
    slopes = np.concatenate([np.linalg.norm(fit.slopes, axis=1) for fit in fits])
    if len(slopes) and (steep := float(np.median(slopes))) > _STEEPEST:
        angle = np.degrees(np.arctan(steep))
        raise InvalidInputError(
            f"half of the gel would be inclined by more than {angle:.0f} deg: give heights and"
            " pitch in metres, depths in pixels times the metres of a pixel"
        )


def _apart(points: FloatArray, order: IndexArray, spacing: float) -> IndexArray:
    """Return which points (P, 3) [m] to keep, in order, so that none is within `spacing`."""
    tree, free = cKDTree(points), np.ones(len(points), dtype=bool)
    chosen = []
    for index in order:
        if free[index]:
            chosen.append(index)
            free[tree.query_ball_point(points[index], spacing)] = False
    return np.array(chosen, dtype=np.intp)


def _fit(heights: FloatArray, pitch: FloatArray, detection: PatchDetection) -> _Fit:
    """Fit quadrics about the pixels whose whole window touches."""
    window = np.ones((2 * _HALF_WIDTH + 1,) * 2, dtype=bool)
    pressed = np.nan_to_num(heights, nan=0.0)
    within: BoolArray = binary_erosion(pressed >= detection.threshold, window)
    rows, columns = np.nonzero(within)
    kernels, basis = _kernels()
    maps = [correlate(pressed, kernel)[within] for kernel in kernels]  # 6 of (P,)
    value, slope_x, slope_y, xx, xy, yy = maps
    rest = correlate(pressed**2, window.astype(float))[within]
    rest = rest - sum(correlate(pressed, each)[within] ** 2 for each in basis)
    place = np.column_stack([columns, rows]) - 0.5 * (np.array(heights.shape[::-1]) - 1.0)
    slopes = np.column_stack([slope_x, slope_y]) / pitch
    # Second derivatives are 2 xx, xy (twice) and 2 yy.
    scale = np.array([2.0, np.sqrt(2.0), 2.0]) / (pitch[[0, 0, 1]] * pitch[[0, 1, 1]])
    gains = np.linalg.norm(kernels.reshape(6, -1), axis=1)
    return _Fit(
        np.column_stack([place * pitch, -value]),  # the indentation is -z
        slopes,
        np.linalg.norm(np.column_stack([xx, xy, yy]) * scale, axis=1),
        np.sqrt(np.maximum(rest, 0.0) / (window.size - len(basis))),
        float((gains[1:3] / pitch).max()),
        float(np.linalg.norm(gains[3:] * scale)),
        float(_HALF_WIDTH * pitch.max()),
    )


@lru_cache
def _kernels() -> tuple[FloatArray, FloatArray]:
    """Return kernels of the six coefficients of a quadric, and an orthonormal basis of them.

    Both have shape (6, 11, 11); coefficients are of 1, x, y, x^2, xy, y^2, in pixels.
    """
    y, x = np.mgrid[-_HALF_WIDTH : _HALF_WIDTH + 1, -_HALF_WIDTH : _HALF_WIDTH + 1].astype(float)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y]).reshape(6, -1)
    kernels, basis = np.linalg.pinv(terms.T), np.linalg.qr(terms.T)[0].T
    return kernels.reshape(6, *x.shape), basis.reshape(6, *x.shape)
