"""Workspace of an exploration: prior knowledge, surface samples, and known obstacles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, require_positive
from lis_grasp.io.units import LARGEST
from lis_grasp.records import read_only
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.surfaces.contact_places import box_area
from lis_grasp.typing import BoolArray, FloatArray

STEP_FRACTION = 0.25
"""Length of a step in sizes of the object: 50 mm on 20 cm (Ottenhaus et al. 2016, IV.B)."""

TIP_RADIUS = 0.012
"""Radius of a usual fingertip [m]."""

# Each round is a secant and a bisection step, and at least halves the bracket.
_ROUNDS = 2
# Grid that samples an estimate: cells per step, and margin of its box in sizes of the object.
_CELLS_PER_STEP, _MARGIN = 4.0, 0.05
# An estimate is sampled within this many sizes of the contacts' box.
_REACH = 0.25
# Surface within this many steps above a table counts as at the table.
_AT_TABLE = 0.2
# Above a table, surface that faces down more than this (45 degrees) cannot be touched.
_FACES_DOWN = -float(np.sqrt(0.5))
# A fingertip in a level motion stays this high above a table [m].
_TIP_CLEARANCE = 0.0015
# Least step, in sizes: a few contacts in a line would give the step of a thread.
_LEAST_STEP = 1.0 / 16.0
# Fewer contacts do not show a size.
_FEW = 4


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Position and size of an object, without its shape.

    Parameters
    ----------
    step
        Distance between touches [m]; a surface is explored within a step of a contact.
    center
        Shape (3,) [m], in O: centre of the object's bounding box.
    size
        Largest extent of the object [m].
    support_height
        Height in O of the table under the object [m]; None for an object that is held, and can be
        touched from below.
    tip_radius
        Radius of the fingertips that touch [m]: it limits how low a level motion can be.
    is_sized
        Whether the size is known. One that is assumed bounds no object: samples of an estimate then
        stay in the box in which it is valid, as its mesh does.

    Raises
    ------
    InvalidOptionError
        If a length is not positive or the centre is not three finite numbers.
    """

    step: float
    center: FloatArray
    size: float
    support_height: float | None = None
    tip_radius: float = TIP_RADIUS
    is_sized: bool = True

    def __post_init__(self) -> None:
        require_positive(step=self.step, size=self.size, tip_radius=self.tip_radius)
        if self.size > LARGEST:
            raise InvalidOptionError.out_of_range("size", self.size, f"at most {LARGEST} m")
        center = np.array(self.center, dtype=np.float64)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise InvalidOptionError.out_of_range("center", self.center, "3 finite numbers")
        object.__setattr__(self, "center", read_only(center))

    @property
    def radius(self) -> float:
        """Radius of the ball about the centre that contains the object [m]."""
        return 0.5 * float(np.sqrt(3.0)) * self.size

    @property
    def level_height(self) -> float:
        """Lowest height in O of a fingertip's leading point in a level motion [m]."""
        return (self.support_height or 0.0) + lowest_tip(self.tip_radius)

    def grown(self, contacts: Contacts) -> Workspace:
        """Return the workspace that contains the object: itself; see `Region.grown`."""
        return self

    def fitted_to(self, contacts: Contacts) -> Workspace:
        """Return the workspace with the step of the object that the contacts show.

        The step is `STEP_FRACTION` of the diameter of the ball of equal area: equally many steps
        cover a bar and a ball. The area is that of the box along the contacts' principal axes,
        enlarged to the known size. The step never exceeds the original one, which suits objects
        about as wide as long.
        """
        if len(contacts) < _FEW:
            return self
        enlarged = self.size / min(float(np.ptp(contacts.bounds, axis=0).max()), self.size)
        area = box_area(contacts.points) * enlarged**2
        step = max(STEP_FRACTION * float(np.sqrt(area / np.pi)), _LEAST_STEP * self.size)
        return replace(self, step=min(self.step, step))

    def touchable(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Return which surface points (P, 3) [m] can be touched above a table, shape (P,).

        Surface at the table, or with an outward normal (P, 3) that points down, cannot be touched.
        """
        if self.support_height is None:
            return np.ones(len(points), dtype=np.bool_)
        high = points[:, 2] > self.support_height + _AT_TABLE * self.step
        return np.asarray(high & (normals[:, 2] > _FACES_DOWN))

    def approach_distance(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Return the distance from the object's ball to each point along its direction [m].

        Points and unit directions have shapes (..., 3) [m] and (..., 3). The distance is measured
        backwards to where the line enters the ball; 0 if it misses the ball or ends before it.
        """
        offsets = points - self.center
        along = np.sum(offsets * directions, axis=-1)
        inside = self.radius**2 - np.sum(offsets * offsets, axis=-1) + along**2
        return np.where(
            inside > 0.0, np.maximum(along + np.sqrt(np.maximum(inside, 0.0)), 0.0), 0.0
        )

    def sample(
        self,
        surface: ImplicitSurface,
        *,
        near: Contacts | None = None,
        rng: np.random.Generator | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return points and unit outward normals of an estimate here, shapes (P, 3).

        The points are a quarter of a step apart; those `near` contacts are within a quarter of the
        size of the contacts' box. With `rng`, the grid is shifted at random, which keeps its
        pattern out of the touches.
        """
        cell = self.step / _CELLS_PER_STEP
        half = (0.5 + _MARGIN) * self.size
        shift = 0.0 if rng is None else cell * rng.random(3)
        low, high = self.center - half, self.center + half
        if near is not None:
            reach = _REACH * self.size
            low, high = (
                np.maximum(low, near.bounds[0] - reach),
                np.minimum(high, near.bounds[1] + reach),
            )
        low = low - shift
        if not self.is_sized:
            low, high = np.maximum(low, surface.bounds[0]), np.minimum(high, surface.bounds[1])
        return sample_zero_level_set(surface, np.array([low, high]), cell)


def lowest_tip(tip_radius: float) -> float:
    """Return the least height of a tip's centre above a table without touching it [m]."""
    return tip_radius + _TIP_CLEARANCE


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleModel:
    """Known object and table, which the hand avoids on its approach to a probe."""

    space: Workspace
    contacts: Contacts
    surface: ImplicitSurface | None  # estimated from the contacts, without free space
    region: FloatArray | None = None  # (2, 3) [m]: lowest and highest corner of where it can be

    def occupies(self, points: FloatArray) -> BoolArray:
        """Return which points (P, 3) [m], in O, are inside known object or table, shape (P,).

        The estimate counts within half a step of a contact. Farther away it is a guess, which a
        guarded motion may test.
        """
        height = self.space.support_height
        occupied = points[:, 2] < (-np.inf if height is None else height)
        if self.surface is None or not len(points):
            return occupied
        reach = 0.5 * self.space.step
        inside = [
            (column > low - reach) & (column < high + reach)
            for column, low, high in zip(points.T, *self.contacts.bounds, strict=True)
        ]
        near = np.flatnonzero(np.logical_and.reduce(inside))  # first by box: the tree is slow
        tree = cKDTree(self.contacts.points)
        near = near[np.isfinite(tree.query(points[near], distance_upper_bound=reach)[0])]
        if len(near):
            occupied[near] |= self.surface.evaluate(points[near]) < 0.0
        return occupied


def sample_zero_level_set(
    surface: ImplicitSurface, bounds: FloatArray, cell: float
) -> tuple[FloatArray, FloatArray]:
    """Return points of the zero level set in a box, and its outward normals there.

    There is one point on every grid edge across which f changes sign. Where f jumps over zero (as
    piecewise estimates do), there is a point only if the gradient and the jump agree on the outward
    side.

    Returns points and normals, shapes (P, 3) [m] and (P, 3), unit. `bounds`, shape (2, 3) [m], are
    the lowest and highest corner of the box, `cell` is the spacing of the grid [m].
    """
    counts = np.maximum(np.ceil((bounds[1] - bounds[0]) / cell).astype(int), 1) + 1
    axes = [bounds[0, k] + cell * np.arange(counts[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)  # (X, Y, Z, 3)
    values = surface.evaluate(grid)  # (X, Y, Z)
    edges = []
    for axis in range(3):
        first = tuple(slice(0, -1) if k == axis else slice(None) for k in range(3))
        second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
        crossing = (values[first] < 0.0) != (values[second] < 0.0)
        ends = grid[first], grid[second], values[first], values[second]
        edges.append([end[crossing] for end in ends])
    low, high, f_low, f_high = (np.concatenate(ends) for ends in zip(*edges, strict=True))
    points = _roots(surface, low, high, f_low, f_high)
    gradients = surface.gradient(points)
    steepness = np.linalg.norm(gradients, axis=1)
    rising = np.einsum("pk,pk->p", gradients, high - low) * np.where(f_high < f_low, -1.0, 1.0)
    consistent = (steepness > 0.0) & (rising > 0.0)
    return points[consistent], gradients[consistent] / steepness[consistent, None]


def _roots(
    surface: ImplicitSurface,
    low: FloatArray,
    high: FloatArray,
    f_low: FloatArray,
    f_high: FloatArray,
) -> FloatArray:
    """Return the sign changes of f between `low` and `high`, shape (P, 3)."""
    a, b = np.zeros(len(low)), np.ones(len(low))  # the bracket along each edge
    f_a, f_b = f_low.copy(), f_high.copy()
    for round_ in range(2 * _ROUNDS):
        secant = a - f_a * (b - a) / np.where(f_b == f_a, 1.0, f_b - f_a)
        t = secant if round_ % 2 == 0 else 0.5 * (a + b)
        f_t = surface.evaluate(low + t[:, None] * (high - low))
        below = (f_t < 0.0) == (f_a < 0.0)
        a, f_a = np.where(below, t, a), np.where(below, f_t, f_a)
        b, f_b = np.where(below, b, t), np.where(below, f_b, f_t)
    t = np.where(np.abs(f_a) < np.abs(f_b), a, b)
    return low + t[:, None] * (high - low)
