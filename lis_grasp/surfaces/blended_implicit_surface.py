"""Blend of a sharp and a smooth estimate, weighted by cross-validation over places.

f = smooth + w v (sharp - smooth)

w rises from 0 to 1 with the evidence for the sharp estimate in cross-validation, near a point
and overall. v falls from 1 to 0 where the two estimates are 0.5 to 1 spacings apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.guesses import with_advice
from lis_grasp.records import short_repr
from lis_grasp.surfaces._gaussian_process_regression import squared_distances
from lis_grasp.surfaces.contact_places import agreement, log_errors, smoothstep
from lis_grasp.surfaces.contact_preparation import prepare_contacts
from lis_grasp.surfaces.gaussian_process_implicit_surface import GaussianProcessImplicitSurface
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.queries import Predicting, flat_points, map_rows
from lis_grasp.surfaces.smooth_implicit_surface import LEAST_PLACES, SmoothImplicitSurface
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

# Folds of the cross-validation.
_FOLDS = 5

# The evidence of all places counts as much as this many near places, less half a standard error.
_PRIOR_PLACES = 3.0
_CAUTION = 0.5

# Width of the kernel that averages evidence, in spacings.
_SIGMA = 1.2

# Evidence at which the sharp estimate begins to have weight, and has all of it.
_NO_WEIGHT, _FULL_WEIGHT = 0.0, 0.3

# Distance between both estimates at which the sharp one begins to lose its weight, and has lost it,
# in spacings: surface that is far from any smooth one is spurious.
_NEAR, _FAR = 0.5, 1.0


@methods_underflow
@dataclass(frozen=True, slots=True, eq=False)
class BlendedImplicitSurface(Predicting):
    """Blend of a patch surface and a Gaussian process, by their prediction errors.

    Made by `from_contacts`. Near the surface f is about a distance.

    Examples
    --------
    >>> surface = BlendedImplicitSurface.from_contacts(contacts)
    >>> bool(surface.evaluate([0.0, 0.0, 0.0]) < 0.0)  # inside
    True
    """

    sharp: PatchImplicitSurface  #: the estimate with sharp edges
    smooth: SmoothImplicitSurface  #: the estimate without
    places: FloatArray  #: (M, 3) [m], places of contacts
    log_ratios: FloatArray  #: (M,), mean log (error of smooth / error of sharp) at each place

    __repr__ = short_repr

    @classmethod
    @with_advice
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> BlendedImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        For arguments and errors see `prepare_contacts`.
        """
        prepared = prepare_contacts(contacts, position_noise, normal_noise)
        sharp = PatchImplicitSurface.from_contacts(prepared)
        with_noise = prepared.with_noise(sharp.position_noise, sharp.normal_noise)
        bound = GaussianProcessImplicitSurface.from_contacts(with_noise)
        smooth = SmoothImplicitSurface.beside(bound, prepared)
        places, normals = prepared.places, sharp.normals
        log_ratios = np.zeros(len(places.nodes))
        if len(places.nodes) >= LEAST_PLACES:
            folds = (np.arange(len(places.nodes)) % _FOLDS)[places.place]
            of_sharp = log_errors(_predict_left_out(sharp, folds), normals, places)
            log_ratios = log_errors(smooth.free.leave_groups_out(folds), normals, places) - of_sharp
        return cls(sharp, smooth, sharp.points[places.nodes], log_ratios)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.sharp.bounds

    @property
    def spacing(self) -> float:
        """Spacing of the places of contacts [m]."""
        return self.sharp.spacing

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = self.smooth.evaluate(rows)
        some, weights, differences = self._weights_and_differences(rows, values)
        values[some] += weights * self._agreement(differences)[0] * differences
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        values, gradients = self.smooth.evaluate(rows), self.smooth.gradient(rows)
        some, weights = self._weights(rows)
        sharp, sharp_gradients = self.sharp.value_and_gradient(rows[some])
        differences, steps = sharp - values[some], sharp_gradients - gradients[some]
        agreement, fall = self._agreement(differences)
        # d(w v D) = w (v + v'(D) D) dD + v D dw
        gradients[some] += (weights * (agreement + fall * differences))[:, None] * steps
        gradients[some] += (agreement * differences)[:, None] * self._weight_slopes(rows[some])
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The deviation of a mixture: patches weigh less, the farther they are from the smooth
        estimate.
        """
        rows, shape = flat_points(points)
        values = self.smooth.evaluate(rows)
        moments = self.smooth.uncertainty(rows) ** 2
        some, weights, differences = self._weights_and_differences(rows, values)
        weights = weights * np.maximum(1.0 - np.abs(differences) / (_FAR * self.spacing), 0.0)
        moments[some] += weights * (self.sharp.uncertainty(rows[some]) ** 2 - moments[some])
        moments[some] += weights * (1.0 - weights) * differences**2
        return np.sqrt(moments).reshape(shape)

    def _agreement(self, differences: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return v, 1 where the estimates are close and 0 where far apart, and its derivative."""
        return agreement(differences, _NEAR * self.spacing, _FAR * self.spacing)

    def _weights_and_differences(
        self, points: FloatArray, smooth: FloatArray
    ) -> tuple[IndexArray, FloatArray, FloatArray]:
        """Return the points with w above 0, (Q,), their w, and sharp - smooth there [m]."""
        some, weights = self._weights(points)
        return some, weights, self.sharp.evaluate(points[some]) - smooth[some]

    def _weights(self, points: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Return the points with w above 0, (Q,), and their w."""
        evidence = map_rows(lambda x: self._evidence(x)[0], points, len(self.places))
        weights, _ = smoothstep(evidence, _NO_WEIGHT, _FULL_WEIGHT)
        some = np.flatnonzero(weights > 0.0)
        return some, weights[some]

    def _weight_slopes(self, points: FloatArray) -> FloatArray:
        """Return the gradient of w at points, (P, 3)."""
        answers = map_rows(self._evidence_and_slopes, points, len(self.places))
        _, rises = smoothstep(answers[:, 0], _NO_WEIGHT, _FULL_WEIGHT)
        return rises[:, None] * answers[:, 1:]

    def _evidence(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the evidence for the sharp estimate at points, (P,), and the places' weights.

        A mean of the log ratios, shrunk to that of all places, with weights of shape (M, P), and
        their sum, (P,), beside that of the prior.
        """
        center = self.places[0]
        weights = squared_distances(self.places - center, points - center)
        weights *= -0.5 / (_SIGMA * self.spacing) ** 2
        np.exp(weights, out=weights)
        sums = np.stack([np.ones_like(self.log_ratios), self.log_ratios]) @ weights  # (2, P)
        total = sums[0] + _PRIOR_PLACES
        return (sums[1] + _PRIOR_PLACES * _overall(self.log_ratios)) / total, weights, total

    def _evidence_and_slopes(self, points: FloatArray) -> FloatArray:
        """Return the evidence and its gradient at points, shape (P, 4)."""
        evidence, weights, total = self._evidence(points)
        pulls = (weights / total * (self.log_ratios[:, None] - evidence)).T
        towards = pulls @ self.places - pulls.sum(axis=1)[:, None] * points
        return np.column_stack([evidence, towards / (_SIGMA * self.spacing) ** 2])


def _overall(log_ratios: FloatArray) -> float:
    """Return the evidence of all places for patches, (M,), less half a standard error."""
    count, deviation = len(log_ratios), float(log_ratios.std())
    mean = float(log_ratios.sum()) / (count + _PRIOR_PLACES)
    return mean - _CAUTION * deviation / float(np.sqrt(count))


def _predict_left_out(
    sharp: PatchImplicitSurface, folds: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return f, shape (N,), and gradient, (N, 3), at contacts, estimated without their fold."""
    values, gradients = np.empty(len(folds)), np.empty((len(folds), 3))
    for fold in np.unique(folds):
        left_out = folds == fold
        values[left_out], gradients[left_out] = sharp.without(left_out).value_and_gradient(
            sharp.points[left_out]
        )
    return values, gradients
