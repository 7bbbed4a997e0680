"""A sharp and a smooth estimate of one object, each where it foretells contacts better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import merge_duplicates, spacing_of
from lis_grasp.surfaces.gaussian_process import GaussianProcessImplicitSurface
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.queries import compact_blocks, flat_points, require_contacts

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

Estimator = Callable[[Contacts], ImplicitSurface]

# Groups of contacts that are foretold from all others.
_FOLDS = 8

# Fewer contacts say nothing about which estimate is better; with more, the Gaussian process takes
# seconds, and patches are told apart without its help.
_LEAST_CONTACTS = 2 * _FOLDS
_MOST_CONTACTS = 400

# What a normal that is wrong by 1 counts, and the error that is as good as none, in spacings.
_NORMAL_ERROR = 0.25
_ERROR_FLOOR = 0.02

# Over how many spacings errors are averaged, and how fast the better estimate takes over.
_SIGMA = 1.2
_GAIN = 5.0

# How much worse (its logarithm) the sharp estimate must foretell to count as equal: where a smooth
# estimate is wrong, it is wrong at edges, which lie between contacts.
_BENEFIT_OF_DOUBT = 0.6

_BLOCK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class BlendedImplicitSurface:
    """Patches where they foretell contacts, a Gaussian process where that does better.

    f = w sharp + (1 - w) smooth,   w(x) = 1 / (1 + exp(-gain (m(x) + 0.6)))

    with m the kernel-weighted mean over contacts of log (error of smooth / error of sharp), errors
    by cross-validation. In doubt f is sharp. A bend of 90 degrees between two touches looks like
    an edge to any test of pairs; that the smooth estimate foretells such touches, and the sharp
    one does not, gives it away.

    Made by `from_contacts`. Near the surface f is about a distance.

    Parameters
    ----------
    sharp, smooth
        The two estimates; smooth is None where sharp stands alone.
    log_ratios
        Shape (N,), log (error of smooth / error of sharp) at each contact.
    mean
        Over contacts.
    """

    sharp: ImplicitSurface
    smooth: ImplicitSurface | None
    log_ratios: FloatArray
    mean: KernelMean

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        sharp: Estimator = PatchImplicitSurface.from_contacts,
        smooth: Estimator = GaussianProcessImplicitSurface.from_contacts,
    ) -> BlendedImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Below 16 contacts, and above 400, the sharp estimate stands alone.

        Parameters
        ----------
        contacts
            Where the object was touched; duplicates are merged first.
        sharp, smooth
            How each estimate is made.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        """
        require_contacts(contacts)
        merged = merge_duplicates(contacts)
        spacing = spacing_of(merged)
        mean = KernelMean.of(merged.points, _SIGMA * spacing)
        if not _LEAST_CONTACTS <= len(merged) <= _MOST_CONTACTS:
            return cls(sharp(merged), None, np.zeros(len(merged)), mean)
        floor = _ERROR_FLOOR * spacing
        log_ratios = np.log(cross_validation_errors(smooth, merged, spacing) + floor)
        log_ratios -= np.log(cross_validation_errors(sharp, merged, spacing) + floor)
        return cls(sharp(merged), smooth(merged), log_ratios, mean)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m]."""
        return self.sharp.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = self.sharp.evaluate(rows)
        if self.smooth is not None:
            weights, _ = self._weights(rows, with_gradient=False)
            values = weights * values + (1.0 - weights) * self.smooth.evaluate(rows)
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        gradients = self.sharp.gradient(rows)
        if self.smooth is not None:
            weights, slopes = self._weights(rows, with_gradient=True)
            gradients = weights[:, None] * gradients
            gradients += (1.0 - weights)[:, None] * self.smooth.gradient(rows)
            difference = self.sharp.evaluate(rows) - self.smooth.evaluate(rows)
            gradients += difference[:, None] * slopes
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        That of a mixture: the weighted mean of both variances.
        """
        rows, shape = flat_points(points)
        variances = self.sharp.uncertainty(rows) ** 2
        if self.smooth is not None:
            weights, _ = self._weights(rows, with_gradient=False)
            smooth = self.smooth.uncertainty(rows) ** 2
            variances = weights * variances + (1.0 - weights) * smooth
        return np.sqrt(variances).reshape(shape)

    def _weights(self, points: FloatArray, *, with_gradient: bool) -> tuple[FloatArray, FloatArray]:
        """Return w at points, shape (P,), and its gradient, shape (P, 3)."""

        def constant(node: int, seen: IndexArray) -> tuple[FloatArray, FloatArray]:
            return np.full(len(seen), self.log_ratios[node]), np.zeros((len(seen), 3))

        ratios, slopes = np.empty(len(points)), np.empty((len(points), 3))
        for index in compact_blocks(points, _BLOCK):
            near, shares = self.mean.shares(points[index])
            ratios[index], slopes[index] = self.mean.superpose(
                points[index], near, shares, constant, with_gradient=with_gradient
            )
        weights = 1.0 / (1.0 + np.exp(-_GAIN * (ratios + _BENEFIT_OF_DOUBT)))
        return weights, (_GAIN * weights * (1.0 - weights))[:, None] * slopes


def cross_validation_errors(estimate: Estimator, contacts: Contacts, spacing: float) -> FloatArray:
    """Return how badly each contact is foretold from others, shape (N,) [m].

    Its distance from the surface, at most one spacing, plus a quarter spacing times the length by
    which the unit normals differ. Every eighth contact is left out at a time, in order of distance
    from the centroid: which are left out together does not depend on order or frame.
    """
    remoteness = np.linalg.norm(contacts.points - contacts.points.mean(axis=0), axis=1)
    rank = np.empty(len(contacts), dtype=np.intp)
    rank[np.argsort(remoteness, kind="stable")] = np.arange(len(contacts))
    errors = np.empty(len(contacts))
    for fold in range(_FOLDS):
        left_out = rank % _FOLDS == fold
        surface = estimate(contacts.subset(~left_out))
        points, normals = contacts.points[left_out], contacts.normals[left_out]
        gradients = surface.gradient(points)
        slopes = np.linalg.norm(gradients, axis=1)
        distances = np.abs(surface.evaluate(points)) / np.maximum(slopes, 0.3)
        tilts = np.linalg.norm(gradients / np.maximum(slopes, 1e-9)[:, None] - normals, axis=1)
        errors[left_out] = np.minimum(distances, spacing) + _NORMAL_ERROR * spacing * tilts
    return errors
