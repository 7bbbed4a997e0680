"""Measured extents: an object ends at each tangent plane that has all of its contacts behind it."""

from __future__ import annotations

from dataclasses import dataclass

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

# A plane supports contacts that are beyond it by at most this many standard deviations.
_WITHIN = 2.0

# Smallest deviation that slopes are divided by [m].
_TINY = 1e-12

# Median of the absolute value of a normal error, and of the length of two, in standard deviations.
_MEDIAN, _MEDIAN_OF_TWO = 0.6745, 1.1774


@dataclass(frozen=True, slots=True, eq=False)
class BeyondExtents(FreeSpace, Record):
    """Space beyond supporting planes of contacts, by more than their standard deviation.

    depth = max_i n_i (x - p_i) - sqrt(s_i^2 + (a_i l_i)^2)

    l_i is the distance of x from p_i along the plane. Made by `measured_extents`.
    """

    points: FloatArray  #: (K, 3) [m], in O: contacts with all others behind their planes
    normals: FloatArray  #: (K, 3), unit: of the planes
    position_deviations: FloatArray  #: (K,) [m], s: of the planes at their contacts
    normal_deviations: FloatArray  #: (K,) [rad], a: of their normals

    __repr__ = short_repr

    @property
    def closes(self) -> bool:
        """True: the contacts show that the object ends there."""
        return True

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] and their gradients (P, 3); see `FreeSpace`."""

        def deepest(chosen: FloatArray) -> FloatArray:
            heights, deviations = self._above(chosen)
            plane, row = np.argmax(heights - deviations, axis=1), np.arange(len(chosen))
            height, deviation = heights[row, plane], deviations[row, plane]
            normals = self.normals[plane]
            level = chosen - self.points[plane] - height[:, None] * normals
            growth = self.normal_deviations[plane] ** 2 / np.maximum(deviation, _TINY)
            return np.column_stack([height - deviation, normals - growth[:, None] * level])

        found = map_rows(deepest, points, len(self.points))
        return found[:, 0], found[:, 1:]

    def _above(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how high points (P, 3) are above each plane, and its deviation there, (P, K)."""
        center = self.points[0]  # rounding grows with the distance from it
        own, relative = self.points - center, points - center
        heights = relative @ self.normals.T - np.einsum("ki,ki->k", own, self.normals)
        squares = squared_distances(own, relative).T - heights**2
        variances = self.normal_deviations**2 * np.maximum(squares, 0.0)
        return heights, np.sqrt(self.position_deviations**2 + variances)

    def supporting(self, others: FloatArray) -> BeyondExtents:
        """Return the planes that have other contacts, (N, 3) [m], behind them, within noise."""
        heights, deviations = self._above(others)
        both = np.hypot(deviations, self.position_deviations)  # the other contact's, too
        kept = (heights <= _WITHIN * both + SMALLEST).all(axis=0)
        return BeyondExtents(
            self.points[kept],
            self.normals[kept],
            self.position_deviations[kept],
            self.normal_deviations[kept],
        )


def measured_extents(
    surface: ImplicitSurface,
    contacts: Contacts,
    position_noise: float | None = None,
    normal_noise: float | None = None,
) -> tuple[BeyondExtents, ...]:
    """Return the space beyond the extents that contacts measured: one member, or none.

    Between contacts an estimate may go on beyond them. Where a tangent plane has all contacts
    behind it, one of them measured how far the object extends in the plane's direction: a part that
    goes beyond it would have been met by no touch. Planes of contacts in a cavity have others in
    front of them, and are left out.

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
    usable = np.isfinite(lengths) & (lengths > 0.0)
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
    planes = BeyondExtents(contacts.points, normals, position, _OF_NORMAL_NOISE * normal)
    planes = planes.supporting(contacts.points)
    return (planes,) if len(planes.points) else ()
