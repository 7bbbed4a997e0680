"""The cases of the study: how contacts are drawn, how many, and with how much noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lis_grasp_studies.estimators import Noise

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
    ContactCase("swift", 25),
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
)
"""Every case, in a fixed order: append new ones, for which shapes meet a case depends on it."""
