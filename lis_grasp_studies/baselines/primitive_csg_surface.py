"""CSG of RANSAC primitives: a union of intersections that the contacts do not contradict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.queries import flat_points, map_rows
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp_studies.baselines.baseline_support import BaselineSurface, Support
from lis_grasp_studies.baselines.oriented_primitives import Primitives
from lis_grasp_studies.baselines.primitive_ransac import extract_primitives

# Inliers are within the tolerance, or within this many standard deviations of the noise.
_DEVIATIONS = 2.0
# Numbers held at once by an evaluation.
_CHUNK = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PrimitiveCSGSurface(BaselineSurface):
    """Planes, spheres, cylinders and cones found by RANSAC, joined to a solid.

    f(x) = min over pieces of max over the primitives of a piece of their signed distances

    The piece of some contacts is the intersection of all primitives that contain them. Where a
    contact is inside a piece, its primitive cuts the piece: the contacts of the piece are divided
    by that primitive, and each part has a piece of its own. Near contacts f is a distance [m].
    """

    error: ClassVar[float] = 0.16
    support: Support
    primitives: tuple[Primitives, ...]  # one each
    pieces: tuple[IndexArray, ...]  # indices of primitives

    @classmethod
    def from_contacts(
        cls,
        contacts: Contacts,
        *,
        tolerance: float = 0.02,
        angle: float = 0.1,
        position_noise: float = 0.0,
        normal_noise: float = 0.0,
    ) -> PrimitiveCSGSurface:
        """Fit primitives to at least one contact.

        Parameters
        ----------
        contacts
            Measured on the object; duplicates are merged first.
        tolerance
            Largest distance of a contact from its primitive, in extents of the contacts.
        angle
            Largest angle between its normal and the primitive's [rad].
        position_noise, normal_noise
            Standard deviation of positions [m] and normals [rad]; they widen both limits.
        """
        support = Support.of(contacts)
        points, normals = support.contacts.points, support.contacts.normals
        distance = float(np.hypot(tolerance * support.scale, _DEVIATIONS * position_noise))
        angle = min(float(np.hypot(angle, _DEVIATIONS * normal_noise)), 0.5 * np.pi)
        found = extract_primitives(points, normals, distance=distance, angle=angle)
        primitives = tuple(one for one, _ in found)
        owner = np.empty(len(points), dtype=np.intp)
        for k, (_, members) in enumerate(found):
            owner[members] = k
        values = np.column_stack([p.value_and_gradient(points)[0] for p in primitives])  # (N, K)
        pieces: set[tuple[int, ...]] = set()
        for k in range(len(primitives)):
            pieces |= _pieces(np.flatnonzero(owner == k), values, owner, distance)
        ordered = tuple(np.array(piece, dtype=np.intp) for piece in sorted(pieces))
        return cls(support, primitives, ordered)

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...) [m]."""
        rows, shape = flat_points(points)
        return self._mapped(lambda x: self._chosen(self._values(x))[0], rows).reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points (..., 3), same shape: of the primitive that f is."""
        rows, shape = flat_points(points)
        return self._mapped(self._gradients, rows).reshape(*shape, 3)

    def _mapped(self, function: Callable[[FloatArray], FloatArray], rows: FloatArray) -> FloatArray:
        largest = max(len(self.primitives), *(len(piece) for piece in self.pieces))
        return map_rows(function, rows, max(1, _CHUNK // largest))

    def _values(self, rows: FloatArray) -> FloatArray:
        return np.column_stack([p.value_and_gradient(rows)[0] for p in self.primitives])

    def _chosen(self, values: FloatArray) -> tuple[FloatArray, IndexArray]:
        """Return f (P,) from signed distances (P, K), and the primitive that it is of."""
        lowest = np.full(len(values), np.inf)
        chosen = np.zeros(len(values), dtype=np.intp)
        for piece in self.pieces:
            within = values[:, piece]
            largest = np.argmax(within, axis=1)
            highest = within[np.arange(len(within)), largest]
            lower = highest < lowest
            lowest[lower], chosen[lower] = highest[lower], piece[largest[lower]]
        return lowest, chosen

    def _gradients(self, rows: FloatArray) -> FloatArray:
        _, chosen = self._chosen(self._values(rows))
        gradients = np.empty_like(rows)
        for k in np.unique(chosen):
            of_k = chosen == k
            gradients[of_k] = self.primitives[k].value_and_gradient(rows[of_k])[1][:, 0]
        return gradients


def _pieces(
    contacts: IndexArray, values: FloatArray, owner: IndexArray, tolerance: float
) -> set[tuple[int, ...]]:
    """Return the pieces of some contacts as sorted indices of primitives.

    `values` (N, K) are signed distances of contacts from primitives; `owner` (N,) the primitive of
    each contact.
    """
    members = np.flatnonzero((values[contacts] <= tolerance).all(axis=0))
    depths = values[:, members].max(axis=1)
    for inside in np.argsort(depths):
        if depths[inside] >= -tolerance:
            break
        beyond: BoolArray = values[contacts, owner[inside]] > tolerance
        if beyond.any() and not beyond.all():
            parts = (contacts[beyond], contacts[~beyond])
            return set().union(*(_pieces(part, values, owner, tolerance) for part in parts))
    return {tuple(int(k) for k in members)}
