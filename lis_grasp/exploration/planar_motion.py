"""Planar displacements of an object on a table: (x, y, yaw), as poses and by pushes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.geometry import make_pose, require_pose
from lis_grasp.records import short_repr
from lis_grasp.typing import FloatArray

# Radius at which friction resists a turn, as a fraction of the object's extent: between a disc's,
# 0.33, and a ring's, 0.5. The extent is at least [m].
_TURNING_RADIUS, _LEAST_EXTENT = 0.4, 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """Displacements of an object by a push, per metre, about the origin of its frame."""

    along: FloatArray  #: (3,): x and y with the push, and yaw [rad/m]
    aside: FloatArray  #: (3, 3): variances per metre, equal in all directions, and of turns


def push_of(contacts: Contacts, known: Contacts) -> Push:
    """Return how `contacts` push an object whose extent the `known` ones show.

    The push is against the contacts' normals. A steep one presses the object down, so its
    horizontal part counts squared. An object that moves far under a gentle touch rolls, which does
    not turn it about the vertical. A slider turns at an unknown rate about an unknown centre of
    friction (Lynch, Maekawa & Tanie 1992); this is a part of the uncertainty.
    """
    both = np.vstack([contacts.points, known.points])[:, :2]
    low, high = both.min(axis=0), both.max(axis=0)
    center = 0.5 * (low + high)
    radius = _TURNING_RADIUS * max(float((high - low).max()), _LEAST_EXTENT)
    force = -contacts.normals.mean(axis=0)[:2]
    strength = float(np.linalg.norm(force))
    about_origin = np.array([[1.0, 0.0, center[1]], [0.0, 1.0, -center[0]], [0.0, 0.0, 1.0]])
    aside = about_origin @ np.diag([1.0, 1.0, radius**-2]) @ about_origin.T
    return Push(np.append(strength * force, 0.0), aside)


def planar_pose(displacement: FloatArray) -> FloatArray:
    """Return the poses (..., 4, 4) of displacements (..., 3): x, y [m] and yaw [rad]."""
    x, y, yaw = np.moveaxis(np.asarray(displacement), -1, 0)
    c, s, o = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)
    R = np.stack([c, -s, o, s, c, o, o, o, o + 1.0], axis=-1).reshape(*yaw.shape, 3, 3)
    return make_pose(R, np.stack([x, y, o], axis=-1))


def displacement_rows(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return how a displacement moves points (..., 3) along normals (..., 3), shape (..., 3)."""
    turn = points[..., 0] * normals[..., 1] - points[..., 1] * normals[..., 0]
    return np.concatenate([normals[..., :2], turn[..., None]], axis=-1)


# Scales of the motion by one touch [m], and their probabilities before the first touch. Mass and
# friction are unknown; most objects hardly move under a gentle touch.
_SCALES = np.array([3e-5, 1e-4, 3e-4, 1e-3, 3e-3])
_PRIOR = np.array([0.3, 0.25, 0.2, 0.15, 0.1])
# Mean and standard deviation of a push, in scales; the part before detection; and the standard
# deviation of motion in other directions.
_MEAN, _DEVIATION, _BEFORE, _ASIDE = 0.7, 0.5, 0.3, 0.2
# Probability that a touch moves the object on another scale than earlier touches: a cylinder on
# its side rolls in one direction, and stays in the other.
_CHANGE = 0.1
# Innovations beyond this many standard deviations are outliers, and weigh less.
_OUTLIER = 3.0


PoseTrust = Literal["trusted", "doubted", "on_probation", "lost"]
"""State of a tracked pose: a contradiction makes it doubted; found again, it is on probation; or
the last probe showed that the object is somewhere else."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """Belief about the displacement of an object from the frame E of its contacts.

    A Gaussian mixture over displacements (x, y, yaw): a filter for each scale of motion, with the
    scale's probability (multiple-model estimation: Magill 1965).
    """

    X_WE: FloatArray  #: (4, 4): pose of E in the frame E had at the first probe
    means: FloatArray  #: (M, 3) [m, m, rad]
    covariances: FloatArray  #: (M, 3, 3)
    log_weights: FloatArray  #: (M,), up to a constant
    trust: PoseTrust = "trusted"
    count: int = 0  #: probes since the first doubt; on probation, probes that are left
    repeated: bool = False  #: whether the last probe repeated an earlier one
    suspicious: bool = False  #: whether its contact was far from the expected surface
    #: pose (4, 4) of the map before the loss among later contacts, if the last probe showed it
    joined: FloatArray | None = None

    __repr__ = short_repr

    @classmethod
    def start(cls) -> PoseBelief:
        """Return the belief before the first touch: E is the object's frame."""
        count = len(_SCALES)
        return cls(np.eye(4), np.zeros((count, 3)), np.zeros((count, 3, 3)), np.log(_PRIOR))

    @property
    def weights(self) -> FloatArray:
        """Probability of each scale, shape (M,)."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(weights / weights.sum())

    @property
    def mean(self) -> FloatArray:
        """Mean displacement, shape (3,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the displacement, shape (3, 3), within and between the filters."""
        off = self.means - self.mean
        spread = self.covariances + off[:, :, None] * off[:, None, :]
        return np.asarray(np.tensordot(self.weights, spread, axes=1))

    @property
    def push_deviation(self) -> float:
        """Standard deviation of the motion by a horizontal push of the mean scale [m]."""
        return _DEVIATION * float(self.weights @ _SCALES)

    def variances(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the variance of points (N, 3) of the object along normals (N, 3), (N,) [m^2]."""
        rows = displacement_rows(points, normals)
        return np.asarray(np.einsum("ni,ij,nj->n", rows, self.covariance, rows))

    def pushed(self, push: Push, *, detected: bool) -> PoseBelief:
        """Return the belief after a push, before or after the touch is `detected`."""
        if not detected:
            weights = (1.0 - _CHANGE) * self.weights + _CHANGE * _PRIOR
            self = replace(self, log_weights=np.log(weights))
        part = 1.0 if detected else _BEFORE
        scales = part * _SCALES
        along = np.outer(push.along, push.along)
        noise = _DEVIATION**2 * along + _ASIDE**2 * push.aside
        return replace(
            self,
            means=self.means + _MEAN * scales[:, None] * push.along,
            covariances=self.covariances + scales[:, None, None] ** 2 * noise,
        )

    def loosened(self, deviations: FloatArray) -> PoseBelief:
        """Return the belief after a large motion of unknown direction, deviations (3,)."""
        return replace(self, covariances=self.covariances + np.diag(deviations**2))

    def innovation(
        self, point: FloatArray, normal: FloatArray, distance: float, variance: float
    ) -> tuple[float, float]:
        """Return the error [m] of the distance that the mean predicts, and its deviation."""
        row = displacement_rows(point[None], normal[None])[0]
        return distance - float(row @ self.mean), float(
            np.sqrt(row @ self.covariance @ row + variance)
        )

    def measured(
        self, point: FloatArray, normal: FloatArray, distance: float, variance: float
    ) -> PoseBelief:
        """Return the belief after a contact `distance` [m] outside of the estimate.

        `point` and unit `normal`, both (3,), are the contact and the estimate's gradient there;
        `variance` [m^2] is that of the distance of an unmoved object.
        """
        row = displacement_rows(point[None], normal[None])[0]
        innovations = distance - self.means @ row  # (M,)
        gains = self.covariances @ row  # (M, 3)
        spread = gains @ row + variance  # (M,)
        spread = np.maximum(spread, (innovations / _OUTLIER) ** 2)
        means = self.means + gains * (innovations / spread)[:, None]
        covariances = (
            self.covariances - gains[:, :, None] * gains[:, None, :] / (spread[:, None, None])
        )
        likelihoods = -0.5 * (innovations**2 / spread + np.log(spread))
        return replace(
            self,
            means=means,
            covariances=covariances,
            log_weights=self.log_weights + likelihoods - likelihoods.max(),
        )

    def centered(self) -> tuple[PoseBelief, FloatArray]:
        """Return the belief with E at the mean, and the pose (4, 4) of this E in the old one."""
        X_EF = planar_pose(self.mean)
        return replace(self, X_WE=self.X_WE @ X_EF, means=self.means - self.mean), X_EF

    def as_dict(self) -> dict[str, Any]:
        """Return the belief as plain values, for a file."""
        return {
            "X_WE": self.X_WE.tolist(),
            "means": self.means.tolist(),
            "covariances": self.covariances.tolist(),
            "log_weights": self.log_weights.tolist(),
            "doubts": {"doubted": self.count, "on_probation": -self.count}.get(self.trust, 0),
            "repeated": self.repeated,
            "suspicious": self.suspicious,
            "lost": self.trust == "lost",
            **({} if self.joined is None else {"joined": self.joined.tolist()}),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> PoseBelief:
        """Return the belief that `as_dict` wrote; `InvalidOptionError` for another shape."""
        start = cls.start()
        given = {field.name: values[field.name] for field in fields(cls) if field.name in values}
        trust: PoseTrust = "lost" if values["lost"] else "trusted"
        if doubts := int(values["doubts"]):  # below 0 on probation
            trust = "doubted" if doubts > 0 else "on_probation"
        for name in ("means", "covariances", "log_weights"):
            shape, array = getattr(start, name).shape, np.array(given[name], dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                required = f"finite numbers of shape {shape}"
                raise InvalidOptionError.out_of_range(name, given[name], required)
            given[name] = array
        for name in ("X_WE", "joined"):
            if given.get(name) is not None:
                given[name] = require_pose(name, given[name])
        return cls(**{**given, "trust": trust, "count": abs(doubts)})
