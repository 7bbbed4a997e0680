"""When an exploration knows enough: by coverage, by certainty, or by the time it took."""

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

# Share of the estimated surface that has to be certain: the last percents lie where the estimate
# runs out of the workspace.
_CERTAIN_SHARE = 0.95


class StopRule(Protocol):
    """Says whether an exploration may end, from what it knows; never from the true object."""

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to go on."""
        ...


@dataclass(frozen=True, slots=True)
class Covered:
    """Stop when a share of the estimated surface is within a step of a contact.

    Parameters
    ----------
    share
        From 0 to 1.
    space
        Where the estimate is looked at.
    """

    share: float
    space: Workspace

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise InvalidOptionError(
                f"a coverage must be above 0 and at most 1; it is {self.share}"
            )

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to go on; see `StopRule`."""
        points, normals = self.space.sample(surface)
        if not len(points):
            return None
        nearest, _ = gaps(points, normals, contacts)
        reached = float(np.mean(nearest <= self.space.step))
        if reached < self.share:
            return None
        return f"{100.0 * reached:.0f} % of the estimate is within a step of a contact"


@dataclass(frozen=True, slots=True)
class Certain:
    """Stop when nearly all of the estimated surface is known to a standard deviation.

    Parameters
    ----------
    deviation
        One standard deviation of the surface along its normal [m].
    space
        Where the estimate is looked at.
    """

    deviation: float
    space: Workspace

    def __post_init__(self) -> None:
        if not (np.isfinite(self.deviation) and self.deviation > 0.0):
            raise InvalidOptionError(f"uncertainty must be above 0 m; it is {self.deviation}")

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to go on; see `StopRule`."""
        points, _ = self.space.sample(surface)
        if not len(points):
            return None
        reached = float(np.quantile(surface.uncertainty(points), _CERTAIN_SHARE))
        if reached > self.deviation:
            return None
        return f"95 % of the estimate is known to {1e3 * reached:.2g} mm"


@dataclass(frozen=True, slots=True)
class TimeSpent:
    """Stop when the probes took so long.

    Parameters
    ----------
    seconds
        Of the robot's time [s].
    """

    seconds: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.seconds) and self.seconds > 0.0):
            raise InvalidOptionError(f"the time must be above 0 s; it is {self.seconds}")

    def reason_to_stop(
        self, contacts: Contacts, surface: ImplicitSurface, outcomes: Sequence[ProbeOutcome]
    ) -> str | None:
        """Return why to stop, or None to go on; see `StopRule`."""
        spent = sum(outcome.duration for outcome in outcomes)
        return f"{spent:.0f} s are spent" if spent >= self.seconds else None
