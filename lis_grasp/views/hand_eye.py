"""Hand-eye calibration by what is seen and touched: one rigid error of a camera's pose.

The error is estimated as the maximum of its posterior: its prior, the table that the camera sees,
whose height is known, and touches of seen surface, each by its distance from the seen plane next
to it. Outliers have little weight (Student's t). Directions that nothing determines keep their
prior: the covariance says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import (
    apply_inverse,
    apply_pose,
    cross,
    cross_matrix,
    rotate_back,
    unit,
)
from lis_grasp.records import Record
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.views.camera import HandEye, small_motion
from lis_grasp.views.depth_view import DepthView
from lis_grasp.views.object_mask import heights_above_table

# Pixels of the table: at most, how near to the object [m], how far from the plane [deviations, m].
_MOST_PIXELS, _REACH, _ON_TABLE, _LEAST = 400, 0.25, 3.0, 0.001
# Noise of a touch where it is unknown, and least noise of anything [m] [rad].
_TOUCH_NOISE, _LEAST_NOISE = (0.0005, 0.05), 1e-4
# A touch is of the seen surface near it: this far in errors of the pose and [m], and this parallel.
_FAR, _NEAR, _PARALLEL = 3.0, 0.006, 0.7
# A touch is not explained: deviations from the plane, depth in free space [m], deviations of it.
_UNEXPLAINED, _CLEARLY_FREE, _DEVIATIONS = 5.0, 0.004, 3.0
# A view is refuted by so many touches, and this fraction of those that concern it.
_FEWEST, _FRACTION = 2, 0.2
# Chi squared with six degrees of freedom is above this once in 25 000 times.
_SURPRISING = 30.0
# Degrees of freedom of Student's t, and rounds.
_DEGREES, _ROUNDS = 4.0, 10


@dataclass(frozen=True, slots=True, eq=False)
class Calibration(Record):
    """The pose of a camera as estimated, and how uncertain it is."""

    X_WC: FloatArray  #: (4, 4) pose of the camera, corrected
    covariance: FloatArray  #: (6, 6) of a rotation vector [rad] and a translation [m] in C
    touches: int = 0  #: number of touches of seen surface, or of space that is seen to be free
    contradicting: int = 0  #: number of these that are not explained by any likely pose
    #: squared deviation of the corrections from their prior, in the prior's deviations
    surprise: float = 0.0

    @property
    def is_refuted(self) -> bool:
        """Whether touches contradict the view: its pose is wrong, or the object was moved."""
        wrong = self.contradicting >= max(_FEWEST, _FRACTION * self.touches)
        return wrong or (self.touches >= _FEWEST and self.surprise > _SURPRISING)

    def displacement_covariance(self, points: FloatArray) -> FloatArray:
        """Return the covariance of the places of points (P, 3) [m] in W, (P, 3, 3) [m^2]."""
        turned = -cross_matrix(apply_inverse(self.X_WC, points))  # (P, 3, 3)
        motion = np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2)
        rotation = self.X_WC[:3, :3]
        moved = motion @ self.covariance @ motion.transpose(0, 2, 1)
        return np.asarray(rotation @ moved @ rotation.T)

    def displacement(self, points: FloatArray) -> float:
        """Return the standard deviation of the distance of points (P, 3) from their places [m]."""
        covariances = self.displacement_covariance(points)
        return float(np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class Sight(Record):
    """What a view contributes to its calibration; it does not depend on the touches."""

    table: FloatArray  # (T, 3) [m] in C: pixels of the table near the object
    table_noise: FloatArray  # (T,) [m] of their heights, each as if it were independent
    points: FloatArray  # (N, 3) [m] in C: seen surface
    normals: FloatArray  # (N, 3) in C
    noise: FloatArray  # (N, 2) of positions [m] and normals [rad]
    tree: cKDTree | None  # of the points

    @classmethod
    def of(cls, view: DepthView, support_height: float | None) -> Sight:
        """Return what a view shows of the table and of the object."""
        contacts = view.contacts_in_camera
        points, normals = contacts.points, contacts.normals
        noise = _noise_of(contacts)
        tree = cKDTree(points) if len(points) else None
        table, table_noise = np.empty((0, 3)), np.empty(0)
        if support_height is not None and len(points):
            table, table_noise = _table_of(view, support_height)
        return cls(table, table_noise, points, normals, noise, tree)


def calibrate(
    view: DepthView, sight: Sight, touches: Contacts, support_height: float | None
) -> Calibration:
    """Return the pose of a view's camera, given the table and touches (N contacts, in W)."""
    parameters, normal, X_WC = np.zeros(6), np.eye(6), view.X_WC
    if view.hand_eye.is_exact:
        matched = _matched(view.hand_eye, sight, X_WC, touches)
        return _doubted(view, Calibration(X_WC, np.zeros((6, 6))), matched, touches)
    prior = np.diag(1.0 / np.maximum(view.hand_eye.deviations, 1e-9) ** 2)
    height = 0.0 if support_height is None else support_height
    for _ in range(_ROUNDS):
        X_WC = view.X_WC @ small_motion(parameters)
        matched = _matched(view.hand_eye, sight, X_WC, touches)
        up = np.broadcast_to(rotate_back(X_WC, np.array([0.0, 0.0, 1.0])), sight.table.shape)
        rows = np.vstack([np.hstack([cross(sight.table, up), up]), matched.rows])
        heights = apply_pose(X_WC, sight.table)[:, 2] - height
        residuals = np.concatenate([-heights, matched.residuals])
        deviations = np.concatenate([sight.table_noise, matched.deviations])
        weights = (_DEGREES + 1.0) / (_DEGREES + (residuals / deviations) ** 2) / deviations**2
        normal = prior + (rows * weights[:, None]).T @ rows
        right = (rows * weights[:, None]).T @ residuals - prior @ parameters
        parameters = parameters + np.linalg.solve(normal, right)
    X_WC = view.X_WC @ small_motion(parameters)
    surprise = float(parameters @ prior @ parameters)
    found = Calibration(X_WC, np.asarray(np.linalg.inv(normal)), surprise=surprise)
    matched = _matched(view.hand_eye, sight, X_WC, touches)
    return _doubted(view, found, matched, touches)


@dataclass(frozen=True, slots=True, eq=False)
class _Matched:
    """Touches that are next to seen surface, M of N, and their linear equations in C."""

    rows: FloatArray  # (M, 6) of a rotation vector and a translation
    residuals: FloatArray  # (M,) [m], outside of the seen plane if positive
    deviations: FloatArray  # (M,) [m]
    touches: IndexArray  # (M,)


def _matched(prior: HandEye, sight: Sight, X_WC: FloatArray, touches: Contacts) -> _Matched:
    if sight.tree is None or not len(touches):
        none = np.empty(0)
        return _Matched(np.empty((0, 6)), none, none, np.empty(0, dtype=np.intp))
    points = apply_inverse(X_WC, touches.points)
    normals = rotate_back(X_WC, touches.normals)
    _, near = sight.tree.query(points)
    middle, seen = sight.points[near], sight.normals[near]
    reach = _FAR * np.hypot(prior.position, prior.rotation * np.abs(points[:, 2])) + _NEAR
    ok = np.linalg.norm(points - middle, axis=1) < reach
    ok &= np.einsum("nk,nk->n", seen, normals) > _PARALLEL
    chosen = np.flatnonzero(ok)
    middle, away = middle[ok], points[ok] - middle[ok]
    # Across the chord of a circle through both places, whatever its radius.
    across = unit(seen[ok] + normals[ok])
    residuals = np.einsum("nk,nk->n", across, away)
    beside = np.linalg.norm(away - residuals[:, None] * across, axis=1)
    noise = np.hypot(_noise_of(touches)[ok], sight.noise[near[ok]])
    deviations = np.hypot(noise[:, 0], 0.5 * beside * noise[:, 1])
    return _Matched(
        np.hstack([cross(middle, across), across]),
        residuals,
        np.maximum(deviations, _LEAST_NOISE),
        chosen,
    )


def _noise_of(contacts: Contacts) -> FloatArray:
    """Return the noise of contacts, or a usual one where it is unknown, (N, 2) [m], [rad]."""
    usual = np.tile(_TOUCH_NOISE, (len(contacts), 1))
    for column, given in enumerate((contacts.position_noise, contacts.normal_noise)):
        if given is not None:
            usual[:, column] = np.where(np.isnan(given), usual[:, column], given)
    return usual


def _doubted(
    view: DepthView, found: Calibration, matched: _Matched, touches: Contacts
) -> Calibration:
    """Return a calibration with the number of touches that it does not explain.

    They are far from the seen surface next to them, or in space that is seen to be free.
    """
    if not len(touches):
        return found
    wrong = np.zeros(len(touches), dtype=bool)
    wrong[matched.touches] = np.abs(matched.residuals) > _UNEXPLAINED * matched.deviations
    # In the frame of the pose as given, whose free space is computed once.
    points = apply_pose(view.X_WC, apply_inverse(found.X_WC, touches.points))
    depths, _ = view.depths(points)
    wrong |= depths > _CLEARLY_FREE + _DEVIATIONS * found.displacement(touches.points)
    relevant = np.union1d(matched.touches, np.flatnonzero(wrong))
    return replace(found, touches=len(relevant), contradicting=int(np.count_nonzero(wrong)))


def _table_of(view: DepthView, support_height: float) -> tuple[FloatArray, FloatArray]:
    """Return pixels of the table near an object, (T, 3) [m] in C, and noise of their heights."""
    height, deviation = heights_above_table(view, support_height)
    points = view.depth[..., None] * view.intrinsics.rays(view.depth.shape)
    middle = apply_inverse(view.X_WC, view.contacts.points.mean(axis=0))
    with np.errstate(invalid="ignore"):
        on_table = np.abs(height) < np.maximum(_ON_TABLE * deviation, _LEAST)
        on_table &= np.linalg.norm(points - middle, axis=-1) < _REACH
    on_table &= ~view.object_mask
    rows, columns = np.nonzero(on_table)
    if not len(rows):
        return np.empty((0, 3)), np.empty(0)
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_PIXELS)).astype(np.intp)
    v, u = rows[chosen], columns[chosen]
    # Errors of neighbouring pixels are alike: fewer are independent.
    alike = 4.0 * np.pi * view.noise.smooth_length**2
    independent = max(len(rows) / alike, 1.0)
    noise = np.maximum(deviation[v, u], _LEAST_NOISE) * np.sqrt(len(chosen) / independent)
    return points[v, u], noise
