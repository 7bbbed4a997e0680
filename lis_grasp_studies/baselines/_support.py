"""Parts that the baselines have in common: scaled contacts, bounds, uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.contact_places import ContactPlaces, box_of, spacing_of
from lis_grasp.surfaces.contact_preparation import merge_duplicates
from lis_grasp.surfaces.queries import flat_points, require_contacts
from lis_grasp.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """Contacts without duplicates, and a unit frame for them."""

    contacts: Contacts  # without duplicates
    spacing: float  # of them [m]
    center: FloatArray  # (3,) [m], the middle of their box
    scale: float  # their extent [m]
    noise: float  # standard deviation of their positions [m]
    _tree: cKDTree

    @classmethod
    def of(cls, contacts: Contacts, noise: float = 0.0) -> Support:
        """Merge duplicates and prepare; InvalidContactsError if there is no contact."""
        require_contacts(contacts)
        merged = merge_duplicates(contacts)
        spacing = spacing_of(merged)
        center, scale = merged.bounds.mean(axis=0), merged.extent or spacing
        return cls(merged, spacing, center, scale, noise, cKDTree(merged.points))

    def scaled(self, points: FloatArray) -> FloatArray:
        """Return points (P, 3) [m] centred on the contacts and scaled to about unit size."""
        return (points - self.center) / self.scale

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the distance from points (P, 3) to the nearest contact, shape (P,) [m]."""
        return np.asarray(self._tree.query(points)[0])


class BaselineSurface:
    """Bounds and uncertainty of a baseline, both from its field `support`."""

    __slots__ = ()
    support: Support
    error: ClassVar[float]
    """Error that bounds 70 % of the surface of known solids, in units of d^2 / spacing."""
    misfit: ClassVar[float] = 0.0
    """Error at the contacts themselves, in spacings; 0 for what interpolates."""

    @property
    def bounds(self) -> FloatArray:
        """The box of `gpis`, shape (2, 3) [m]."""
        contacts = self.support.contacts
        return box_of(contacts, ContactPlaces.of(contacts.points))

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface, shape (...) [m].

        Calibrated on known solids: `error` d^2 / spacing at a distance d from the nearest contact,
        and independent of it, `misfit` spacings and the noise of positions.
        """
        rows, shape = flat_points(points)
        spacing = self.support.spacing
        between = self.error * self.support.distances(rows) ** 2 / spacing
        at_contacts = np.hypot(self.misfit * spacing, self.support.noise)
        return np.asarray(np.hypot(between, at_contacts)).reshape(shape)
