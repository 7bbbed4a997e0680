"""Space carving: an estimate minus free space that the hand crossed, or the space below a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from lis_grasp.contacts import HALF_SPACE, Contacts
from lis_grasp.geometry import AXES, unit
from lis_grasp.records import Record, short_repr
from lis_grasp.surfaces.implicit_surface import ImplicitSurface
from lis_grasp.surfaces.queries import Predicting, flat_points, map_rows, require_range
from lis_grasp.typing import FloatArray, IndexArray
from lis_grasp.underflow import methods_underflow

# Points of a unit ball: its centre, and on its surface towards the faces and corners of a cube. A
# cap without any is lower than a fifth of the radius.
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0)
_PLACES = np.vstack([np.zeros((1, 3)), AXES, _CORNERS])  # (15, 3)

# Walls that go on down to a table: contacts this near to it [m], normals with such parts upward.
_NEAR_TABLE, _LARGEST_SLOPE = 0.0135, 0.2

# Step of differences, for the gradient of the distance from a body [m].
_DIFFERENCE = 1e-6

# An estimate is about a distance: a ball whose centre has a value of this many radii is free.
_FAR = 1.5


class FreeSpace(Protocol):
    """Space without any part of the object: crossed by a hand, seen by a camera, or below a table.

    Classes that inherit from it have its values of `deepest` and `closes`.

    Examples
    --------
    >>> depths, slopes = Balls(np.zeros((1, 3)), np.array([0.02])).depths(np.array([[0, 0, 0.01]]))
    >>> float(depths[0]), slopes[0].tolist()
    (0.01, [-0.0, -0.0, -1.0])
    """

    __slots__ = ()

    @property
    def deepest(self) -> float:
        """Largest depth [m]; a point with a larger value of the estimate is not asked for."""
        return np.inf

    @property
    def closes(self) -> bool:
        """Whether the object ends at its border, as at a table."""
        return False

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how deep points (P, 3) [m] are inside, (P,) [m], and its gradients, (P, 3).

        Outside it is negative, -inf where nothing is known.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Balls(FreeSpace, Record):
    """Balls of free space: depth max_i (r_i - |x - c_i|)."""

    centers: FloatArray  #: (K, 3) [m], in O; K at least 1
    radii: FloatArray  #: (K,) [m]

    __repr__ = short_repr

    @property
    def deepest(self) -> float:
        """Largest radius [m]."""
        return float(self.radii.max())

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] and their gradients (P, 3); see `FreeSpace`."""

        def deepest(chosen: FloatArray) -> FloatArray:
            depths = self.radii - cdist(chosen, self.centers)  # (P, K)
            ball = np.argmax(depths, axis=1)
            slopes = unit(self.centers[ball] - chosen, least=float(np.finfo(np.float64).tiny))
            return np.column_stack([depths[np.arange(len(chosen)), ball], slopes])

        found = map_rows(deepest, points, len(self.radii))
        return found[:, 0], found[:, 1:]


@dataclass(frozen=True, slots=True, eq=False)
class BelowTable(FreeSpace, Record):
    """The half-space below a table.

    The hand cannot touch an underside: there an estimate is extrapolated, and the table closes it.
    """

    support_height: float  #: of the table [m]

    __repr__ = short_repr

    @property
    def closes(self) -> bool:
        """True: an object stands on the table."""
        return True

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] and their gradients (P, 3); see `FreeSpace`."""
        down = np.broadcast_to([0.0, 0.0, -1.0], points.shape)
        return self.support_height - points[:, 2], down


@dataclass(frozen=True, slots=True, eq=False)
class InBodies(FreeSpace, Record):
    """The space of other bodies that are known, and near them: depth m - d.

    The hand cannot touch a side that a wall hides: there an estimate is extrapolated, at times into
    the wall.
    """

    distances: Callable[[FloatArray], FloatArray]  #: d of points (P, 3), (P,) [m], below 0 inside
    margin: float  #: m, from the bodies [m]

    __repr__ = short_repr

    def depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return depths (P,) [m] and their gradients (P, 3), by differences; see `FreeSpace`."""
        depths, slopes = self.margin - self.distances(points), np.zeros((len(points), 3))
        for axis, step in enumerate(_DIFFERENCE * np.eye(3)):
            before, after = (self.distances(points + sign * step) for sign in (-1.0, 1.0))
            slopes[:, axis] = (before - after) / (2.0 * _DIFFERENCE)
        return depths, slopes


@methods_underflow
@dataclass(frozen=True, slots=True, eq=False)
class Remainder(Predicting, Record):
    """An estimate minus free space (CSG difference).

    f = max(g, max_s d_s)

    with the estimate g and the depth d_s in each space s. A point is outside if g is outside there,
    or if it is in a space; elsewhere f is g. If the spaces are truly free, f has the right sign
    wherever g has. Made by `carved` and `without`.
    """

    surface: ImplicitSurface  #: the estimate g
    spaces: tuple[FreeSpace, ...]

    __repr__ = short_repr

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner of the box in which the estimate is valid, shape (2, 3) [m]."""
        return self.surface.bounds

    def evaluate(self, points: npt.ArrayLike) -> FloatArray:
        """Return f at points of shape (..., 3) [m], shape (...): below 0 inside, above outside."""
        rows, shape = flat_points(points)
        values = np.array(self.surface.evaluate(rows))
        for _ in self._raised(rows, values):
            pass
        return values.reshape(shape)

    def gradient(self, points: npt.ArrayLike) -> FloatArray:
        """Return the gradient of f at points of shape (..., 3) [m], shape (..., 3): outward."""
        rows, shape = flat_points(points)
        values = np.array(self.surface.evaluate(rows))
        gradients = np.array(self.surface.gradient(rows))
        for _, deeper, _, slopes in self._raised(rows, values):
            gradients[deeper] = slopes
        return gradients.reshape(*shape, 3)

    def uncertainty(self, points: npt.ArrayLike) -> FloatArray:
        """Return one standard deviation of the surface along its normal, shape (...) [m].

        It is the estimate's own. Where space was carved, it is combined with the depth inside the
        estimate, the known error there; the table, at which the object ends, leaves it unchanged.
        """
        rows, shape = flat_points(points)
        values, deviations = self.surface.evaluate(rows), np.array(self.surface.uncertainty(rows))
        values = np.array(values)
        for space, carved_off, before, _ in self._raised(rows, values):
            if not space.closes:
                missing = np.minimum(before, 0.0)
                deviations[carved_off] = np.hypot(deviations[carved_off], missing)
        return deviations.reshape(shape)

    def _raised(self, points: FloatArray, values: FloatArray) -> Iterator[_Raised]:
        """Raise the estimate's values (P,) to the depths in each space, and yield what changed.

        That is the space, the points deeper in it than their values (A,), these values before,
        (A,), and the slopes (A, 3) of the depths.
        """
        for space in self.spaces:
            asked = np.flatnonzero(values < space.deepest)
            depths, slopes = space.depths(points[asked])
            deeper = depths > values[asked]
            rows = asked[deeper]
            before = values[rows]
            values[rows] = depths[deeper]
            yield space, rows, before, slopes[deeper]


_Raised = tuple[FreeSpace, IndexArray, FloatArray, FloatArray]


def without(surface: ImplicitSurface, *spaces: FreeSpace) -> ImplicitSurface:
    """Return an estimate minus free space; the estimate itself without any."""
    if not spaces:
        return surface
    if isinstance(surface, Remainder):
        return Remainder(surface.surface, (*surface.spaces, *spaces))
    return Remainder(surface, spaces)


def carved(
    surface: ImplicitSurface, contacts: Contacts, *, margin: float = 0.0, growth: float = 1.0
) -> ImplicitSurface:
    """Remove the free space of contacts from an estimate (space carving).

    Only balls that overlap the estimate are kept; without any, the estimate itself is returned. A
    ball is never larger than the distance from its centre to the nearest contact, so every contact
    stays on the surface.

    A ball of free space deep inside the estimate shows an error larger than the hand: carving the
    hand's path alone would leave a plug with a tunnel. So such a ball grows by the depth of its
    centre inside the estimate, but at most halfway to the nearest contact. Without growth only
    measured free space is removed.

    Parameters
    ----------
    surface
        Estimated from the contacts, by any estimator.
    contacts
        With balls of free space (`Contacts.free_points`, `Contacts.free_radii`).
    margin
        Reduction of the radii [m], for example two standard deviations of the hand's position.
        Smaller balls are ignored.
    growth
        Growth of a ball, in depths of its centre inside the estimate; 0 for none.

    Raises
    ------
    InvalidOptionError
        If the margin or the growth is negative or not finite.
    """
    require_range("margin", margin, unit="m")
    require_range("growth", growth)
    centers, radii, nearest = _free_balls(contacts, surface.bounds, margin)
    values = surface.evaluate(centers)
    near = np.flatnonzero(values < _FAR * radii)
    places = centers[near, None] + radii[near, None, None] * _PLACES  # (B, 15, 3)
    kept = near[(surface.evaluate(places) < 0.0).any(axis=1) | (radii[near] > 0.5 * HALF_SPACE)]
    if not len(kept):
        return surface
    grown = _grown(radii, nearest, values, growth)
    return without(surface, Balls(centers[kept], grown[kept]))


def depths_in_free_space(
    points: FloatArray, surface: ImplicitSurface, contacts: Contacts
) -> FloatArray:
    """Return how deep points of an estimate's surface, (P, 3) [m], are in free space, (P,) [m].

    It is the free space that `carved` removes from the estimate. Outside of it the depth is
    negative, and -inf far from it.
    """
    bounds = np.array([points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)])
    centers, radii, nearest = _free_balls(contacts, bounds, 0.0)
    distances, _ = cKDTree(points).query(centers)
    near = distances < np.maximum(radii, 0.5 * (radii + nearest))  # as large as they may grow
    centers, radii, nearest = centers[near], radii[near], nearest[near]
    grown = _grown(radii, nearest, surface.evaluate(centers), 1.0)
    return np.asarray((grown - cdist(points, centers)).max(axis=1, initial=-np.inf))


def _free_balls(
    contacts: Contacts, bounds: FloatArray, margin: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centres and radii of the free balls that overlap a box, and how near contacts are.

    Shapes (K, 3), (K,) and (K,) [m]; no ball contains a contact.
    """
    centers, radii = contacts.free_points, contacts.free_radii - margin
    overlaps = (radii > 0.0) & np.all(centers + radii[:, None] > bounds[0], axis=1)
    overlaps &= np.all(centers - radii[:, None] < bounds[1], axis=1)
    centers, radii = centers[overlaps], radii[overlaps]
    nearest, _ = cKDTree(contacts.points).query(centers)
    return centers, np.minimum(radii, nearest), nearest


def _grown(radii: FloatArray, nearest: FloatArray, values: FloatArray, growth: float) -> FloatArray:
    """Return the radii of balls that grow by the depth of their centres inside the estimate."""
    return np.maximum(radii, np.minimum(radii - growth * values, 0.5 * (radii + nearest)))


def walls_down_to(support_height: float, contacts: Contacts) -> Contacts:
    """Return guessed contacts below the walls of contacts near a table at a height [m].

    No fingertip gets below a contact near the table. A wall there is assumed to continue straight
    down: one more contact is below it, at the table.
    """
    near = contacts.points[:, 2] < support_height + _NEAR_TABLE
    slopes = contacts.normals[:, 2]
    walls = contacts.subset(near & (np.abs(slopes) < _LARGEST_SLOPE))
    walls = replace(walls, free_points=np.empty((0, 3)), free_radii=np.empty(0))
    feet = walls.points * [1, 1, 0] + [0.0, 0.0, support_height]
    level = unit(walls.normals * [1, 1, 0])
    return replace(walls, points=feet, normals=level)


def above_table(surface: ImplicitSurface, support_height: float | None) -> ImplicitSurface:
    """Return an estimate closed by a table at a height [m]; None for no table."""
    if support_height is None:
        return surface
    return without(surface, BelowTable(support_height))


def outside_bodies(
    surface: ImplicitSurface, distances: Callable[[FloatArray], FloatArray], margin: float
) -> ImplicitSurface:
    """Return an estimate without what other bodies, a margin [m] thicker, take up.

    `distances` are signed, of points (P, 3), shape (P,) [m]. Where no body is near, the estimate
    itself is returned.
    """
    low, high = surface.bounds
    if distances(0.5 * (low + high)[None])[0] > 0.5 * np.linalg.norm(high - low) + margin:
        return surface
    return without(surface, InBodies(distances, margin))
