"""Belief about the bodies beside the object: where they are, and which contacts are theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exploration.neighbours import BodyTouch
from lis_grasp.geometry import apply_pose
from lis_grasp.records import reduce_record
from lis_grasp.typing import FloatArray
from lis_grasp.world.surroundings import Surroundings

# A body's contact is this far from its surface at most, beside the error of its place [m]; where
# contacts are noisier, this many standard deviations.
_OF_CONTACTS, _DEVIATIONS = 0.001, 4.0

# A contact faces a body, and is the object's, if its normal comes nearer to the body by this
# cosine.
_FACES = 0.5
# Least cosine of a contact's normal and the body's own, to correct the body's place.
_ALONG = 0.9
# Noise of a contact whose own is not known [m].
_LEAST_NOISE = 1e-4


@dataclass(frozen=True, eq=False)  # no slots: for cached_property
class KnownBodies:
    """The bodies that the robot knows of, as a `Neighbours` of an exploration.

    A contact within a band of a body's believed surface is its: the band is the error of its place
    and that of the contact. Where the contact's normal points at the body, it is the object's,
    which faces the body. A contact corrects the believed place along its normal, by the posterior
    mean of a Gaussian: the prior is level, with the variance of a uniform disc of radius `error`.

    Examples
    --------
    >>> from lis_grasp.world import Body
    >>> wall = Body.box("wall", (0.02, 0.4, 0.2), (0.1, 0.0, 0.1))
    >>> bodies = KnownBodies(Surroundings((wall,)))
    >>> bodies.distances(np.array([[0.0, 0.0, 0.1]])).round(3).tolist()
    [0.09]
    """

    surroundings: Surroundings  #: where they are believed to be, in the frame W of the first probe
    error: float = 0.0  #: largest error of their level places [m]
    noise: float = 0.0  #: of a contact's position, one standard deviation [m]
    X_WE: FloatArray = field(default_factory=lambda: np.eye(4))  #: (4, 4)
    #: (3, 3) [m^2] of a body's place, by its name; of others the prior's
    covariances: Mapping[str, FloatArray] = field(default_factory=lambda: MappingProxyType({}))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return reduce_record(self)

    def in_frame(self, X_EF: FloatArray) -> KnownBodies:
        """Return the same bodies in a frame F, whose pose in the present E is `X_EF` (4, 4)."""
        return replace(self, X_WE=self.X_WE @ X_EF)

    @property
    def poses(self) -> Mapping[str, FloatArray]:
        """Believed poses (4, 4) of the bodies by their names, in W."""
        return {body.name: body.X_EB for body in self.surroundings}

    @property
    def band(self) -> float:
        """Distance from a believed surface within which a contact is the body's [m]."""
        return self.error + max(_OF_CONTACTS, _DEVIATIONS * self.noise)

    def distances(self, points: FloatArray) -> FloatArray:
        """Return the signed distance (P,) of points (P, 3) from the nearest body [m]."""
        return self._by_body(points).min(axis=1, initial=np.inf)

    def nearest(self, points: FloatArray) -> str:
        """Return the name of the body nearest to any of the points (P, 3)."""
        nearest = int(self._by_body(points).min(axis=0).argmin())
        return self.surroundings.bodies[nearest].name

    def whose(self, contacts: Contacts) -> list[str | None]:
        """Return for each contact the body that it belongs to; None for the object."""
        points, normals = contacts.points, contacts.normals
        distances = self._by_body(points)  # (N, B)
        if not distances.size:
            return [None] * len(points)
        step = 2.0 * self.band
        ahead, behind = (self._by_body(points + s * normals) for s in (step, -step))
        away = (ahead - behind) / (2.0 * step)  # cosines to the bodies' own normals
        theirs = (np.abs(distances) <= self.band) & (away > -_FACES)
        nearest = np.where(theirs, np.abs(distances), np.inf).argmin(axis=1)
        names = [body.name for body in self.surroundings]
        return [names[k] if row[k] else None for k, row in zip(nearest, theirs, strict=True)]

    def corrected(self, touches: Sequence[BodyTouch]) -> KnownBodies:
        """Return the bodies at the places that touches show, along the normals of these."""
        if self.error == 0.0:
            return self
        bodies = self
        for touch in touches:
            bodies = bodies._corrected_by(touch)
        return bodies

    def _corrected_by(self, touch: BodyTouch) -> KnownBodies:
        body = next(one for one in self.surroundings if one.name == touch.body)
        ends = touch.point + np.outer([1.0, 0.0, -1.0], _LEAST_NOISE * touch.normal)
        ahead, distance, behind = body.distances(ends)
        if (ahead - behind) / (2.0 * _LEAST_NOISE) < _ALONG:
            return self  # the nearest surface is another face or an edge
        prior = np.diag([0.25, 0.25, 0.0]) * self.error**2  # of a uniform disc
        covariance = self.covariances.get(touch.body, prior)
        spread = covariance @ touch.normal
        variance = max(self.noise, _LEAST_NOISE) ** 2 + float(touch.normal @ spread)
        moved = spread * float(distance) / variance
        X_WB = body.X_EB.copy()
        X_WB[:3, 3] += moved
        covariance = covariance - np.outer(spread, spread) / variance
        return replace(
            self,
            surroundings=self.surroundings.placed({touch.body: X_WB}),
            covariances=MappingProxyType({**self.covariances, touch.body: covariance}),
        )

    @cached_property
    def _moved(self) -> bool:
        return not np.array_equal(self.X_WE, np.eye(4))

    def _by_body(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (P, B) of points (P, 3) in E from each body [m]."""
        points = apply_pose(self.X_WE, points) if self._moved else points
        return self.surroundings.distances(points)
