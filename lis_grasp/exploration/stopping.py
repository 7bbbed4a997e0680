"""Stop rules of an exploration: by coverage, by uncertainty, or by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration.probe import ProbeOutcome
from lis_grasp.exploration.targets import gaps
from lis_grasp.exploration.workspace import Workspace
from lis_grasp.surfaces import ImplicitSurface

# Quantile of the surface that has to be certain: the rest is where the estimate leaves the
# workspace.
_CERTAIN_QUANTILE = 0.95


class StopRule(Protocol):
    """Decides whether an exploration ends, from what it knows; never from the true object."""

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to continue."""
        ...


@dataclass(frozen=True, slots=True)
class Covered:
    """Stop when a fraction of the estimated surface is within a step of a contact.

    Parameters
    ----------
    fraction
        From 0 to 1.
    space
        Region in which the estimate is sampled.
    """

    fraction: float
    space: Workspace

    def __post_init__(self) -> None:
        if not 0.0 < self.fraction <= 1.0:
            raise InvalidOptionError.out_of_range(
                "coverage", self.fraction, "above 0 and at most 1"
            )

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to continue; see `StopRule`."""
        points, normals = self.space.sample(surface)
        if not len(points):
            return None
        nearest, _ = gaps(points, normals, contacts)
        covered = float(np.mean(nearest <= self.space.step))
        if covered < self.fraction:
            return None
        return f"{100.0 * covered:.0f} % of the estimate is within a step of a contact"


@dataclass(frozen=True, slots=True)
class Certain:
    """Stop when 95 % of the estimated surface has at most a given standard deviation.

    Parameters
    ----------
    deviation
        One standard deviation of the surface along its normal [m].
    space
        Region in which the estimate is sampled.
    """

    deviation: float
    space: Workspace

    def __post_init__(self) -> None:
        if not (np.isfinite(self.deviation) and self.deviation > 0.0):
            raise InvalidOptionError.out_of_range("uncertainty", self.deviation, "above 0 m")

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to continue; see `StopRule`."""
        points, _ = self.space.sample(surface)
        if not len(points):
            return None
        deviation = float(np.quantile(surface.uncertainty(points), _CERTAIN_QUANTILE))
        if deviation > self.deviation:
            return None
        return f"95 % of the estimate is certain to {1e3 * deviation:.2g} mm"


@dataclass(frozen=True, slots=True)
class TimeSpent:
    """Stop when the probes have taken a given time.

    Parameters
    ----------
    seconds
        Time of the robot [s].
    """

    seconds: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.seconds) and self.seconds > 0.0):
            raise InvalidOptionError.out_of_range("max_seconds", self.seconds, "above 0 s")

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to continue; see `StopRule`."""
        spent = sum(outcome.duration for outcome in outcomes)
        return f"{spent:.0f} s are spent" if spent >= self.seconds else None
