"""Measured extents: an object ends at a tangent plane that has all contacts behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.geometry import unit
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces._contact_noise import noise_of
from lis_grasp.surfaces._gaussian_process_regression import squared_distances
from lis_grasp.surfaces.carved_implicit_surface import FreeSpace
from lis_grasp.surfaces.contact_places import SMALLEST
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.queries import map_rows
from lis_grasp.typing import FloatArray

# An estimate's normal at a contact deviates by this fraction of the contact's own noise.
_OF_NORMAL_NOISE = 0.5

# Standard deviations by which others may be in front of a plane, and the surface beyond it.
_WITHIN = 2.0

# A plane holds as far as this fraction of the way to the nearest contact in front of it.
_HALFWAY = 0.5

# Distance at which a plane that has no contact in front of it ends, too [m].
_EVERYWHERE = 10.0

# Smallest deviation that slopes are divided by [m].
_TINY = 1e-12

# Median of the absolute value of a normal error, and of the length of two, in standard deviations.
_MEDIAN, _MEDIAN_OF_TWO = 0.6745, 1.1774


@dataclass(frozen=True, slots=True, eq=False)
class BeyondExtents(FreeSpace, Record):
    """Space beyond tangent planes of contacts, by more than two standard deviations.

    depth = max_i min(n_i (x - p_i) - 2 sqrt(s_i^2 + (a_i l_i)^2), r_i - |x - p_i|)

    l_i is the distance of x from p_i along the plane. Made by `measured_extents`.
    """

    points: FloatArray  #: (K, 3) [m], in O: the contacts
    normals: FloatArray  #: (K, 3), unit: of the planes
    position_deviations: FloatArray  #: (K,) [m], s: of the planes at their contacts
    normal_deviations: FloatArray  #: (K,) [rad], a: of their normals
    reaches: FloatArray  #: (K,) [m], r: how far from its contact each plane holds

    __repr__ = short_repr

    @property
    def closes(self) -> bool:
        """True: the contacts show that the object ends there."""
        return True

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] and their gradients (P, 3); see `FreeSpace`."""

        def deepest(chosen: FloatArray) -> FloatArray:
            heights, deviations, distances = self._above(chosen)
            over, within = heights - _WITHIN * deviations, self.reaches - distances
            depths = np.minimum(over, within)
            plane, row = np.argmax(depths, axis=1), np.arange(len(chosen))
            away, normals = chosen - self.points[plane], self.normals[plane]
            level = away - heights[row, plane, None] * normals
            growth = self.normal_deviations[plane] ** 2 / np.maximum(deviations[row, plane], _TINY)
            slopes = normals - _WITHIN * growth[:, None] * level
            ends = within[row, plane] < over[row, plane]
            slopes[ends] = -away[ends] / np.maximum(distances[row, plane], _TINY)[ends, None]
            return np.column_stack([depths[row, plane], slopes])

        found = map_rows(deepest, points, len(self.points))
        return found[:, 0], found[:, 1:]

    def _above(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return how points (P, 3) lie to each plane, (P, K) [m].

        That is their heights above it, its deviations there, and distances from its contact.
        """
        center = self.points[0]  # rounding grows with the distance from it
        own, relative = self.points - center, points - center
        heights = relative @ self.normals.T - np.einsum("ki,ki->k", own, self.normals)
        squares = squared_distances(own, relative).T
        along = np.maximum(squares - heights**2, 0.0)
        variances = self.position_deviations**2 + self.normal_deviations**2 * along
        return heights, np.sqrt(variances), np.sqrt(squares)

    def reaching(self, others: FloatArray) -> BeyondExtents:
        """Return the same, as far as half the way to those of `others` (N, 3) [m] in front."""
        heights, deviations, distances = self._above(others)
        both = np.hypot(deviations, self.position_deviations)  # the other contact's, too
        in_front = heights > _WITHIN * both + SMALLEST
        nearest = np.where(in_front, distances, _EVERYWHERE / _HALFWAY).min(axis=0)
        return replace(self, reaches=_HALFWAY * nearest)


def measured_extents(
    surface: ImplicitSurface,
    contacts: Contacts,
    position_noise: float | None = None,
    normal_noise: float | None = None,
) -> tuple[BeyondExtents, ...]:
    """Return the space beyond the extents that contacts measured: one member, or none.

    Between contacts an estimate may go on beyond them, as planes do that meet no other plane. If
    all contacts are behind the tangent plane of one, this one measured how far the object extends
    in the plane's direction: a part beyond the plane would have been met by no touch. The plane of
    a contact in a cavity has others in front of it: it holds half the way to the nearest of these.
    A contact whose normal the estimate contradicts has no plane.

    Parameters
    ----------
    surface
        The estimate, whose gradients are the planes' normals.
    contacts
        Credible contacts, at least one, in O.
    position_noise, normal_noise
        Noise [m], [rad] of contacts that do not carry their own; None if it is unknown: then it is
        the median departure of the contacts from the estimate.
    """
    gradients = surface.gradient(contacts.points)
    lengths = np.linalg.norm(gradients, axis=1)
    agree = np.einsum("ni,ni->n", gradients, contacts.normals) > 0.0  # False for NaN
    usable = np.isfinite(lengths) & agree
    contacts, gradients = contacts.subset(usable), gradients[usable]
    if not len(contacts):
        return ()
    normals = unit(gradients)
    position, normal = noise_of(contacts, position_noise, normal_noise)
    if np.isnan(position).any():
        off = np.abs(surface.evaluate(contacts.points)) / lengths[usable]
        position = np.where(np.isnan(position), np.median(off) / _MEDIAN, position)
    if np.isnan(normal).any():
        cosines = np.einsum("ni,ni->n", normals, contacts.normals)
        turned = np.arccos(np.clip(cosines, -1.0, 1.0))
        normal = np.where(np.isnan(normal), np.median(turned) / _MEDIAN_OF_TWO, normal)
    everywhere = np.full(len(normals), _EVERYWHERE)
    deviation = _OF_NORMAL_NOISE * normal
    planes = BeyondExtents(contacts.points, normals, position, deviation, everywhere)
    return (planes.reaching(contacts.points),)
