"""Contact sets of the study: a shape, a case and a seed make the contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from zlib import crc32

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp_studies.contact_study.cases import CASES, ContactCase
from lis_grasp_studies.contact_study.draws import DRAWS, explored_contacts
from lis_grasp_studies.contact_study.surface_points import SurfacePoints
from lis_grasp_studies.estimators import Noise
from lis_grasp_studies.test_objects.shape_sets import DEVELOPMENT, build_shape, family_of

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


def development_sets(
    shapes: Sequence[str] | None = None,
    cases: Sequence[ContactCase] = CASES,
    *,
    part: int = 3,
    seed: int = 0,
) -> Iterator[ContactSet]:
    """Yield contact sets of development shapes, by default of all; settings are chosen on these.

    Each shape meets one case of `part`, another selection for each shape: 1 yields every case.
    """
    names = [name for family in DEVELOPMENT.values() for name in family]
    for name, case in balanced(names if shapes is None else shapes, cases, part):
        yield contact_set(name, case, seed)


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
