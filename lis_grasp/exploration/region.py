"""Region that contains an object at an unknown place, and the search for the object in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.neighbours import Neighbours, longest_parts
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.probe_motions import PROBE_SPEED, TRANSIT_SPEED
from lis_grasp.exploration.workspace import STEP_FRACTION, TIP_RADIUS, Workspace, lowest_tip
from lis_grasp.typing import BoolArray, FloatArray

DEFAULT_REGION = (0.4, 0.4, 0.3)
"""Lengths of the region along x, y and z [m]."""

# A longer side has a mistaken unit: its search would take hours.
_LONGEST = 5.0
# Behind a contact an object is at least this thick [m].
_THICKNESS = 0.03
# Largest extent of the object, in extents of its contacts.
_BEYOND = 1.15
# Further extent [m], divided by the number of contacts.
_UNKNOWN = 0.2
# Radius and height [m] of the upright cylinders that stand for the unknown object, and the
# probability of each.
_KINDS = (
    *((0.015, 0.03, 0.2), (0.03, 0.06, 0.35), (0.05, 0.1, 0.25)),
    *((0.03, 0.01, 0.1), (0.03, 0.004, 0.1)),
)
# Cylinders that are sought when none of these is left, such as a pen between sweeps.
_THIN = ((0.005, 0.004, 1.0),)
# Spacing of the places, and of the free space that is compared with them [m].
_PLACE_SPACING, _FREE_SPACING = 0.02, 0.005
# Heights of the fingertip in sweeps above the lowest one [m].
_SWEEP_HEIGHTS = (0.0, 0.02, 0.04)
# Random part of a motion's value, so that searches differ.
_RANDOM = 0.1
# Places overlap free space by at least this depth [m]: the free space of a link is inside it.
_OVERLAP = 0.002
# Directions of sweeps, along the sides of the region.
_SWEEPS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True)
class Region:
    """Box on a table that contains an object of unknown place, size and orientation.

    The table is the plane z = 0 of the world frame W, the frame of the exploration. The
    box is centred at x = y = 0.

    Parameters
    ----------
    lengths
        Along x, y and z [m].
    tip_radius
        Radius of the fingertips that touch [m].
    around
        Width of the free space around the region in which sweeps begin [m], so that the whole hand
        comes down outside; none beside known bodies.

    Raises
    ------
    InvalidOptionError
        If these are not three positive lengths of at most 5 m.
    """

    lengths: Sequence[float] = DEFAULT_REGION
    tip_radius: float = TIP_RADIUS
    around: float = 0.0

    def __post_init__(self) -> None:
        try:
            lengths = tuple(float(length) for length in self.lengths)
        except (TypeError, ValueError):
            lengths = ()
        if len(lengths) != 3 or not all(0.0 < length <= _LONGEST for length in lengths):
            metres = " ".join(f"{1e-3 * length:g}" for length in lengths)
            are_mm = len(lengths) == 3 and all(0.0 < 1e-3 * x <= _LONGEST for x in lengths)
            cure = f" (in mm they are {metres} m)" if are_mm else ""
            required = f"3 lengths in metres, above 0 and at most {_LONGEST:g}{cure}"
            raise InvalidOptionError.out_of_range("region", self.lengths, required)
        object.__setattr__(self, "lengths", lengths)

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner, shape (2, 3) [m]."""
        x, y, z = self.lengths
        return np.array([[-0.5 * x, -0.5 * y, 0.0], [0.5 * x, 0.5 * y, z]])

    def grown(self, contacts: Contacts) -> Workspace:
        """Return the workspace that contacts show; without any, the whole region's.

        Its box contains the contacts, the matter behind each of them, and the table below
        them. The margin shrinks with their number.
        """
        if not len(contacts):
            low, high = self.bounds
            size = float(np.linalg.norm(high - low)) / np.sqrt(3.0)
            return self._workspace(0.5 * (low + high), size)
        behind = contacts.points - _THICKNESS * contacts.normals
        known = np.vstack([contacts.points, behind]) if len(contacts) == 1 else contacts.points
        low, high = known.min(axis=0), known.max(axis=0)
        low[2], high[2] = 0.0, max(high[2], _THICKNESS)
        size = _BEYOND * max(float((high - low).max()), _THICKNESS) + _UNKNOWN / len(contacts)
        return self._workspace(0.5 * (low + high), size)

    def fitted_to(self, contacts: Contacts) -> Workspace:
        """Return the workspace with the step of the object that the contacts show."""
        return self.grown(contacts).fitted_to(contacts)

    def _workspace(self, center: FloatArray, size: float) -> Workspace:
        return Workspace(STEP_FRACTION * size, center, size, 0.0, self.tip_radius)


@dataclass(frozen=True, slots=True, eq=False)
class PlaceBelief:
    """Probability of each place and kind of object: a cylinder upright on the table.

    Places are uniform in the region, less those in which the object would overlap free space.
    """

    centers: FloatArray  # (K, 2) [m], in W
    radii: FloatArray  # (K,) [m]
    heights: FloatArray  # (K,) [m]
    weights: FloatArray  # (K,), their sum is 1 before any free space is known

    @classmethod
    def of(
        cls,
        region: Region,
        free_points: FloatArray,
        free_radii: FloatArray,
        kinds: Sequence[tuple[float, float, float]] = _KINDS,
        neighbours: Neighbours | None = None,
    ) -> PlaceBelief:
        """Return the belief after free balls, centres (F, 3) in W and radii (F,) [m].

        No place is inside known neighbours. If none of these kinds is left, thin ones are sought.
        """
        low, high = region.bounds
        parts = []
        for radius, height, probability in kinds:
            axes = [_ticks(low[k] + radius, high[k] - radius) for k in range(2)]
            centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
            kind = np.tile([radius, height, probability / len(centers)], (len(centers), 1))
            left = ~_overlapped(centers, radius, height, free_points, free_radii)
            if neighbours is not None:
                left &= ~_inside_bodies(centers, radius, height, neighbours)
            parts.append(np.hstack([centers, kind])[left])
        centers, *columns = np.split(np.concatenate(parts), [2, 3, 4], axis=1)
        if not len(centers) and kinds is not _THIN:
            return cls.of(region, free_points, free_radii, _THIN, neighbours)
        return cls(np.ascontiguousarray(centers), *(column[:, 0].copy() for column in columns))

    def met_by(self, probe: Probe, tip_radius: float) -> float:
        """Return the probability that a fingertip meets the object on a probe's motion."""
        a, b = probe.start, probe.end
        along = b[:2] - a[:2]
        squared = float(along @ along)
        offsets = self.centers - a[:2]
        t = np.zeros(len(offsets)) if squared == 0.0 else np.clip(offsets @ along / squared, 0, 1)
        away = np.linalg.norm(offsets - t[:, None] * along, axis=1)
        lowest = min(a[2], b[2]) - (tip_radius if squared else 0.0)
        met = (away < self.radii + tip_radius) & (self.heights > lowest)
        return float(self.weights[met].sum())


def search_probe(
    region: Region,
    outcomes: Sequence[ProbeOutcome],
    *,
    rng: np.random.Generator,
    neighbours: Neighbours | None = None,
) -> Probe | None:
    """Return the probe with the highest probability of a touch for each second of its motion.

    The candidates are horizontal sweeps through the region, low above the table, and motions
    straight down, each as long as known neighbours permit. Motions that were blocked before are
    not repeated, and each halves the value of those along the same direction at the same height.
    `outcomes` are from every probe, all without contact. None if no place is left where
    the object could be found.
    """
    points = np.vstack([np.empty((0, 3)), *(outcome.free_points for outcome in outcomes)])
    radii = np.concatenate([np.empty(0), *(outcome.free_radii for outcome in outcomes)])
    belief = PlaceBelief.of(region, points, radii, neighbours=neighbours)
    tried = [outcome.probe for outcome in outcomes]
    blocked = [o.probe for o in outcomes if o.status == "blocked" and not len(o.free_points)]
    best, best_value = None, 0.0
    for probe in _candidates(region, neighbours):
        same = (other for other in tried if np.array_equal(probe.target, other.target))
        if any(_have_one_way(probe, other) for other in same):
            continue
        value = belief.met_by(probe, region.tip_radius) / _seconds(region, probe)
        value *= 1.0 + _RANDOM * rng.random()
        value *= 0.5 ** sum(_are_alike(probe, other) for other in blocked)
        if value > best_value:
            best, best_value = probe, value
    return best


def _have_one_way(probe: Probe, other: Probe) -> bool:
    """Return whether two motions have one direction."""
    return float(probe.direction @ other.direction) > 0.999


def _are_alike(probe: Probe, other: Probe) -> bool:
    """Return whether two motions have one direction and begin at one height."""
    apart = abs(float(probe.start[2] - other.start[2]))
    return _have_one_way(probe, other) and apart < _OVERLAP


def _overlapped(
    centers: FloatArray,
    radius: float,
    height: float,
    free_points: FloatArray,
    free_radii: FloatArray,
) -> BoolArray:
    """Return which upright cylinders at centres (K, 2) overlap a free ball, shape (K,)."""
    reach = free_radii - _OVERLAP
    above = np.maximum(free_points[:, 2] - height, 0.0)
    near = reach > above
    wide = radius + np.sqrt(reach[near] ** 2 - above[near] ** 2)  # (F,)
    places = np.column_stack([free_points[near, :2], wide])
    places = np.unique(np.round(places / _FREE_SPACING), axis=0) * _FREE_SPACING
    overlapped = np.zeros(len(centers), dtype=np.bool_)
    if len(places):
        found = cKDTree(centers).query_ball_point(places[:, :2], places[:, 2])
        overlapped[np.unique(np.concatenate([np.array(f, dtype=np.intp) for f in found]))] = True
    return overlapped


def _inside_bodies(
    centers: FloatArray, radius: float, height: float, neighbours: Neighbours
) -> BoolArray:
    """Return which upright cylinders at centres (K, 2) overlap a known body, shape (K,)."""
    inside = np.zeros(len(centers), dtype=np.bool_)
    for z in _ticks(0.5 * min(radius, height), height - 0.5 * min(radius, height)):
        points = np.column_stack([centers, np.full(len(centers), z)])
        inside |= neighbours.distances(points) < min(radius, height) - neighbours.error - _OVERLAP
    return inside


def _candidates(region: Region, neighbours: Neighbours | None = None) -> list[Probe]:
    low, high = region.bounds
    radius = region.tip_radius
    lowest = lowest_tip(radius)
    around = region.around if neighbours is None else 0.0
    probes = []
    for direction in _SWEEPS:
        axis = int(np.argmax(np.abs(direction)))
        across = 1 - axis
        half = 0.5 * float(high[axis] - low[axis]) + radius
        for offset in _ticks(low[across] + radius, high[across] - radius):
            for height in lowest + np.array(_SWEEP_HEIGHTS):
                middle = np.zeros(3)
                middle[across], middle[2] = offset, height
                probes.append(Probe(middle, direction, half + around, half))
    for x in _ticks(low[0], high[0]):
        for y in _ticks(low[1], high[1]):
            probes.append(Probe(np.array([x, y, 0.0]), _DOWN, min(0.1, high[2]), 0.0))
    if neighbours is not None:
        probes = longest_parts(probes, neighbours, radius)
    return probes


def _ticks(low: float, high: float) -> FloatArray:
    """Return evenly spaced places from low to high [m]."""
    if high <= low:
        return np.array([0.5 * (low + high)])
    return np.linspace(low, high, max(round((high - low) / _PLACE_SPACING), 1) + 1)


def _seconds(region: Region, probe: Probe) -> float:
    """Return the time of a motion down to the start, along the probe, and back [s]."""
    length = probe.standoff + probe.overshoot
    down = max(region.lengths[2] - float(probe.start[2]), 0.0)
    return length / PROBE_SPEED + (2.0 * down + length) / TRANSIT_SPEED
