"""Belief about an object's planar motion: parallel Kalman filters for several scales of motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.planar_motion import Push, displacement_rows, planar_pose
from lis_grasp.records import short_repr
from lis_grasp.typing import FloatArray

# Scales of the motion by one touch [m], and their probabilities before the first touch. Mass and
# friction are unknown; most objects hardly move under a gentle touch.
_SCALES = np.array([3e-5, 1e-4, 3e-4, 1e-3, 3e-3])
_PRIOR = np.array([0.3, 0.25, 0.2, 0.15, 0.1])
# Mean and standard deviation of a push, in scales; its part before the detection; and the standard
# deviation of motion in other directions.
_MEAN, _DEVIATION, _BEFORE, _ASIDE = 0.7, 0.5, 0.3, 0.2
# Probability that a touch moves the object on another scale than the touches before: a cylinder on
# its side rolls one way, and stays the other.
_CHANGE = 0.1
# Innovations beyond this many standard deviations are outliers, and weigh less.
_OUTLIER = 3.0


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
    #: probes since one contradicted certain surface; after the object was found again, probes on
    #: probation, negative
    doubts: int = 0
    repeated: bool = False  #: whether the last probe repeated an earlier one
    suspicious: bool = False  #: whether its contact was far from the expected surface
    lost: bool = False  #: whether the last probe showed that the object is somewhere else

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
        """Return the difference [m] of a measured distance from the mean's, and its deviation."""
        row = displacement_rows(point[None], normal[None])[0]
        return distance - float(row @ self.mean), float(
            np.sqrt(row @ self.covariance @ row + variance)
        )

    def measured(
        self, point: FloatArray, normal: FloatArray, distance: float, variance: float
    ) -> PoseBelief:
        """Return the belief after a contact `distance` [m] outside of the estimate.

        `point` and unit `normal`, both (3,), are the contact and the estimate's gradient there;
        `variance` [m^2] is of the distance if the object had not moved.
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
            "doubts": self.doubts,
            "repeated": self.repeated,
            "suspicious": self.suspicious,
            "lost": self.lost,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> PoseBelief:
        """Return the belief that `as_dict` wrote; `InvalidOptionError` for another shape."""
        count = len(_SCALES)
        shapes = {
            "X_WE": (4, 4),
            "means": (count, 3),
            "covariances": (count, 3, 3),
            "log_weights": (count,),
        }
        arrays = {name: np.array(values[name], dtype=np.float64) for name in shapes}
        for name, shape in shapes.items():
            if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
                required = f"finite numbers of shape {shape}"
                raise InvalidOptionError.out_of_range(name, values[name], required)
        return cls(
            arrays["X_WE"],
            arrays["means"],
            arrays["covariances"],
            arrays["log_weights"],
            int(values["doubts"]),
            bool(values["repeated"]),
            bool(values["suspicious"]),
            bool(values["lost"]),
        )
