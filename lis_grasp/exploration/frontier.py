"""The paper's explorer: go on from where the surface is known by one step, then fill the gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.probe import Probe, ProbeOutcome
from lis_grasp.exploration.zero_set import sample_zero_set
from lis_grasp.surfaces import ImplicitSurface

FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_AXES = np.vstack([np.eye(3), -np.eye(3)])
# Probes along the axes that must touch before the estimate takes over: three sides of the object.
_OPENINGS = 3
# The frontier lies about one step from the nearest contact; in units of the step.
_BAND = (0.8, 1.2)
# Grid cells a step: the frontier's band is some two cells wide.
_CELLS_PER_STEP = 5.0
# A target is the same as an earlier one within this share of its gap, if their directions agree.
_SAME_TARGET, _SAME_DIRECTION = 0.4, np.cos(np.radians(50.0))
# Where a tip passed and felt nothing there is no surface, within this share of a step.
_PASSED = 0.2
# A contact says nothing of a surface that faces away from it, as the far side of a thin wall does.
_FACES_AWAY = -0.5
# The estimate is searched beyond the object's known size by this share of it.
_MARGIN = 0.05
_TILT = np.radians(30)
_OVERSHOOT = 1.5
_SECOND = 0.25
_TILT0 = 0.0
_SHY = 0.5
_AXES6 = True
_FRONTIER = "frontier"


@dataclass(frozen=True, slots=True, eq=False)
class FrontierPolicy:
    """Touch next where the estimated surface leaves the known, about one step from any contact.

    First, probes along the axes through the object's middle, until three have touched. Then the
    next target lies on the frontier: on the estimated zero set, about a step from the nearest
    contact, where it is closest to others too, so that the known region grows without holes. It
    is approached against the estimated outward normal. When no frontier is left, the largest gap is
    filled: the point of the estimated surface farthest from any contact. Targets probed before,
    and places that a tip passed through, are not tried again. When the estimate offers nothing
    at all, a straight pass through the object's known box is drawn.

    Ottenhaus et al. 2016, section IV.B, give the step (50 mm on objects of 20 cm), that the next
    target follows from the contacts and the estimated surface, and no more; the rest is ours.

    Parameters
    ----------
    step
        Distance between touches [m].
    center
        Shape (3,) [m], in O: the middle of the object, as known beforehand.
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
    ) -> Probe | None:
        """Return the next probe; see `Policy`. There always is one: explore bounds their number."""
        opening = self._opening(outcomes, rng)
        if opening is not None:
            return opening
        if surface is not None and len(contacts):
            found = self._target(contacts, surface, outcomes, rng)
            if found is not None:
                target, normal = found
                away = target - contacts.points[np.argmin(np.linalg.norm(contacts.points - target, axis=1))]
                away -= (away @ normal) * normal
                away /= max(np.linalg.norm(away), 1e-12)
                tilt = _TILT if outcomes[-1].status == "missed" else _TILT0
                outward = normal + np.tan(tilt) * away
                outward /= np.linalg.norm(outward)
                standoff = self._free_standoff(surface, target, outward)
                return Probe(target, -outward, standoff, _OVERSHOOT*self.step, _FRONTIER)
        return self._pass(rng)

    def _opening(
        self, outcomes: Sequence[ProbeOutcome], rng: np.random.Generator
    ) -> Probe | None:
        """Return a probe along an axis through the middle, from a side not yet tried."""
        tried = np.zeros(len(_AXES), dtype=bool)
        touched = np.zeros(3, dtype=bool)
        for outcome in outcomes[: len(_AXES)]:
            if np.array_equal(outcome.probe.target, self.center):
                direction = int(np.argmax(_AXES @ outcome.probe.direction))
                tried[direction] = True
                touched[direction % 3] |= outcome.status == "touched"
        if (not _AXES6 and touched.sum() >= _OPENINGS) or tried.all():
            return None
        open_ = np.flatnonzero(~tried & (_AXES6 | ~np.tile(touched, 2)))
        if not len(open_):
            return None
        start = 0.5 * self.size + 0.5 * self.step
        return Probe(self.center, _AXES[rng.choice(open_)], start, 0.5 * self.size)

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
        corner = self.center - half - cell * rng.random(3)
        points, normals = sample_zero_set(
            surface, np.array([corner, self.center + half]), cell
        )
        if not len(points):
            return None
        nearest, second = _gaps(points, normals, contacts)
        known, shy = self._known(points, normals, nearest, outcomes)
        new = ~known
        low, high = (share * self.step for share in _BAND)
        frontier = np.flatnonzero(new & (nearest >= low) & (nearest <= high))
        if len(frontier):
            cost = np.abs(nearest - self.step) + _SECOND * np.minimum(second, 2.0 * self.step) + _SHY * np.maximum(self.step - shy, 0)
            best = frontier[np.argmin(cost[frontier])]
        elif new.any():
            best = np.flatnonzero(new)[np.argmax(nearest[new])]
        else:
            return None
        return points[best], normals[best]

    def _known(
        self,
        points: FloatArray,
        normals: FloatArray,
        gaps: FloatArray,
        outcomes: Sequence[ProbeOutcome],
    ) -> Mask:
        """Tell which points were a target before, or lie where a tip passed and felt nothing."""
        known = np.zeros(len(points), dtype=bool)
        shy = np.full(len(points), np.inf)
        reach = _SAME_TARGET * np.minimum(gaps, self.step)
        for outcome in outcomes:
            probe = outcome.probe
            apart = np.linalg.norm(points - probe.target, axis=1)
            known |= (apart < reach) & (-normals @ probe.direction > _SAME_DIRECTION)
            if outcome.status == "missed":
                along = np.clip(
                    (points - probe.target) @ probe.direction, -probe.standoff, probe.overshoot
                )
                passed = probe.target + along[:, None] * probe.direction
                apart = np.linalg.norm(points - passed, axis=1)
                known |= apart < _PASSED * self.step
                shy = np.minimum(shy, apart)
        return known, shy

    def _free_standoff(
        self, surface: ImplicitSurface, target: FloatArray, normal: FloatArray
    ) -> float:
        """Return how far before the target to start: a step, or half the room that there is."""
        distances = self.step * np.arange(0.2, 1.01, 0.1)
        inside = surface.evaluate(target + distances[:, None] * normal) < 0.0
        return 0.5 * float(distances[np.argmax(inside)]) if inside.any() else self.step

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
    ordered = np.partition(apart, 1, axis=1)
    return ordered[:, 0], ordered[:, 1]
