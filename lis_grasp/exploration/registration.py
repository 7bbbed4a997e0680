"""Registration of contacts to the estimate of an object that has moved on its table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.deferred_estimate import DeferredEstimate
from lis_grasp.exploration.planar_motion import displacement_rows, planar_pose
from lis_grasp.exploration.workspace import sample_zero_level_set
from lis_grasp.geometry import apply_pose, inverse_pose, rotate
from lis_grasp.typing import BoolArray, FloatArray

# Steps of the search are damped by these prior standard deviations of x, y [m] and yaw [rad].
_DAMPING = np.array([0.01, 0.01, 0.2])
CONTACT_ERROR = 0.002
"""Standard deviation of a contact's distance from the estimated surface [m]."""
_ITERATIONS = 10
# Fewer contacts do not show where an object is. Then all known ones must be this certain [m], and
# any other pose that is as good must leave them this close to the estimate [m].
_ENOUGH, _CERTAIN, _ALIKE = 5, 0.005, 0.003
# Standard deviation of a normal [rad]; lever of a radian [m]; largest z of a side's normal.
_NORMAL_ERROR, _RADIAN, _SIDE = 0.3, 0.03, 0.7
# Approximate largest numbers of samples of an estimate, contacts laid on them, and poses.
_SAMPLES, _LAID, _STARTS = 24, 4, 400
# Squared error of an outlier; difference of squared errors that distinguishes two poses, and that
# contacts on the estimate stay below; least fraction of these.
_OUTLIER, _CLEARLY, _MOST = 16.0, 9.0, 0.8


def find_displacement(
    contacts: Contacts, surface: DeferredEstimate
) -> tuple[FloatArray, FloatArray] | None:
    """Return where an object with another known map is now; None if it is not certain.

    The pose (4, 4) is of the map's frame in the frame of the new contacts; the covariance (3, 3) of
    x, y and yaw is in the map's. Some contacts are laid on all similar samples of the estimate;
    then damped Gauss-Newton iterations find the most probable displacements. The best is certain if
    the contacts are on the estimate, if they determine the place of all its contacts, and if any
    other is far less probable or leaves these on the estimate, as a cylinder's turn does.
    """
    known = surface.contacts
    if min(len(contacts), len(known)) < _ENOUGH or not known.extent:
        return None
    samples = _Samples.of(surface)
    starts = _starts(contacts, samples)
    if not len(starts):
        return None
    X = _refined(starts, contacts, samples)
    matches = _matched(X, contacts, samples)
    costs = _costs(X, matches, contacts, known)
    best = int(np.argmin(costs))
    on = matches.errors[best] < _CLEARLY  # the estimate may be wrong at a few
    if on.mean() < _MOST or matches.errors[best][on].mean() > 1.0:
        return None
    rows = displacement_rows(matches.points[best], matches.normals[best])
    rows = rows / matches.deviations[best, :, None]
    covariance = np.asarray(np.linalg.inv(rows.T @ rows + np.eye(3)), dtype=np.float64)
    of_known = displacement_rows(known.points, known.normals)
    if np.einsum("ni,ij,nj->n", of_known, covariance, of_known).max() > _CERTAIN**2:
        return None
    rivals = X[costs < costs[best] + _CLEARLY]
    moved = _matched(rivals @ inverse_pose(X[best]), known, samples)
    alike = np.mean(moved.off**2, axis=1) < _ALIKE**2
    alike &= np.median(moved.deviations, axis=1) < _ALIKE
    return (inverse_pose(X[best]), covariance) if alike.all() else None


def are_on(contacts: Contacts, surface: DeferredEstimate) -> BoolArray:
    """Return which contacts (N,) are on an estimate."""
    matches = _matched(np.eye(4)[None], contacts, _Samples.of(surface))
    return np.maximum(matches.errors[0], matches.turned[0]) < _CLEARLY


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Samples of an estimate."""

    points: FloatArray  #: (S, 3) [m]
    normals: FloatArray  #: (S, 3)
    deviations: FloatArray  #: (S,), standard deviations of contacts there [m]
    spacing: float  #: [m]
    tree: cKDTree  #: of points and scaled normals

    @classmethod
    def of(cls, surface: DeferredEstimate) -> _Samples:
        """Return the samples of an estimate, made once."""
        return surface.derived("samples", None, partial(cls._made, surface))

    @classmethod
    def _made(cls, surface: DeferredEstimate) -> _Samples:
        bounds = surface.contacts.bounds
        extent = float(np.ptp(bounds, axis=0).max())
        bounds = bounds + 0.25 * extent * np.array([[-1.0], [1.0]])
        points, normals = sample_zero_level_set(surface, bounds, extent / _SAMPLES)
        deviations = np.hypot(surface.uncertainty(points), CONTACT_ERROR)
        tree = cKDTree(np.hstack([points, _RADIAN * normals]))
        return cls(points, normals, deviations, extent / _SAMPLES, tree)


def _starts(contacts: Contacts, samples: _Samples) -> FloatArray:
    """Return displacements (H, 3) that lay a contact on a sample like it."""
    points, normals = samples.points, samples.normals
    sides = np.flatnonzero(np.abs(contacts.normals[:, 2]) < _SIDE)
    sides = sides[:: 1 + len(sides) // _LAID]
    alike = np.abs(points[:, 2] - contacts.points[sides, None, 2]) < samples.spacing
    alike &= np.abs(normals[:, 2] - contacts.normals[sides, None, 2]) < _NORMAL_ERROR
    i, j = np.nonzero(alike)
    i, j = sides[i][:: 1 + len(i) // _STARTS], j[:: 1 + len(j) // _STARTS]
    azimuths = (np.arctan2(n[:, 1], n[:, 0]) for n in (normals[j], contacts.normals[i]))
    poses = np.insert(np.zeros((len(i), 2)), 2, np.subtract(*azimuths), axis=1)
    laid = apply_pose(planar_pose(poses), contacts.points[i, None])[:, 0]
    poses[:, :2] = (points[j] - laid)[:, :2]
    return poses


def _refined(poses: FloatArray, contacts: Contacts, samples: _Samples) -> FloatArray:
    """Return the most probable displacements from starts (H, 3), as poses (H, 4, 4)."""
    for _ in range(_ITERATIONS):
        matches = _matched(planar_pose(poses), contacts, samples)
        off = matches.off
        weights = 1.0 / (matches.deviations**2 + off**2 / _OUTLIER)  # Geman and McClure 1987
        rows = displacement_rows(matches.points, matches.normals)
        information = np.einsum("hni,hn,hnj->hij", rows, weights, rows)
        gradient = np.einsum("hni,hn->hi", rows, weights * off)
        information += np.diag(_DAMPING**-2.0)
        steps = planar_pose(-np.linalg.solve(information, gradient[..., None])[..., 0])
        X = steps @ planar_pose(poses)
        poses = np.column_stack([X[:, :2, 3], np.arctan2(X[:, 1, 0], X[:, 0, 0])])
    return planar_pose(poses)


class _Matches(NamedTuple):
    """N contacts at H poses, and their nearest samples."""

    points: FloatArray  #: (H, N, 3), of the contacts [m]
    normals: FloatArray  #: (H, N, 3), of the samples
    off: FloatArray  #: (H, N), distances along these [m]
    deviations: FloatArray  #: (H, N) [m]
    errors: FloatArray  #: (H, N), squared, of positions
    turned: FloatArray  #: (H, N), squared errors of normals


def _matched(X: FloatArray, contacts: Contacts, samples: _Samples) -> _Matches:
    """Match contacts at poses (H, 4, 4) with samples."""
    points, normals = apply_pose(X, contacts.points), rotate(X, contacts.normals)
    _, nearest = samples.tree.query(np.concatenate([points, _RADIAN * normals], axis=-1))
    there = samples.normals[nearest]
    offsets, cosines = points - samples.points[nearest], np.sum(normals * there, axis=-1)
    off = np.sum(offsets * there, axis=-1)
    aside = np.linalg.norm(offsets - off[..., None] * there, axis=-1)
    squares = off**2 + np.maximum(aside - samples.spacing, 0.0) ** 2
    turned = (np.arccos(np.clip(cosines, -1.0, 1.0)) / _NORMAL_ERROR) ** 2
    near = samples.deviations[nearest]
    return _Matches(points, there, off, near, squares / near**2, turned)


def _costs(X: FloatArray, matches: _Matches, contacts: Contacts, known: Contacts) -> FloatArray:
    """Return the costs (H,) of poses X (H, 4, 4), infinity for far less probable ones."""
    errors = np.minimum(matches.errors + matches.turned, _OUTLIER)
    costs: FloatArray = np.sum(errors + 2.0 * np.log(matches.deviations), axis=1)
    costs[costs >= costs.min() + _OUTLIER] = np.inf
    for h in np.flatnonzero(np.isfinite(costs)):
        costs[h] += _depth(apply_pose(X[h], contacts.points), known)
        costs[h] += _depth(apply_pose(inverse_pose(X[h]), known.points), contacts)
    return costs


def _depth(points: FloatArray, others: Contacts) -> float:
    """Return the summed squared errors of points (N, 3) in the free space of others."""
    depths = others.free_radii - cdist(points, others.free_points) - CONTACT_ERROR
    errors = depths.max(axis=1, initial=0.0) / CONTACT_ERROR
    return float(np.minimum(errors**2, _OUTLIER).sum())
