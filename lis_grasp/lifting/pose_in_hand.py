"""Pose of a held object in the palm, with its uncertainty, and its correction by contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import apply_pose, inverse_pose, make_pose, require_pose, rotate
from lis_grasp.records import FrozenArrays, Record, short_repr
from lis_grasp.typing import FloatArray

_BAND = 0.95  # probability of a band
# Draws of a pose; samples of a surface; draws and rounds of importance sampling, with the fraction
# drawn from the prior, and the factor by which the other draws are wider than the last weights say.
_DRAWS, _SURFACE, _SAMPLED, _ROUNDS, _FROM_PRIOR, _WIDER = 500, 4000, 1000, 3, 0.2, 1.5
# Standard deviations of a contact's distance from the estimate beside the estimate's own [m], and
# of its normal [rad]; lever of a radian in the match with samples [m].
_CONTACT_ERROR, _NORMAL_ERROR, _RADIAN = 0.001, 0.2, 0.03
_OUTLIER = 16.0  # squared error beyond which a contact says nothing
_LEAST_DEVIATION = 1e-6  # [rad, m], so that a known direction has a density


@dataclass(frozen=True, slots=True, eq=False)
class PoseInHand(FrozenArrays, Record):
    """Pose of a held object in the palm, and draws from its distribution.

    A draw is a displacement (6,) of the object from this pose: a rotation vector [rad] about the
    object's `center`, and the centre's translation [m], along the palm's axes.

    Parameters
    ----------
    X_HO
        Shape (4, 4): mean pose of the object's frame O in the palm's frame H.
    center
        Shape (3,): the object's centre, in O [m].
    draws
        Shape (D, 6): displacements, all as probable.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> pose = PoseInHand.normal(np.eye(4), np.zeros(3), np.diag([1e-4] * 3 + [1e-6] * 3), rng=rng)
    >>> bool(0.002 < pose.position_band < 0.003)
    True
    """

    X_HO: FloatArray
    center: FloatArray
    draws: FloatArray

    __repr__ = short_repr

    @classmethod
    def normal(
        cls,
        X_HO: npt.ArrayLike,
        center: npt.ArrayLike,
        covariance: npt.ArrayLike,
        *,
        rng: np.random.Generator,
    ) -> PoseInHand:
        """Return a pose whose displacements are normal with a covariance (6, 6).

        Raises `InvalidOptionError` if the covariance is not symmetric and positive semidefinite, or
        `X_HO` is no pose.
        """
        X, spread = require_pose("X_HO", X_HO), np.array(covariance, np.float64)
        if spread.shape != (6, 6) or not np.isfinite(spread).all() or not _is_covariance(spread):
            raise InvalidOptionError(
                "covariance must be a symmetric and positive semidefinite matrix of shape (6, 6);"
                f" its shape is {spread.shape}",
                option="covariance",
            )
        half = rng.standard_normal((_DRAWS // 2, 6)) @ _root(spread).T
        return cls(X, np.array(center, np.float64), np.concatenate([half, -half]))

    @property
    def covariance(self) -> FloatArray:
        """Covariance (6, 6) of the displacements."""
        return np.asarray(self.draws.T @ self.draws / len(self.draws))

    @property
    def position_band(self) -> float:
        """Distance [m] of the object's centre from the pose that it exceeds in 5 % of draws."""
        return float(np.quantile(np.linalg.norm(self.draws[:, 3:], axis=1), _BAND))

    @property
    def angle_band(self) -> float:
        """Angle [rad] of the object from the pose that it exceeds in 5 % of draws."""
        return float(np.quantile(np.linalg.norm(self.draws[:, :3], axis=1), _BAND))

    def displaced(self, displacements: FloatArray) -> FloatArray:
        """Return the poses (..., 4, 4) at displacements (..., 6)."""
        turns = Rotation.from_rotvec(displacements[..., :3].reshape(-1, 3)).as_matrix()
        R = turns.reshape(*displacements.shape[:-1], 3, 3)
        middle = apply_pose(self.X_HO, self.center)
        return np.asarray(make_pose(R, middle + displacements[..., 3:] - R @ middle) @ self.X_HO)

    def errors(self, X_HO: FloatArray) -> tuple[float, float]:
        """Return the distance [m] of the centre, and the angle [rad], from a true pose (4, 4)."""
        off = apply_pose(self.X_HO, self.center) - apply_pose(X_HO, self.center)
        turn = Rotation.from_matrix(self.X_HO[:3, :3] @ X_HO[:3, :3].T).magnitude()
        return float(np.linalg.norm(off)), float(turn)


def locate_in_hand(
    prior: PoseInHand, contacts: Contacts, mesh: trimesh.Trimesh, *, rng: np.random.Generator
) -> PoseInHand:
    """Correct the pose of a held object by its contacts with the hand.

    The contacts must be on the surface, with its normals. Directions that they do not constrain
    keep the prior's width: a box between flat pads slides along them. The posterior is sampled, as
    it is not normal, by population Monte Carlo (Cappe, Guillin, Marin & Robert 2004).

    Parameters
    ----------
    prior
        The pose without the contacts, as if its displacements were normal.
    contacts
        In the palm's frame H; normals are outward of the object.
    mesh
        The object as known, in O; the vertex attribute ``"uncertainty"`` [m] is the deviation of
        its surface along the normal, 0 without it.

    Examples
    --------
    >>> rng, box = np.random.default_rng(0), shapes.find("box").mesh
    >>> spread = np.diag([0.1**2] * 3 + [0.01**2] * 3)
    >>> prior = PoseInHand.normal(np.eye(4), np.zeros(3), spread, rng=rng)
    >>> normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    >>> pads = Contacts(0.5 * box.extents * normals, normals)
    >>> held = locate_in_hand(prior, pads, box, rng=rng)
    >>> (np.sqrt(np.diag(held.covariance)[3:]) < 0.002).tolist()
    [True, False, False]
    """
    if not len(contacts):
        return prior
    surface, root = _Surface.of(mesh), _root(prior.covariance + _LEAST_DEVIATION**2 * np.eye(6))
    mean, spread = np.zeros(6), np.eye(6)
    unit_normal = multivariate_normal(np.zeros(6), np.eye(6))
    for _ in range(_ROUNDS):
        near = multivariate_normal(mean, spread, allow_singular=True)
        count = round(_FROM_PRIOR * _SAMPLED)
        drawn = np.concatenate(
            [rng.standard_normal((count, 6)), near.rvs(_SAMPLED - count, random_state=rng)]
        )
        proposed = _FROM_PRIOR * unit_normal.pdf(drawn) + (1.0 - _FROM_PRIOR) * near.pdf(drawn)
        costs = surface.costs(prior.displaced(drawn @ root.T), contacts)
        logarithms = unit_normal.logpdf(drawn) - np.log(proposed) - costs
        weights = np.exp(logarithms - logarithms.max())
        weights /= weights.sum()
        mean = weights @ drawn
        off = drawn - mean
        spread = _WIDER**2 * (off.T * weights) @ off + _LEAST_DEVIATION * np.eye(6)
    # Systematic resampling.
    places = (rng.uniform() + np.arange(_DRAWS)) / _DRAWS
    chosen = drawn[np.searchsorted(np.cumsum(weights), places).clip(max=len(drawn) - 1)]
    X_HO = prior.displaced(root @ mean)
    turns = prior.displaced(chosen @ root.T)[:, :3, :3] @ X_HO[:3, :3].T
    moved = (chosen - mean) @ root.T
    draws = np.hstack([Rotation.from_matrix(turns).as_rotvec(), moved[:, 3:]])
    return PoseInHand(X_HO, prior.center, draws)


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """Samples of a surface."""

    points: FloatArray  # (S, 3) [m]
    normals: FloatArray  # (S, 3)
    variances: FloatArray  # (S,) of contacts along the normal [m^2]
    spacing: float  # [m]
    tree: cKDTree  # of points and scaled normals

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> _Surface:
        """Return samples of a mesh."""
        points, faces = trimesh.sample.sample_surface(mesh, _SURFACE, seed=0)
        normals, known = mesh.face_normals[faces], mesh.vertex_attributes.get("uncertainty")
        own = np.zeros(len(points)) if known is None else known[mesh.faces].mean(axis=1)[faces]
        tree = cKDTree(np.hstack([points, _RADIAN * normals]))
        spacing = float(np.sqrt(mesh.area / len(points)))
        return cls(points, normals, own**2 + _CONTACT_ERROR**2, spacing, tree)

    def costs(self, X_HO: FloatArray, contacts: Contacts) -> FloatArray:
        """Return minus the logarithms (D,) of the likelihood of contacts at poses (D, 4, 4)."""
        X_OH = inverse_pose(X_HO)
        points, normals = apply_pose(X_OH, contacts.points), rotate(X_OH, contacts.normals)
        _, nearest = self.tree.query(np.concatenate([points, _RADIAN * normals], axis=-1))
        there, offsets = self.normals[nearest], points - self.points[nearest]
        off = np.sum(offsets * there, axis=-1)
        aside = np.linalg.norm(offsets - off[..., None] * there, axis=-1)
        squares = off**2 + np.maximum(aside - self.spacing, 0.0) ** 2
        turned = np.arccos(np.clip(np.sum(normals * there, axis=-1), -1.0, 1.0))
        errors = squares / self.variances[nearest] + (turned / _NORMAL_ERROR) ** 2
        errors = np.minimum(errors, _OUTLIER) + np.log(self.variances[nearest])
        return np.asarray(0.5 * errors.sum(axis=-1))


def _is_covariance(matrix: FloatArray) -> bool:
    values = np.linalg.eigvalsh(matrix)
    return np.allclose(matrix, matrix.T) and bool(values[0] >= -1e-9 * max(values[-1], 0.0))


def _root(covariance: FloatArray) -> FloatArray:
    """Return a matrix (6, 6) whose product with its transpose is a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(values.clip(min=0.0)))
