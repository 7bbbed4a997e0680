"""Contact sets of the study: a shape, a case (draw, number, noise) and a seed make contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp_studies.contact_study.draws import DRAWS, explored_contacts
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import Noise
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT, build_shape, family_of

NOISE_LEVELS: tuple[tuple[float, float], ...] = ((0, 0), (1, 3), (2, 6), (5, 15), (10, 30))
"""Noise of positions [mm] and of normals [degrees], one standard deviation along each axis."""


@dataclass(frozen=True, slots=True)
class ContactCase:
    """How the contacts of a set are drawn from a shape.

    Parameters
    ----------
    draw
        A key of `DRAWS` or of `EXPLORATIONS`.
    count
        Number of contacts.
    level
        Index of the noise in `NOISE_LEVELS`.
    given
        Whether estimators are given the noise.
    """

    draw: str
    count: int
    level: int = 0
    given: bool = False

    @property
    def name(self) -> str:
        """Short name, such as ``even-30-2mm-given``."""
        parts = [self.draw, str(self.count)]
        if self.level:
            parts.append(f"{NOISE_LEVELS[self.level][0]:g}mm")
        return "-".join([*parts, "given"] if self.given else parts)

    @property
    def kind(self) -> str:
        """What a table calls it: its draw, policies together, few and noisy contacts apart."""
        if self.level:
            return "noisy, given" if self.given else "noisy, not given"
        if self.count < FEW:
            return "few"
        return self.draw if self.draw in ("even", "random", "clustered", "half") else "explored"

    @property
    def noise(self) -> Noise:
        """The noise of its contacts."""
        millimetres, degrees = NOISE_LEVELS[self.level]
        return Noise(1e-3 * millimetres, float(np.deg2rad(degrees)))


FEW = 12
"""Clean sets of fewer contacts make the kind "few"."""

KINDS = (
    *("even", "random", "clustered", "half", "explored"),
    *("few", "noisy, given", "noisy, not given"),
)
"""Kinds of sets, in the order of tables."""

CASES: tuple[ContactCase, ...] = (
    *(ContactCase("even", count) for count in (5, 8, 12, 20, 40, 100, 400)),
    *(ContactCase("random", count) for count in (10, 20, 45, 150)),
    *(ContactCase("clustered", count) for count in (30, 60, 120, 240)),
    *(ContactCase("half", count) for count in (12, 30)),
    ContactCase("spread", 40),
    ContactCase("spread", 25),
    ContactCase("uncertainty", 15),
    ContactCase("frontier", 40),
    ContactCase("even", 40, level=1, given=True),
    ContactCase("even", 30, level=2, given=True),
    ContactCase("even", 30, level=2),
    ContactCase("random", 40, level=2),
    ContactCase("clustered", 90, level=1),
    ContactCase("clustered", 120, level=3, given=True),
    ContactCase("even", 60, level=3),
    ContactCase("spread", 50, level=3, given=True),
    ContactCase("random", 80, level=4, given=True),
    ContactCase("random", 80, level=4),
    ContactCase("random_targets", 30),
    ContactCase("spread", 20),
)
"""Every case, in a fixed order: append new ones, for which shapes meet a case depends on it."""


_DRAW, _NOISE = 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class ContactSet:
    """Contacts of one shape: what an estimator gets, and the truth to measure it by."""

    shape: Shape
    family: str
    case: ContactCase
    seed: int
    exact: Contacts
    """Without noise: what was explored."""
    contacts: Contacts
    """With the noise of the case."""

    @property
    def given_noise(self) -> Noise:
        """The noise that an estimator is given: none if the case withholds it."""
        return self.case.noise if self.case.given else Noise()

    @property
    def name(self) -> str:
        """Shape, case and seed."""
        return f"{self.shape.name}/{self.case.name}/{self.seed}"


def contact_set(shape: str, case: ContactCase, seed: int = 0) -> ContactSet:
    """Return the contacts of a shape (a name, or the path of a mesh file) in a case.

    The same arguments return the same contacts, bit for bit. A case given its noise has the same
    contacts as the one that is not.
    """
    surface = _surface(shape)
    key = [seed, crc32(surface.shape.name.encode()), crc32(case.draw.encode()), case.count]
    if case.draw in DRAWS:
        exact = DRAWS[case.draw](surface, case.count, rng=np.random.default_rng([_DRAW, *key]))
    else:
        exact = explored_contacts(surface.shape, _hand(), case.draw, case.count, seed=seed)
    noisy = case.noise.disturb(exact, rng=np.random.default_rng([_NOISE, *key, case.level]))
    return ContactSet(surface.shape, family_of(shape), case, seed, exact, noisy)


def development_sets(part: int) -> Iterator[ContactSet]:
    """Yield contact sets of the development shapes, on which settings are chosen.

    Each shape meets one case of `part`, another selection for each shape: 1 yields every case.
    """
    names = [name for family in DEVELOPMENT.values() for name in family]
    for name, case in balanced(names, CASES, part):
        yield contact_set(name, case)


def balanced(
    shapes: Sequence[str], cases: Sequence[ContactCase], part: int
) -> list[tuple[str, ContactCase]]:
    """Return pairs of shapes and cases: each shape meets one case of `part`, shifted by shape."""
    return [
        (shape, case)
        for i, shape in enumerate(shapes)
        for j, case in enumerate(cases)
        if (i + j) % part == 0
    ]


@lru_cache(maxsize=4)
def _surface(shape: str) -> SurfacePoints:
    return SurfacePoints.of(build_shape(shape))


@lru_cache(maxsize=1)
def _hand() -> Hand:
    return Hand.load("allegro")
