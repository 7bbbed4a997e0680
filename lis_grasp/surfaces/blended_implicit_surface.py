"""A sharp and a smooth estimate of one object, each where it foretells contacts better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import pdist

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_merging import SMALLEST, merge_duplicates, spacing_of
from lis_grasp.surfaces.gaussian_process import GaussianProcessImplicitSurface
from lis_grasp.surfaces.kernel_mean import KernelMean
from lis_grasp.surfaces.patch_implicit_surface import PatchImplicitSurface
from lis_grasp.surfaces.queries import compact_blocks, flat_points, require_contacts
from lis_grasp.typing import FloatArray, IndexArray

Estimator = Callable[[Contacts], PatchImplicitSurface]
Function = Callable[[FloatArray], FloatArray]

# Groups of contacts that are foretold from all others.
_FOLDS = 4

# Fewer contacts say nothing about which estimate is better; with more, the Gaussian process takes
# seconds, and patches are told apart without its help.
_LEAST_CONTACTS = 10
_MOST_CONTACTS = 400

# What a normal that is wrong by 1 counts, and the error that is as good as none, in spacings.
_NORMAL_ERROR = 0.25
_ERROR_FLOOR = 0.02

# Over how many spacings errors are averaged.
_SIGMA = 1.2

# How many times the smooth estimate's error the sharp one's must be to be given up altogether.
_WORSE = 2.0

# Distances are the same up to this share of the largest.
_SAME_REMOTENESS = 1e-9

# How many times as large as the Gaussian process took it an object may turn out to be.
_OUTGROWN = 1.3

_BLOCK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class BlendedImplicitSurface:
    """Patches where they foretell contacts, a Gaussian process where that does better.

    f = w sharp + (1 - w) smooth

    Contacts left out are foretold by either estimate from all others, and the errors averaged over
    neighbouring contacts (geometric means, weighted by a kernel). w is 1 where the sharp estimate's
    errors are no larger than the smooth one's, 0 where they are twice as large or more, and goes
    smoothly between (3 t^2 - 2 t^3 of the logarithm). So f is sharp in doubt: where a smooth
    estimate is wrong, it is wrong at edges, which lie between contacts and are not among what is
    foretold. A bend of 90 degrees between two touches looks like an edge to any test of pairs; that
    the smooth estimate foretells such touches, and the sharp one does not, gives it away.

    Made by `from_contacts`. Near the surface f is about a distance.

    Parameters
    ----------
    sharp, smooth
        The two estimates; smooth is None where sharp stands alone.
    log_ratios
        Shape (N,), log (error of smooth / error of sharp) at each contact.
    mean
        Over contacts.
    spacing
        Of the contacts [m].
    remake
        `from_contacts` with the options that this surface was made with.
    """

    sharp: PatchImplicitSurface
    smooth: GaussianProcessImplicitSurface | None
    log_ratios: FloatArray
    mean: KernelMean
    spacing: float
    remake: Callable[[Contacts], BlendedImplicitSurface]

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
        margin: float | None = None,
    ) -> BlendedImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        Below 10 contacts, and above 400, the sharp estimate stands alone.

        Parameters
        ----------
        contacts
            Where the object was touched; duplicates are merged first.
        position_noise, normal_noise
            One standard deviation of contacts along their normals [m] and of each component of
            the normals [rad]; None takes what either estimate takes.
        margin
            By how much bounds exceed the contacts' box [m]; None takes one spacing.

        Raises
        ------
        InvalidContactsError
            If there is no contact.
        InvalidOptionError
            If an option is outside its range.
        """
        require_contacts(contacts)
        remake = partial(
            cls.from_contacts,
            position_noise=position_noise,
            normal_noise=normal_noise,
            margin=margin,
        )
        merged = merge_duplicates(contacts, position_noise)
        spacing = spacing_of(merged)
        noise = {"position_noise": position_noise, "normal_noise": normal_noise}
        told: dict[str, Any] = {name: value for name, value in noise.items() if value is not None}

        def sharp(some: Contacts) -> PatchImplicitSurface:
            return PatchImplicitSurface.from_contacts(some, margin=margin, **told)

        def smooth(some: Contacts) -> GaussianProcessImplicitSurface:
            return GaussianProcessImplicitSurface.from_contacts(some, margin=margin, **told)

        mean = KernelMean.of(merged.points, _SIGMA * spacing)
        if not _LEAST_CONTACTS <= len(merged) <= _MOST_CONTACTS:
            return cls(sharp(merged), None, np.zeros(len(merged)), mean, spacing, remake)
        folds = _folds(merged)
        whole = smooth(merged)
        foretold = _foretell_folds(sharp, merged, folds), whole.leave_groups_out(folds)
        of_sharp, of_smooth = (_log_errors(*f, merged, spacing) for f in foretold)
        return cls(sharp(merged), whole, of_smooth - of_sharp, mean, spacing, remake)

    def with_contacts(self, new: Contacts) -> BlendedImplicitSurface:
        """Return the estimate from the new contacts too, several times faster than from scratch.

        The new contacts are foretold by the estimates as they were before them (prequential
        validation, Dawid 1984), what is known of the others stays, and the Gaussian process is
        extended. Contacts that were there early were foretold from few: after many additions an
        estimate from scratch judges better. It is made where the object turns out to be larger than
        what was touched at first.
        """
        every = Contacts(self.sharp.points, self.sharp.normals).append(new)
        if (
            self.smooth is None
            or len(every) > _MOST_CONTACTS
            or pdist(every.points).max() > _OUTGROWN * self.smooth.scale
        ):
            return self.remake(every)
        of_smooth, of_sharp = (
            _log_errors(
                surface.evaluate(new.points), surface.gradient(new.points), new, self.spacing
            )
            for surface in (self.smooth, self.sharp)
        )
        sharp = self.sharp.with_contacts(new)
        return BlendedImplicitSurface(
            sharp=sharp,
            smooth=self.smooth.with_contacts(new),
            log_ratios=np.concatenate([self.log_ratios, of_smooth - of_sharp]),
            mean=KernelMean.of(np.vstack([self.mean.nodes, new.points]), _SIGMA * sharp.spacing),
            spacing=sharp.spacing,
            remake=self.remake,
        )

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is meant, shape (2, 3) [m]."""
        return self.sharp.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        if self.smooth is None:
            return self.sharp.evaluate(rows).reshape(shape)
        weights, _ = self._weights(rows, with_gradient=False)
        return self._mix(weights, self.sharp.evaluate, self.smooth.evaluate, rows).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the exact gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        if self.smooth is None:
            return self.sharp.gradient(rows).reshape(*shape, 3)
        weights, slopes = self._weights(rows, with_gradient=True)
        gradients = self._mix(weights, self.sharp.gradient, self.smooth.gradient, rows)
        both = np.flatnonzero((weights > 0.0) & (weights < 1.0))
        difference = self.sharp.evaluate(rows[both]) - self.smooth.evaluate(rows[both])
        gradients[both] += difference[:, None] * slopes[both]
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        That of a mixture: the weighted mean of both variances, and where both count what they
        differ by.
        """
        rows, shape = flat_points(points)
        if self.smooth is None:
            return self.sharp.uncertainty(rows).reshape(shape)
        weights, _ = self._weights(rows, with_gradient=False)
        second_moments = self._mix(
            weights,
            lambda x: self.sharp.uncertainty(x) ** 2,
            lambda x: self.smooth.uncertainty(x) ** 2,  # type: ignore[union-attr]
            rows,
        )
        both = np.flatnonzero((weights > 0.0) & (weights < 1.0))
        difference = self.sharp.evaluate(rows[both]) - self.smooth.evaluate(rows[both])
        second_moments[both] += weights[both] * (1.0 - weights[both]) * difference**2
        return np.sqrt(second_moments).reshape(shape)

    def _mix(
        self, weights: FloatArray, sharp: Function, smooth: Function, points: FloatArray
    ) -> FloatArray:
        """Return the weighted mean of two functions, asking each only where it counts."""
        some, rest = np.flatnonzero(weights > 0.0), np.flatnonzero(weights < 1.0)
        of_sharp, of_smooth = sharp(points[some]), smooth(points[rest])
        mixed = np.zeros((len(points), *of_sharp.shape[1:]))
        columns = (slice(None), *[None] * (of_sharp.ndim - 1))
        mixed[some] += weights[some][columns] * of_sharp
        mixed[rest] += (1.0 - weights[rest])[columns] * of_smooth
        return mixed

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
        t = np.clip(1.0 + ratios / np.log(_WORSE), 0.0, 1.0)
        weights = t * t * (3.0 - 2.0 * t)
        return weights, (6.0 * t * (1.0 - t) / np.log(_WORSE))[:, None] * slopes


def _folds(contacts: Contacts) -> IndexArray:
    """Return which contacts are left out together, shape (N,): every fourth, from the centroid out.

    In order of distance from the centroid the choice does not depend on the order of contacts, nor
    on the frame, unless some are equally far: of those the coordinates decide.
    """
    relative = contacts.points - contacts.points.mean(axis=0)
    remoteness = np.linalg.norm(relative, axis=1)
    keys = np.column_stack([remoteness, relative])
    keys = np.round(keys / max(_SAME_REMOTENESS * remoteness.max(), SMALLEST))
    rank = np.empty(len(contacts), dtype=np.intp)
    rank[np.lexsort(keys.T[::-1])] = np.arange(len(contacts))
    return rank % _FOLDS


def _foretell_folds(
    estimate: Estimator, contacts: Contacts, folds: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return f, shape (N,), and gradient, (N, 3), at contacts, estimated without their fold."""
    values, gradients = np.empty(len(contacts)), np.empty((len(contacts), 3))
    for fold in range(_FOLDS):
        left_out = folds == fold
        surface = estimate(contacts.subset(~left_out))
        values[left_out], gradients[left_out] = surface.value_and_gradient(
            contacts.points[left_out]
        )
    return values, gradients


def _log_errors(
    values: FloatArray, gradients: FloatArray, contacts: Contacts, spacing: float
) -> FloatArray:
    """Return the logarithm of how badly each contact was foretold, shape (N,), in spacings.

    The contact's distance from the surface, at most one spacing, plus a quarter spacing times the
    length by which the unit normals differ.
    """
    slopes = np.linalg.norm(gradients, axis=1)
    distances = np.abs(values) / np.maximum(slopes, 0.3) / spacing
    units = gradients / np.maximum(slopes, 1e-9)[:, None]
    tilts = np.linalg.norm(units - contacts.normals, axis=1)
    return np.log(np.minimum(distances, 1.0) + _NORMAL_ERROR * tilts + _ERROR_FLOOR)
