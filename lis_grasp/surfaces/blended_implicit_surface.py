"""Blend of a sharp and a smooth estimate, weighted by cross-validation error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import SMALLEST, merge_duplicates, spacing_of
from lis_grasp.surfaces.gaussian_process import GaussianProcessImplicitSurface
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.queries import compact_blocks, flat_points
from lis_grasp.typing import FloatArray, IndexArray

Function = Callable[[FloatArray], FloatArray]

# Folds of the cross-validation.
_FOLDS = 4

# Fewer contacts cannot compare the estimates; with more, the Gaussian process takes seconds.
_LEAST_CONTACTS = 10
_MOST_CONTACTS = 400

# Weight of a normal's error of 1, and the error that is as good as none, in spacings.
_NORMAL_ERROR = 0.25
_ERROR_FLOOR = 0.02

# Width of the kernel that averages errors, in spacings.
_SIGMA = 1.2

# The sharp estimate has no weight where its error is this many times the smooth one's.
_WORSE = 2.0

# Distances that differ by less, as a fraction of the largest, are equal.
_EQUAL_DISTANCES = 1e-9

_BLOCK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class BlendedImplicitSurface:
    """Weighted mean of a patch surface and a Gaussian process, by their prediction errors.

    f = w sharp + (1 - w) smooth

    Either estimate predicts left-out contacts from all others (4-fold cross-validation). The errors
    are averaged over neighbouring contacts (geometric means, weighted by a kernel). w is 1 where
    the sharp estimate's error is no larger than the smooth one's, and 0 where it is twice as large
    or more, with a smoothstep (3 t^2 - 2 t^3) of the logarithm between. So f is sharp in doubt: a
    smooth estimate is wrong at edges, which are between contacts and therefore not validated. A
    bend of 90 degrees between two touches looks like an edge to any test of pairs; there the smooth
    estimate predicts the touches, and the sharp one does not.

    Made by `from_contacts`. Near the surface f is about a distance.
    """

    sharp: PatchImplicitSurface  #: the estimate with sharp edges
    smooth: GaussianProcessImplicitSurface | None  #: None where the sharp estimate is used alone
    log_ratios: FloatArray  #: (N,), log (error of smooth / error of sharp) at each contact
    mean: KernelMean  #: kernel-weighted mean over contacts

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> BlendedImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Below 10 contacts, and above 400, the sharp estimate is used alone.

        Parameters
        ----------
        contacts
            Measured on the object; duplicates are merged first.
        position_noise, normal_noise
            One standard deviation of contacts along their normals [m] and of each component of
            the normals [rad]; None takes the default of either estimate.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range.
        """
        merged = merge_duplicates(contacts, position_noise)
        spacing = spacing_of(merged)
        noise = {"position_noise": position_noise, "normal_noise": normal_noise}
        given: dict[str, Any] = {name: value for name, value in noise.items() if value is not None}

        def fit_sharp(some: Contacts) -> PatchImplicitSurface:
            return PatchImplicitSurface.from_contacts(some, **given)

        mean = KernelMean.of(merged.points, _SIGMA * spacing)
        if not _LEAST_CONTACTS <= len(merged) <= _MOST_CONTACTS:
            return cls(fit_sharp(merged), None, np.zeros(len(merged)), mean)
        folds = _folds(merged)
        smooth = GaussianProcessImplicitSurface.from_contacts(merged, **given)
        predictions = _predict_left_out(fit_sharp, merged, folds), smooth.leave_groups_out(folds)
        of_sharp, of_smooth = (_log_errors(*p, merged, spacing) for p in predictions)
        return cls(fit_sharp(merged), smooth, of_smooth - of_sharp, mean)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.sharp.bounds

    @property
    def spacing(self) -> float:
        """Spacing of the contacts [m]."""
        return self.sharp.spacing

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        if self.smooth is None:
            return self.sharp.evaluate(rows).reshape(shape)
        weights, _ = self._weights(rows, with_gradient=False)
        return _mix(weights, self.sharp.evaluate, self.smooth.evaluate, rows).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        if self.smooth is None:
            return self.sharp.gradient(rows).reshape(*shape, 3)
        weights, slopes = self._weights(rows, with_gradient=True)
        gradients = _mix(weights, self.sharp.gradient, self.smooth.gradient, rows)
        both = np.flatnonzero((weights > 0.0) & (weights < 1.0))
        difference = self.sharp.evaluate(rows[both]) - self.smooth.evaluate(rows[both])
        gradients[both] += difference[:, None] * slopes[both]
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        That of a mixture: the weighted mean of both variances, and the variance between both.
        """
        rows, shape = flat_points(points)
        smooth = self.smooth
        if smooth is None:
            return self.sharp.uncertainty(rows).reshape(shape)
        weights, _ = self._weights(rows, with_gradient=False)
        second_moments = _mix(
            weights,
            lambda x: self.sharp.uncertainty(x) ** 2,
            lambda x: smooth.uncertainty(x) ** 2,
            rows,
        )
        both = np.flatnonzero((weights > 0.0) & (weights < 1.0))
        difference = self.sharp.evaluate(rows[both]) - smooth.evaluate(rows[both])
        second_moments[both] += weights[both] * (1.0 - weights[both]) * difference**2
        return np.sqrt(second_moments).reshape(shape)

    def _weights(self, points: FloatArray, *, with_gradient: bool) -> tuple[FloatArray, FloatArray]:
        """Return w at points, shape (P,), and its gradient, shape (P, 3)."""

        def constant(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            return np.full(len(seen), self.log_ratios[node]), np.zeros((len(seen), 3))

        ratios, slopes = np.empty(len(points)), np.empty((len(points), 3))
        for index in compact_blocks(points, _BLOCK):
            near, weights = self.mean.weights(points[index])
            ratios[index], slopes[index] = self.mean.average(
                points[index], near, weights, constant, with_gradient=with_gradient
            )
        t = np.clip(1.0 + ratios / np.log(_WORSE), 0.0, 1.0)
        slopes *= (6.0 * t * (1.0 - t) / np.log(_WORSE))[:, None]
        return t * t * (3.0 - 2.0 * t), slopes


def _mix(weights: FloatArray, sharp: Function, smooth: Function, points: FloatArray) -> FloatArray:
    """Return the weighted mean of two functions, each evaluated where its weight is not 0."""
    some, rest = np.flatnonzero(weights > 0.0), np.flatnonzero(weights < 1.0)
    of_sharp, of_smooth = sharp(points[some]), smooth(points[rest])
    mixed = np.zeros((len(points), *of_sharp.shape[1:]))
    columns = (slice(None), *[None] * (of_sharp.ndim - 1))
    mixed[some] += weights[some][columns] * of_sharp
    mixed[rest] += (1.0 - weights[rest])[columns] * of_smooth
    return mixed


def _folds(contacts: Contacts) -> IndexArray:
    """Return the fold of each contact, shape (N,): every fourth, in order from the centroid."""
    # Independent of the order of contacts; of the frame, too, except for equal distances.
    relative = contacts.points - contacts.points.mean(axis=0)
    distances = np.linalg.norm(relative, axis=1)
    keys = np.column_stack([distances, relative])
    keys = np.round(keys / max(_EQUAL_DISTANCES * distances.max(), SMALLEST))
    rank = np.empty(len(contacts), dtype=np.intp)
    rank[np.lexsort(keys.T[::-1])] = np.arange(len(contacts))
    return rank % _FOLDS


def _predict_left_out(
    fit: Callable[[Contacts], PatchImplicitSurface], contacts: Contacts, folds: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return f, shape (N,), and gradient, (N, 3), at contacts, estimated without their fold."""
    values, gradients = np.empty(len(contacts)), np.empty((len(contacts), 3))
    for fold in range(_FOLDS):
        left_out = folds == fold
        surface = fit(contacts.subset(~left_out))
        values[left_out], gradients[left_out] = surface.value_and_gradient(
            contacts.points[left_out]
        )
    return values, gradients


def _log_errors(
    values: FloatArray, gradients: FloatArray, contacts: Contacts, spacing: float
) -> FloatArray:
    """Return the logarithm of each contact's prediction error in distance and normal, (N,)."""
    slopes = np.linalg.norm(gradients, axis=1)
    distances = np.abs(values) / np.maximum(slopes, 0.3) / spacing
    units = gradients / np.maximum(slopes, 1e-9)[:, None]
    tilts = np.linalg.norm(units - contacts.normals, axis=1)
    return np.log(np.minimum(distances, 1.0) + _NORMAL_ERROR * tilts + _ERROR_FLOOR)
