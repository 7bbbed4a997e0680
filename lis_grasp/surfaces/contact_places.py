"""Spacing, bounds and places of contacts: how finely, and where, a surface was touched; folds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.typing import FloatArray, IndexArray

# Spacing of a lone contact [m]: the average exploration step of Ottenhaus et al. 2016, IV.B.
LONE_CONTACT_SPACING = 0.05

# Contacts closer than 1 nm, or than rounding at their distance from the origin, are at one place.
SMALLEST = 1e-9
_ROUNDING = 1e-12

# The places are the farthest-point order up to its last contact that covers this fraction of the
# largest area, k g_k^2 with the gap g_k of contact k. From 0.4 to 0.8 the estimates change little.
_COVERED = 0.5

# Fewer places than this cover less than their gaps squared: along a rod the area is overestimated.
_FEW = 8

# An object ends at least so far beyond its contacts, in spacings of places.
_MARGIN = 0.25

# Distances that differ by less, as a fraction of the largest, are equal.
_EQUAL_DISTANCES = 1e-9

# Places of an order; it takes time proportional to contacts times places.
_MOST_PLACES = 4096


@dataclass(frozen=True, slots=True, eq=False)
class ContactPlaces:
    """Contacts that cover the touched surface evenly, M of N, and the spacing between them.

    The median distance between neighbouring contacts says how finely a surface was touched only if
    the contacts are spread evenly: a tactile pad reports several contacts millimetres apart. Places
    are the first contacts of the farthest-point order (Gonzalez 1985), as many as make the area
    covered per contact largest. Additional contacts near a place change neither places nor spacing.
    """

    nodes: IndexArray  # (M,) the contact at each place, in farthest-point order
    place: IndexArray  # (N,) the nearest place of each contact, 0 to M - 1
    spacing: float  # distance of the last place from its nearest earlier one [m]

    @classmethod
    def of(cls, points: FloatArray) -> ContactPlaces:
        """Find the places of contacts at points, shape (N, 3) [m], at least one."""
        order, gaps = farthest_point_order(points, _MOST_PLACES)
        if len(order) < 2:
            return cls(order, np.zeros(len(points), dtype=np.intp), LONE_CONTACT_SPACING)
        rank = np.arange(1, len(order))
        covered = np.minimum(rank / _FEW, 1.0) * rank * gaps[1:] ** 2
        last = 1 + int(np.flatnonzero(covered >= _COVERED * covered.max())[-1])
        nodes = order[: last + 1]
        return cls(nodes, cKDTree(points[nodes]).query(points)[1].astype(np.intp), gaps[last])


def farthest_point_order(
    points: FloatArray, most: int, *, factors: FloatArray | None = None
) -> tuple[IndexArray, FloatArray]:
    """Return indices of at most `most` points in order (K,), and distances to earlier ones (K,).

    `points` are of shape (N, D). The order begins with the point farthest from the centroid, and
    ends when all others are at the places of earlier ones (Gonzalez 1985). The distances of each
    point are multiplied by its factor, (N,). The result does not depend on the order of the points,
    nor on the frame, except for equal distances.
    """
    relative = points - points.mean(axis=0)
    distances = np.linalg.norm(relative, axis=1)
    if factors is not None:
        distances *= factors
    resolution = max(_EQUAL_DISTANCES * float(distances.max()), SMALLEST)
    keys = np.round(np.column_stack([distances, relative]) / resolution)
    ranked = np.lexsort(keys.T[::-1])[::-1]  # the farthest from the centroid first
    sorted_points = points[ranked]
    weights = None if factors is None else factors[ranked] ** 2
    chosen, gaps = [0], [np.inf]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < min(most, len(points)):
        offsets = sorted_points - sorted_points[chosen[-1]]
        squares = np.einsum("nk,nk->n", offsets, offsets)
        np.minimum(nearest, squares if weights is None else weights * squares, out=nearest)
        farthest = nearest.max()
        if farthest <= resolution**2:
            break
        chosen.append(int(np.argmax(nearest >= farthest - resolution * np.sqrt(farthest))))
        gaps.append(float(np.sqrt(farthest)))
    return ranked[chosen], np.array(gaps)


def box_area(points: FloatArray) -> float:
    """Return the area of the box along the principal axes of points (N, 3) [m^2]."""
    a, b, c = box_lengths(points)
    return float(2.0 * (a * b + b * c + c * a))


def box_lengths(points: FloatArray) -> FloatArray:
    """Return the lengths (3,) [m] of the box of `box_area`, by the points' variances."""
    centered = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centered.T @ centered)
    return np.asarray(np.ptp(centered @ axes, axis=0))


def spacing_of(contacts: Contacts) -> float:
    """Return the contacts' spacing [m], or a default where there is only one place."""
    spacing = contacts.spacing
    return spacing if spacing > resolution_of(contacts) else LONE_CONTACT_SPACING


def resolution_of(contacts: Contacts) -> float:
    """Return the distance [m] up to which two contacts are at one place."""
    farthest = float(np.abs(contacts.points).max(initial=0.0))
    return max(SMALLEST, _ROUNDING * farthest)


def box_of(contacts: Contacts, places: ContactPlaces) -> FloatArray:
    """Return the box in which an estimate is valid, shape (2, 3) [m].

    The contacts' box grown by their spacing, or more if a pad's contacts are millimetres apart.
    """
    margin = max(spacing_of(contacts), _MARGIN * places.spacing)
    return contacts.bounds + margin * np.array([[-1.0], [1.0]])


# Weight of a normal's error of 1, and the error that is as good as none, in spacings.
_NORMAL_ERROR = 0.25
_ERROR_FLOOR = 0.02


def log_errors(
    predicted: tuple[FloatArray, FloatArray], normals: FloatArray, places: ContactPlaces
) -> FloatArray:
    """Return the mean logarithm of the errors of contacts in distance and normal, at each place.

    `predicted` is f (N,) [m] and its gradient (N, 3) at each contact, predicted from other
    contacts.
    """
    values, gradients = predicted
    slopes = np.linalg.norm(gradients, axis=1)
    distances = np.abs(values) / np.maximum(slopes, 0.3) / places.spacing
    units = gradients / np.maximum(slopes, 1e-9)[:, None]
    tilts = np.linalg.norm(units - normals, axis=1)
    logs = np.log(np.minimum(distances, 1.0) + _NORMAL_ERROR * tilts + _ERROR_FLOOR)
    return np.asarray(np.bincount(places.place, logs) / np.bincount(places.place))


def smoothstep(values: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Return 3 t^2 - 2 t^3, which rises from 0 at `low` to 1 at `high`, and its derivative."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / (high - low)


def agreement(differences: FloatArray, near: float, far: float) -> tuple[FloatArray, FloatArray]:
    """Return a weight that falls from 1 at `near` to 0 at `far`, and its derivative."""
    rises, slopes = smoothstep(np.abs(differences), near, far)
    return 1.0 - rises, -slopes * np.sign(differences)
