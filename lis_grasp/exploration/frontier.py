"""The paper's explorer: go on from where the surface is known by one step, then fill the gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.hollows import bridged_places
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.zero_set import sample_zero_set
from lis_grasp.surfaces import ImplicitSurface

FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

STEP_FRACTION = 0.25
"""Length of a step in sizes of the object: 50 mm on 20 cm (Ottenhaus et al. 2016, IV.B)."""

_AXES = np.vstack([np.eye(3), -np.eye(3)])
# The frontier lies about one step from the nearest contact; in units of the step.
_BAND = (0.8, 1.2)
# What makes one frontier target better than another, against being exactly a step away: to be near
# a second contact too, and not to be near a place just found empty.
_SECOND_CONTACT, _EMPTINESS = 0.25, 0.5
# Chance, so that explorations differ: in the choice among targets about as good (in steps), and in
# how far from the very middle the first probes aim (in sizes).
_LUCK, _OPENING_SPREAD = 0.1, 0.1
# How far a tip goes on beyond its target; in units of the step.
_OVERSHOOT = 1.5
# After a miss the next probe comes in aslant, over the edge and back towards what is known.
_SLANT = np.radians(40.0)
# A target is the same as an earlier one within this share of its gap, if their directions agree.
_SAME_TARGET, _SAME_DIRECTION = 0.4, np.cos(np.radians(50.0))
# Where a tip passed and felt nothing there is no surface, within this share of a step.
_PASSED = 0.2
# A contact says nothing of a surface that faces away from it, as the far side of a thin wall does.
_FACES_AWAY = -0.5
# The estimate is searched in a grid this fine, and beyond the object's known size by this share.
_CELLS_PER_STEP, _MARGIN = 4.0, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class FrontierPolicy:
    """Touch next where the estimated surface leaves the known, about one step from any contact.

    First come the six probes along the axes to the object's middle. Then the next target lies on
    the frontier: on the estimated zero set, about a step from the nearest contact. It is approached
    against the estimated outward normal, and after a miss aslant, from beyond the edge that the
    missed probe must have crossed. A hollow that the estimate bridges, although a tip was in it, is
    touched from within. When no frontier is left, the largest gap is filled: the point
    of the estimated surface farthest from any contact. Targets probed before, and places that a
    tip passed through, are not tried again. When the estimate offers nothing, a straight pass
    through the object's known box is drawn.

    Ottenhaus et al. 2016, section IV.B, give the step (50 mm on objects of 20 cm) and that the
    next target follows from the contacts and the estimated surface; the rest is ours.

    Parameters
    ----------
    step
        Distance between touches [m].
    center
        Shape (3,) [m], in O: the middle of the object's box, as known beforehand.
    size
        Largest extent of the object [m], as known beforehand.

    Raises
    ------
    InvalidOptionError
        If a length is not positive or the centre is not three finite numbers.
    """

    step: float
    center: FloatArray
    size: float

    def __post_init__(self) -> None:
        for name in ("step", "size"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise InvalidOptionError(f"{name} must be a positive length [m]; it is {value}")
        center = np.array(self.center, dtype=np.float64)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise InvalidOptionError(f"center must be 3 finite numbers; it is {self.center}")
        center.flags.writeable = False
        object.__setattr__(self, "center", center)

    def next_probe(
        self,
        contacts: Contacts,
        surface: ImplicitSurface | None,
        *,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe:
        """Return the next probe; see `Policy`. There always is one."""
        if len(outcomes) < len(_AXES):
            return self._opening(outcomes, rng)
        if surface is not None and len(contacts):
            sideways = self._from_within(contacts, surface, outcomes, rng)
            if sideways is not None:
                return sideways
            target = self._target(contacts, surface, outcomes, rng)
            if target is not None:
                slant = _SLANT if outcomes[-1].status == "missed" else 0.0
                return self._approach(*target, contacts, surface, slant)
        return self._pass(rng)

    def _opening(self, outcomes: Sequence[ProbeOutcome], rng: np.random.Generator) -> Probe:
        """Return a probe along an axis to the middle, from a side that had none."""
        had = np.array([outcome.probe.direction for outcome in outcomes]).reshape(-1, 3)
        left = np.flatnonzero(~np.any(_AXES @ had.T > _SAME_DIRECTION, axis=1))
        direction = _AXES[rng.choice(left)]
        target = self.center + _OPENING_SPREAD * self.size * rng.uniform(-1.0, 1.0, size=3)
        return Probe(target, direction, 0.6 * self.size + 0.5 * self.step, 0.0)

    def _from_within(
        self,
        contacts: Contacts,
        surface: ImplicitSurface,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> Probe | None:
        """Return a probe to the wall of a hollow that the estimate bridges, or None."""
        places, ways = bridged_places(contacts, surface, outcomes, self.step)
        starts = np.array([outcome.probe.start for outcome in outcomes])
        directions = np.array([outcome.probe.direction for outcome in outcomes])
        # Sideways from the way in, to a side drawn once for all places.
        sideways = np.cross(ways, rng.normal(size=3))
        sideways /= np.maximum(np.linalg.norm(sideways, axis=1, keepdims=True), 1e-12)
        near = np.linalg.norm(places[:, None] - starts, axis=-1) < self.step  # (K, outcomes)
        new = ~np.any(near & (sideways @ directions.T > _SAME_DIRECTION), axis=1)
        if not new.any():
            return None
        chosen = rng.choice(np.flatnonzero(new))
        half = 0.5 * self.size
        return Probe(places[chosen] + half * sideways[chosen], sideways[chosen], half, half)

    def _target(
        self,
        contacts: Contacts,
        surface: ImplicitSurface,
        outcomes: Sequence[ProbeOutcome],
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the next target and the surface's outward normal there, or None."""
        cell = self.step / _CELLS_PER_STEP
        half = (0.5 + _MARGIN) * self.size
        # A grid that lies differently each time keeps its pattern out of the touches.
        low = self.center - half - cell * rng.random(3)
        points, normals = sample_zero_set(surface, np.array([low, self.center + half]), cell)
        if not len(points):
            return None
        nearest, second = _gaps(points, normals, contacts)
        emptiness = _distance_to_passed(points, outcomes)
        new = emptiness > _PASSED * self.step
        new &= ~self._tried(points, normals, nearest, outcomes)
        # What the estimate has farther away is unconnected to what is known: seldom true, so last.
        connected = new & (nearest <= _BAND[1] * self.step)
        frontier = np.flatnonzero(connected & (nearest >= _BAND[0] * self.step))
        if len(frontier):
            cost = np.abs(nearest - self.step)
            cost += _SECOND_CONTACT * np.minimum(second, 2.0 * self.step)
            cost -= _EMPTINESS * np.minimum(emptiness, self.step)
            cost += _LUCK * self.step * rng.random(len(cost))
            best = frontier[np.argmin(cost[frontier])]
        elif new.any():
            gaps = np.flatnonzero(connected if connected.any() else new)
            best = gaps[np.argmax(nearest[gaps])]
        else:
            return None
        return points[best], normals[best]

    def _tried(
        self,
        points: FloatArray,
        normals: FloatArray,
        gaps: FloatArray,
        outcomes: Sequence[ProbeOutcome],
    ) -> Mask:
        """Tell which points, shape (P,), were a target before, from about the same side."""
        targets = np.array([outcome.probe.target for outcome in outcomes])  # (K, 3)
        directions = np.array([outcome.probe.direction for outcome in outcomes])
        reach = _SAME_TARGET * np.minimum(gaps, self.step)  # (P,)
        near = np.linalg.norm(points[:, None] - targets, axis=-1) < reach[:, None]  # (P, K)
        return np.any(near & (-normals @ directions.T > _SAME_DIRECTION), axis=1)

    def _approach(
        self,
        target: FloatArray,
        normal: FloatArray,
        contacts: Contacts,
        surface: ImplicitSurface,
        slant: float,
    ) -> Probe:
        """Return the probe down on a target, aslant [rad] towards the nearest contact."""
        nearest = np.argmin(np.linalg.norm(contacts.points - target, axis=1))
        away = target - contacts.points[nearest]
        away = away - (away @ normal) * normal
        length = float(np.linalg.norm(away))
        back = np.cos(slant) * normal  # the way back from the target, out of the object
        if length > 0.0:
            back = back + np.sin(slant) * away / length
        # Start a step away, or halfway to whatever the estimate has in the way.
        distances = self.step * np.arange(0.2, 1.01, 0.1)
        inside = surface.evaluate(target + distances[:, None] * back) < 0.0
        standoff = 0.5 * float(distances[np.argmax(inside)]) if inside.any() else self.step
        return Probe(target, -back, standoff, _OVERSHOOT * self.step)

    def _pass(self, rng: np.random.Generator) -> Probe:
        """Return a straight pass right through the object's box, from a random side."""
        direction = rng.normal(size=3)
        target = self.center + self.size * rng.uniform(-0.4, 0.4, size=3)
        return Probe(target, direction, 1.2 * self.size, 1.2 * self.size)


def _gaps(
    points: FloatArray, normals: FloatArray, contacts: Contacts
) -> tuple[FloatArray, FloatArray]:
    """Return each point's distance to the nearest and the second contact on its side, (P,) [m]."""
    apart = np.linalg.norm(points[:, None] - contacts.points, axis=-1)  # (P, N)
    apart[normals @ contacts.normals.T < _FACES_AWAY] = np.inf
    if len(contacts) == 1:
        return apart[:, 0], apart[:, 0]
    nearest = np.partition(apart, 1, axis=1)
    return nearest[:, 0], nearest[:, 1]


def _distance_to_passed(points: FloatArray, outcomes: Sequence[ProbeOutcome]) -> FloatArray:
    """Return each point's distance to where a tip passed and felt nothing, shape (P,) [m]."""
    distance = np.full(len(points), np.inf)
    for outcome in outcomes:
        if outcome.status == "missed":
            probe = outcome.probe
            along = (points - probe.target) @ probe.direction
            along = np.clip(along, -probe.standoff, probe.overshoot)
            passed = probe.target + along[:, None] * probe.direction
            distance = np.minimum(distance, np.linalg.norm(points - passed, axis=1))
    return distance
