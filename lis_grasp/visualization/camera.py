"""Initial camera view: framed points and the azimuth with the least occlusion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from lis_grasp.robots.link_bodies import fibonacci_directions
from lis_grasp.typing import BoolArray, FloatArray

ELEVATION = np.deg2rad(24.0)

LIGHT = np.array([-0.35, 0.6, 0.72]) / np.linalg.norm([-0.35, 0.6, 0.72])
"""Direction to the light of a picture in the view's axes: right, up, towards the eye."""

_DIRECTIONS = 36
_CELLS = 40

# This many directions find the outline of a scene to within about a percent.
_OUTWARD = 150


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic view of the object frame O, with z upwards on the picture.

    The eye is at `azimuth` about z from +x towards +y [rad], and at `elevation` above the plane
    z = 0 [rad], below a right angle.
    """

    azimuth: float
    elevation: float

    @property
    def axes(self) -> FloatArray:
        """Rows: the picture's right, its up, and towards the eye, unit, in O; shape (3, 3)."""
        return view_axes(self.azimuth, self.elevation)

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return places on the picture (..., 2) [m] of points (..., 3), and their depths (...).

        Depth grows towards the eye [m].
        """
        seen = np.asarray(points, dtype=np.float64) @ self.axes.T
        return seen[..., :2], seen[..., 2]

    def faces(self, normals: npt.ArrayLike) -> BoolArray:
        """Return whether surfaces with outward normals (..., 3) in O face the eye, shape (...)."""
        return np.asarray(normals) @ self.axes[2] > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraView:
    """Camera direction of a page, and the points that it frames, each (N, 3) [m] in O."""

    azimuth: float  # [rad]
    object: FloatArray
    hand: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # at all grasps
    moved: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # in the lift
    arm: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # at home

    def facts(self) -> dict[str, Any]:
        """Return the view as JSON for the page's script: angles [deg], points to 10 um."""
        points = {"object": self.object, "hand": self.hand, "moved": self.moved, "arm": self.arm}
        return {
            "azimuth": round(float(np.rad2deg(self.azimuth)), 3),
            "elevation": round(float(np.rad2deg(ELEVATION)), 3),
            **{name: np.round(rows, 5).tolist() for name, rows in points.items()},
        }


def choose_azimuth(subject: FloatArray, obstacle: FloatArray) -> float:
    """Return the camera azimuth [rad] at which the obstacle occludes the subject least.

    Both point sets (N, 3) and (M, 3) [m] are drawn into coarse depth images from 36 directions. The
    score counts the cells in which the subject is in front; without an obstacle, all its cells.
    Visible cells of the obstacle count a little, to choose between equal views. Without a subject
    it is a three-quarter view.
    """
    azimuths = np.deg2rad(-55.0) + np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    if not len(subject):
        return float(azimuths[0])
    scores = [_score(subject, obstacle, azimuth) for azimuth in azimuths]
    return float(azimuths[int(np.argmax(scores))])


def surface_points(mesh: trimesh.Trimesh, count: int = 2000) -> FloatArray:
    """Return points (N, 3) in a fixed pattern on the faces of `mesh`, at least one per face."""
    steps = max(1, int(np.ceil(np.sqrt(2.0 * count / max(len(mesh.faces), 1)))))
    i, j = np.nonzero(np.add.outer(np.arange(steps), np.arange(steps)) < steps)
    weights = np.stack([i + 1.0 / 3.0, j + 1.0 / 3.0], axis=1) / steps  # (P, 2)
    weights = np.column_stack([weights, 1.0 - weights.sum(axis=1)])  # (P, 3)
    return np.einsum("pk,fkd->fpd", weights, mesh.triangles).reshape(-1, 3)


def view_axes(azimuth: float, elevation: float) -> FloatArray:
    """Return the right, the up and the towards-the-eye direction of a picture, as rows (3, 3)."""
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    ce, se = np.cos(elevation), np.sin(elevation)
    return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


def outermost(points: FloatArray) -> FloatArray:
    """Return those of the points (N, 3) that are extreme in any of 150 directions."""
    if not len(points):
        return points
    return points[np.unique(np.argmax(fibonacci_directions(_OUTWARD) @ points.T, axis=1))]


def _score(subject: FloatArray, obstacle: FloatArray, azimuth: float) -> float:
    both = np.vstack([subject, obstacle]) @ view_axes(azimuth, ELEVATION).T  # (N + M, 3)
    low = both[:, :2].min(axis=0)
    # Cells are larger than the distance between neighbouring points, so that surfaces lack holes.
    cell = np.ptp(subject, axis=0).max() / _CELLS * 2.0 or 1.0
    column, row = ((both[:, :2] - low) / cell).astype(np.int64).T
    index = column * (row.max() + 1) + row
    nearest = np.full((2, index.max() + 1), -np.inf)
    owner = np.repeat([0, 1], [len(subject), len(obstacle)])
    np.maximum.at(nearest, (owner, index), both[:, 2])
    return float(np.sum(nearest[0] > nearest[1]) + 0.15 * np.sum(nearest[1] > nearest[0]))
