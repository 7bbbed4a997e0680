"""What a run does: every choice that a user has, checked before any work."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.exploration import (
    POLICIES,
    Certain,
    Covered,
    StopRule,
    TactileSensor,
    TimeSpent,
    Workspace,
)
from lis_grasp.surfaces import ESTIMATORS

PROBERS = ("dynamic", "kinematic")
"""What can carry out touches."""

FINGERS = ("one", "all")
"""Which fingers touch in one approach."""


@dataclass(frozen=True, slots=True)
class RunConfig:
    """What a run does; the defaults of the command line are these.

    Parameters
    ----------
    object
        Name of a built-in shape, or path of a mesh file.
    size
        Largest extent of a built-in shape [m]; None for a size that the hand can grasp.
    units
        Length unit of a mesh file.
    hand
        Name of a shipped hand, or path of a hand's YAML file.
    estimator
        Name of the surface estimator, a key of `lis_grasp.surfaces.ESTIMATORS`.
    prober
        "dynamic": the hand touches in Drake; "kinematic": by geometry alone, some times faster.
    fingers
        "one": one touch a probe; "all": then the other fingers stretch out until they touch too
        (kinematic prober only).
    free
        Whether the object stands on a table and may be pushed while it is touched; else it is held.
    policy
        What chooses the next touch, a key of `lis_grasp.exploration.POLICIES`.
    until_coverage, until_uncertainty, max_seconds
        End the touching early: when this share of the estimate is within a step of a contact, when
        nearly all of it is known to this standard deviation [m], after this time of the robot [s].
    position_noise, normal_noise
        Of the tactile sensor: one standard deviation of positions along each axis [m], of each
        component of normals [rad]. The estimator is told.
    free_space
        Whether the space that the hand passed through is carved off the estimate.
    touches
        Contacts to make before grasping.
    seed
        Seed of every random draw.
    mass
        Mass of the true object in the lift [kg].
    friction
        Coulomb friction between hand and object, in planning and in the lift.
    grasps
        Ranked grasps to plan; the first is executed.
    attempts
        Grasps to try at the most: a hand that feels that a grasp will not hold plans again.
    """

    object: str = "box"
    size: float | None = None
    units: str = "m"
    hand: str = "allegro"
    estimator: str = "blend"
    prober: str = "dynamic"
    fingers: str = "one"
    free: bool = False
    policy: str = "spread"
    until_coverage: float | None = None
    until_uncertainty: float | None = None
    max_seconds: float | None = None
    position_noise: float = 0.0
    normal_noise: float = 0.0
    free_space: bool = True
    touches: int = 40
    seed: int = 0
    mass: float = 0.2
    friction: float = 0.8
    grasps: int = 10
    attempts: int = 3

    def __post_init__(self) -> None:
        for name, choices in (
            ("estimator", tuple(ESTIMATORS)),
            ("prober", PROBERS),
            ("fingers", FINGERS),
            ("policy", tuple(POLICIES)),
        ):
            if getattr(self, name) not in choices:
                raise InvalidOptionError(
                    f"{name} must be one of {', '.join(choices)}; it is '{getattr(self, name)}'"
                )
        for name in ("touches", "grasps", "attempts"):
            if getattr(self, name) < 1:
                raise InvalidOptionError(f"{name} must be at least 1; it is {getattr(self, name)}")
        if self.free and self.prober != "dynamic":
            raise InvalidOptionError(
                f"an object that stands free needs the dynamic prober; it is '{self.prober}'"
            )
        if self.fingers != "one" and self.prober != "kinematic":
            raise InvalidOptionError(
                f"touching with all fingers needs the kinematic prober; it is '{self.prober}'"
            )
        if self.seed < 0:
            raise InvalidOptionError(f"seed must not be negative; it is {self.seed}")
        self.sensor()
        self.stop_rules(Workspace(1.0, np.zeros(3), 1.0))  # refused here, before any work
        for name in ("mass", "friction"):
            value = getattr(self, name)
            if not 0 < value <= 1e9:
                raise InvalidOptionError(f"{name} must be a positive number; it is {value}")

    def sensor(self) -> TactileSensor:
        """Return the tactile sensor that the hand touches with."""
        return TactileSensor(position_noise=self.position_noise, normal_noise=self.normal_noise)

    def stop_rules(self, space: Workspace) -> list[StopRule]:
        """Return what ends the touching early in a workspace."""
        rules: list[StopRule] = []
        if self.until_coverage is not None:
            rules.append(Covered(self.until_coverage, space))
        if self.until_uncertainty is not None:
            rules.append(Certain(self.until_uncertainty, space))
        if self.max_seconds is not None:
            rules.append(TimeSpent(self.max_seconds))
        return rules

    def facts(self) -> dict[str, Any]:
        """Return the configuration as plain values, for file headers and reports."""
        return asdict(self)
