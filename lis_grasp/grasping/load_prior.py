"""Prior knowledge of an object's mass and friction, as log-normal distributions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lis_grasp.exceptions import InvalidOptionError, require_positive

# Nodes and weights of the Gauss-Hermite rule with three nodes, for a standard normal variable.
_NODES, _WEIGHTS = (0.0, -np.sqrt(3.0), np.sqrt(3.0)), (2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0)


@dataclass(frozen=True, slots=True)
class LoadPrior:
    """Mass of an object and its friction on the hand, each log-normal.

    Parameters
    ----------
    friction, mass
        Medians: Coulomb coefficient, and mass [kg].
    friction_spread, mass_spread
        Standard deviations of the natural logarithms; 0 if the value is known.

    Raises
    ------
    InvalidOptionError
        If a median is not positive, or a spread is negative.
    """

    friction: float = 0.8
    mass: float = 0.2
    friction_spread: float = 0.0
    mass_spread: float = 0.0

    def __post_init__(self) -> None:
        require_positive(friction=self.friction, mass=self.mass)
        for name in ("friction_spread", "mass_spread"):
            if not getattr(self, name) >= 0.0:
                raise InvalidOptionError.out_of_range(name, getattr(self, name), "at least 0")

    @property
    def is_known(self) -> bool:
        """Whether both values are known exactly."""
        return self.friction_spread == self.mass_spread == 0.0

    def frictions(self) -> Iterator[tuple[float, float]]:
        """Return coefficients and their weights, which add up to 1; the median comes first."""
        return _nodes(self.friction, self.friction_spread)

    def masses(self) -> Iterator[tuple[float, float]]:
        """Return masses [kg] and their weights, which add up to 1; the median comes first."""
        return _nodes(self.mass, self.mass_spread)


def _nodes(median: float, spread: float) -> Iterator[tuple[float, float]]:
    if spread == 0.0:
        yield median, 1.0
        return
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        yield float(median * np.exp(spread * node)), weight
