"""Smooth implicit surface: a Gaussian process with free gradient lengths, settings by contacts.

f = bound + v (free - bound)

The free process has the Matern 7/2 kernel that predicts left-out places best, and observes
directions of gradients only; it is the bound one where that predicts better. v falls from 1 to
0 where it is a quarter to half a spacing from the bound one, which is `gpis`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.guesses import with_advice
from lis_grasp.records import short_repr
from lis_grasp.surfaces.contact_places import agreement, log_errors
from lis_grasp.surfaces.contact_preparation import PreparedContacts, prepare_contacts
from lis_grasp.surfaces.gaussian_process_implicit_surface import (
    MOST_FOR_SETTINGS,
    GaussianProcessImplicitSurface,
)
from lis_grasp.surfaces.queries import Predicting, flat_points
from lis_grasp.typing import FloatArray
from lis_grasp.underflow import methods_underflow

# Length of the kernel in largest distances between two contacts, and whether it is stretched; None
# for `gpis`. The first is the default: another is chosen if it predicts places that are left out
# better, by more than a standard error.
_CHOICES = ((0.8, False), (0.6, False), (0.8, True), None)
_CAUTION = 1.0

LEAST_PLACES = 4
"""Places without which nothing is compared or chosen."""

# Shared by all: normals bind the direction of gradients only.
_SETTINGS: Mapping[str, Any] = MappingProxyType(
    {"kernel": "matern72", "misfit": (0.0003, 0.02), "length_noise": 1.0}
)

# Distance from `gpis` at which the estimate begins to become that, and is that, in spacings.
_NEAR, _FAR = 0.25, 0.5

# Standard deviation of the surface where the processes differ, as a fraction of the difference.
_DOUBT = 0.35


@methods_underflow
@dataclass(frozen=True, slots=True, eq=False)
class SmoothImplicitSurface(Predicting):
    """A Gaussian process for shapes without edges, smoother than `gpis`.

    Made by `from_contacts`. Near contacts f is about metric.

    Examples
    --------
    >>> surface = SmoothImplicitSurface.from_contacts(contacts)
    >>> bool(surface.evaluate([0.0, 0.0, 0.0]) < 0.0)  # inside
    True
    """

    free: GaussianProcessImplicitSurface  #: that with gradients of free length, or `bound` too
    bound: GaussianProcessImplicitSurface  #: that with gradients of length 1, `gpis`
    spacing: float  #: of the places of contacts [m]

    __repr__ = short_repr

    @classmethod
    @with_advice
    def from_contacts(
        cls,
        contacts: Contacts | PreparedContacts,
        *,
        position_noise: float | None = None,
        normal_noise: float | None = None,
    ) -> SmoothImplicitSurface:
        """Estimate the surface of an object from at least one contact.

        For arguments and errors see `prepare_contacts`.
        """
        prepared = prepare_contacts(contacts, position_noise, normal_noise)
        bound = GaussianProcessImplicitSurface.from_contacts(prepared)
        return cls.beside(bound, prepared)

    @classmethod
    def beside(
        cls, bound: GaussianProcessImplicitSurface, prepared: PreparedContacts
    ) -> SmoothImplicitSurface:
        """Return the estimate that blends with a `gpis` of the same contacts."""
        few = prepared.thinned(MOST_FOR_SETTINGS)
        plain = bound if few is prepared else GaussianProcessImplicitSurface.from_contacts(few)
        best, places = 0, few.places
        processes = [_free(few, _CHOICES[0], plain)]
        if len(places.nodes) >= LEAST_PLACES:
            processes += [_free(few, choice, plain) for choice in _CHOICES[1:]]
            predicted = (process.leave_groups_out(places.place) for process in processes)
            errors = np.stack([log_errors(p, few.contacts.normals, places) for p in predicted])
            gains = errors[0] - errors  # (choices, places)
            doubt = gains.std(axis=1) / np.sqrt(len(places.nodes))
            best = int(np.argmax(gains.mean(axis=1) - _CAUTION * doubt))
        free = processes[best] if few is prepared else _free(prepared, _CHOICES[best], bound)
        return cls(free, bound, prepared.places.spacing)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.bound.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        values = self.bound.evaluate(points)
        differences = self.free.evaluate(points) - values
        return np.asarray(values + self._agreement(differences)[0] * differences)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3)."""
        rows, shape = flat_points(points)
        gradients = self.bound.gradient(rows)
        differences = self.free.evaluate(rows) - self.bound.evaluate(rows)
        near, fall = self._agreement(differences)
        steps = self.free.gradient(rows) - gradients
        return np.asarray(gradients + (near + fall * differences)[:, None] * steps).reshape(
            *shape, 3
        )

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        The deviation of the free process, and a part of its difference from the bound one.
        """
        differences = self.free.evaluate(points) - self.bound.evaluate(points)
        return np.hypot(self.free.uncertainty(points), _DOUBT * differences)

    def _agreement(self, differences: FloatArray) -> tuple[FloatArray, FloatArray]:
        return agreement(differences, _NEAR * self.spacing, _FAR * self.spacing)


def _free(
    prepared: PreparedContacts,
    choice: tuple[float, bool] | None,
    bound: GaussianProcessImplicitSurface,
) -> GaussianProcessImplicitSurface:
    """Return the free process with one of the choices; `bound` is `gpis` of the contacts."""
    if choice is None:
        return bound
    factor, stretch = choice
    return GaussianProcessImplicitSurface.from_contacts(
        prepared, length=factor * prepared.scale, stretch=stretch, **_SETTINGS
    )
