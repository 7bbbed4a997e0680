"""CSG of RANSAC primitives: a union of intersections that the contacts do not contradict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from lis_grasp.contacts import Contacts
from lis_grasp.surfaces.queries import flat_points, map_rows
from lis_grasp.typing import BoolArray, FloatArray, IndexArray
from lis_grasp_studies.baselines._oriented_primitives import (
    PARAMETERS,
    Primitives,
    cones_through,
    cylinders_through,
    planes_at,
    planes_through,
    spheres_through,
)
from lis_grasp_studies.baselines._support import BaselineSurface, Support

# Minimal sets drawn of two and of three points; all pairs of up to 64 points.
_PAIRS, _TRIPLES = 2016, 1000
# Equations that a sphere, a cylinder or a cone must explain beyond its parameters: three contacts
# of a sphere, four of a cylinder or a cone.
_LEAST_SURPLUS = 5
# An inlier at both limits explains this much, so that it is one.
_LEAST = 1e-3
# Fits of a candidate to its inliers, while they explain more.
_REFITS = 3


def extract_primitives(
    points: FloatArray, normals: FloatArray, *, distance: float, angle: float
) -> list[tuple[Primitives, IndexArray]]:
    """Return primitives and the contacts that each explains; every contact is explained once.

    Candidates go through minimal sets of contacts. The one that explains most equations beyond its
    parameters, after a fit to its contacts by least squares (Chum, Matas and Kittler 2003), is
    taken, and its contacts are removed, until none is left (Schnabel, Wahl and Klein 2007,
    "Efficient RANSAC for point-cloud shape detection"). Contacts are sparse, so that all candidates
    are drawn and compared at once. A contact that nothing else explains has its tangent plane.

    Parameters
    ----------
    points, normals
        Shape (N, 3).
    distance, angle
        Largest distance of an inlier [m], and largest angle of its normal [rad].
    """
    candidates = _candidates(points, normals)
    credits = [_credits(group, points, normals, distance, angle) for group in candidates]
    left = np.ones(len(points), dtype=bool)
    found: list[tuple[Primitives, IndexArray]] = []
    while left.any():
        best, best_gain, explained = None, -np.inf, left
        for group, credit in zip(candidates, credits, strict=True):
            gains = _gains(group, credit * left)
            first = int(np.argmax(gains))
            if gains[first] == -np.inf:
                continue
            one = group.take(np.array([first]))
            members = credit[first] * left
            for _ in range(_REFITS):
                chosen = members > 0.0
                fitted = _refit(one, points[chosen], normals[chosen], distance, angle)
                again = _credits(fitted, points, normals, distance, angle)[0] * left
                if again.sum() <= members.sum():
                    break
                one, members = fitted, again
            gain = float(_gains(one, members[None])[0])
            if gain > best_gain:
                best, best_gain, explained = one, gain, members > 0.0
        assert best is not None  # a contact's own tangent plane explains it
        found.append((best, np.flatnonzero(explained)))
        left &= ~explained
    return found


def _candidates(points: FloatArray, normals: FloatArray) -> list[Primitives]:
    rng = np.random.default_rng(0)
    count = len(points)
    groups = [planes_at(points, normals)]
    if count >= 3:
        pairs = np.column_stack(np.triu_indices(count, 1))
        if len(pairs) > _PAIRS:
            pairs = pairs[rng.choice(len(pairs), _PAIRS, replace=False)]
        triples = np.argsort(rng.random((_TRIPLES, count)), axis=1)[:, :3]
        groups.append(planes_through(points, normals, triples))
        groups += [make(points, normals, pairs) for make in (spheres_through, cylinders_through)]
        groups.append(cones_through(points, normals, triples))
    return [group for group in groups if len(group)]


def _credits(
    group: Primitives, points: FloatArray, normals: FloatArray, distance: float, angle: float
) -> FloatArray:
    """Return how well each primitive explains each contact, shape (M, N), from 0 to 1.

    1 - (squared distance / distance^2 + squared angle / angle^2) / 2 for inliers, which have both
    within their limits, and 0 for others (MSAC: Torr and Zisserman 2000).
    """
    values, gradients = group.value_and_gradient(points)
    cosines = np.einsum("nmk,nk->nm", gradients, normals)
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))
    off, turned = np.abs(values) / distance, angles / angle
    credit = 1.0 - 0.5 * (off**2 + turned**2)
    return np.asarray(np.where((off <= 1.0) & (turned <= 1.0), np.maximum(credit, _LEAST), 0.0).T)


def _gains(group: Primitives, credits: FloatArray) -> FloatArray:
    """Return the equations that each candidate explains beyond its parameters, shape (M,)."""
    surplus = 3.0 * credits.sum(axis=1) - PARAMETERS[group.kind]
    count = (credits > 0.0).sum(axis=1)
    if group.kind == "plane":
        return np.where(count > 0, surplus, -np.inf)
    return np.where(3 * count - PARAMETERS[group.kind] >= _LEAST_SURPLUS, surplus, -np.inf)


def _refit(
    one: Primitives, points: FloatArray, normals: FloatArray, distance: float, angle: float
) -> Primitives:
    """Fit a primitive to its contacts by least squares of distances and normals."""
    scale = max(float(np.ptp(points, axis=0).max()), distance)

    def moved(change: FloatArray) -> Primitives:
        axis = one.axis[0] + change[3:6]
        point = one.point + scale * change[:3]
        unit = scale if one.kind != "cone" else 1.0
        size = np.maximum(one.size + unit * change[6], 1e-9)
        return Primitives(one.kind, point, (axis / np.linalg.norm(axis))[None], size, one.side)

    def residuals(change: FloatArray) -> FloatArray:
        values, gradients = moved(change).value_and_gradient(points)
        turned = gradients[:, 0] - normals
        # A little damping holds the directions that change nothing, such as along an axis.
        return np.concatenate([values[:, 0] / distance, turned.ravel() / angle, 1e-3 * change])

    if len(points) < 2:
        return one
    return moved(least_squares(residuals, np.zeros(7), method="lm", max_nfev=60).x)


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
