"""Run configuration: every option of a user, with its default and its validation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, require_at_least
from lis_grasp.exploration import (
    Region,
    StopRule,
    TactileSensor,
    Workspace,
    stop_after,
    stop_when_certain,
    stop_when_covered,
)
from lis_grasp.grasping.grasps import LoadPrior
from lis_grasp.pipeline.plugged_in import POLICY_NAMES, find_estimator
from lis_grasp.shapes import default_mass

PROBERS = ("dynamic", "kinematic")
"""Probers: Drake's dynamics, or geometry alone."""

FINGERS = ("one", "all")
"""Fingers that touch in one approach."""

SIMULATORS = ("drake", "mujoco")
"""Simulators of a lift."""

LOADS = ("known", "unknown")
"""Prior knowledge of mass and friction in planning."""

UNKNOWN_LOAD = LoadPrior(friction=0.8, mass=0.2, friction_spread=0.25, mass_spread=float(np.log(2)))
"""Household objects and fingertips of rubber: 0.06 to 0.7 kg, friction 0.5 to 1.2."""


@dataclass(frozen=True, slots=True)
class StopLimits:
    """Limits that end an exploration early; None for none of a kind.

    Parameters
    ----------
    success
        Predicted probability of a grasp's success, as far as the surface decides it.
    coverage
        Fraction of the estimate that is within a step of a contact.
    uncertainty
        Standard deviation of nearly all of the estimate [m].
    seconds
        Time of the robot [s].
    """

    success: float | None = None
    coverage: float | None = None
    uncertainty: float | None = None
    seconds: float | None = None

    def rules(self, space: Workspace | Region) -> list[StopRule]:
        """Return new rules for the exploration of a space; that of success needs a planner."""
        rules: list[StopRule] = []
        if self.coverage is not None:
            rules.append(stop_when_covered(self.coverage, space))
        if self.uncertainty is not None:
            rules.append(stop_when_certain(self.uncertainty, space))
        if self.seconds is not None:
            rules.append(stop_after(self.seconds))
        return rules


@dataclass(frozen=True, slots=True)
class RunConfig:
    """Configuration of a run.

    The defaults are those of the command line with `--known`; `lis_grasp.pipeline.conditions` has
    those without it.

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
        Name of the surface estimator, a key of `lis_grasp.surfaces.ESTIMATORS`, or a plug-in: the
        name of one that is installed, or ``my.module:Class``.
    prober
        "dynamic" touches in Drake's dynamics; "kinematic" by geometry alone, which is faster.
    fingers
        "one": one touch per probe; "all": the other fingers then extend until they touch too
        (kinematic prober only).
    pose
        "upright" or "stable": the object is placed in such a pose on a table, in the region, as
        the seed decides; or the path of a text file with its pose. None: the object has the pose of
        its mesh, and is touched in the air unless it is `free`.
    region
        Lengths along x, y and z [m] of the box on the table that contains the object: the only
        prior knowledge. None: position and size of the object are known. Needs a pose.
    free
        Whether the object is free on a table and may be pushed by touches; else it is fixed.
    policy
        Policy of the next touch, a key of `lis_grasp.exploration.POLICIES`, or a plug-in.
    until_success, until_coverage, until_uncertainty, max_seconds
        Stop early: when a grasp is predicted to succeed with this probability, as far as the
        surface decides it; when this fraction of the estimate is within a step of a contact; when
        nearly all of the estimate has at most this standard deviation [m]; after this robot
        time [s].
    position_noise, normal_noise
        Noise of the tactile sensor, given to the estimator: one standard deviation of positions
        along each axis [m], of each component of normals [rad].
    force_threshold, taxel_pitch
        Smallest force that the sensor detects [N], and the distance of its taxels [m].
    free_space
        Whether the space that the hand passed through is removed from the estimate.
    cloud
        Path of a file of contacts that are known before the first touch, for example a depth
        camera's point cloud with normals, in the object frame; None for none.
    touches
        Contacts to make before grasping.
    seed
        Seed of every random draw.
    mass
        Mass of the true object [kg]; None for that of `lis_grasp.shapes.default_mass`.
    friction
        True Coulomb friction between hand and object.
    load
        Prior knowledge of mass and friction: "known" their true values, "unknown" the
        distribution `UNKNOWN_LOAD`.
    grasps
        Ranked grasps to plan; the first is executed.
    attempts
        Grasps to try at most; another is planned after a failed tactile check.
    simulator
        Simulator of the lift: "drake", or "mujoco", which needs the extra ``mujoco``.
    arm
        The arm that carries the hand: a name or the path of an arm's YAML file; None for a hand
        that flies freely.
    base
        Place of the arm's base: x and y in the frame of the table, and the height above it [m]; it
        faces along +x. None for a place that `choose_base` finds.

    Raises
    ------
    InvalidOptionError
        If a value is out of range, or two contradict each other.
    """

    object: str = "box"
    size: float | None = None
    units: str = "m"
    hand: str = "allegro"
    estimator: str = "blend"
    prober: str = "dynamic"
    fingers: str = "one"
    pose: str | None = None
    region: tuple[float, ...] | None = None
    free: bool = False
    policy: str = "spread"
    until_success: float | None = None
    until_coverage: float | None = None
    until_uncertainty: float | None = None
    max_seconds: float | None = None
    position_noise: float = 0.0
    normal_noise: float = 0.0
    force_threshold: float = 0.0
    taxel_pitch: float = 0.0
    free_space: bool = True
    cloud: str | None = None
    touches: int = 40
    seed: int = 0
    mass: float | None = None
    friction: float = 0.8
    load: str = "known"
    grasps: int = 10
    attempts: int = 3
    simulator: str = "drake"
    arm: str | None = None
    base: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        for name, choices in (
            ("prober", PROBERS),
            ("fingers", FINGERS),
            ("simulator", SIMULATORS),
            ("load", LOADS),
        ):
            if getattr(self, name) not in choices:
                raise InvalidOptionError.not_one_of(name, getattr(self, name), choices)
        find_estimator(self.estimator)
        POLICY_NAMES.find(self.policy)
        require_at_least(1, touches=self.touches, grasps=self.grasps, attempts=self.attempts)
        require_at_least(0, seed=self.seed)
        for name in ("mass", "friction"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= 1e9:
                raise InvalidOptionError.out_of_range(name, value, "positive")
        if self.free and self.prober != "dynamic":
            raise InvalidOptionError(
                f"a free object needs the dynamic prober; it is {self.prober}", option="free"
            )
        if self.fingers != "one" and self.prober != "kinematic":
            raise InvalidOptionError(
                f"fingers '{self.fingers}' need the kinematic prober; it is {self.prober}",
                option="fingers",
            )
        if self.region is not None:
            object.__setattr__(self, "region", Region(self.region).lengths)
            if self.pose is None:
                raise InvalidOptionError(
                    "an object in a region needs a pose there, such as 'stable'; there is none",
                    option="pose",
                )
        if self.until_success is not None and not 0 < self.until_success < 1:
            raise InvalidOptionError.out_of_range(
                "until_success", self.until_success, "above 0 and below 1"
            )
        if self.arm is not None and self.simulator != "drake":
            raise InvalidOptionError(
                f"an arm is simulated in drake; the simulator is {self.simulator}", option="arm"
            )
        if self.base is not None:
            base = tuple(float(x) for x in self.base)
            if len(base) != 3 or not np.isfinite(base).all():
                raise InvalidOptionError.out_of_range("base", self.base, "3 finite numbers")
            if self.arm is None:
                raise InvalidOptionError("a base needs an arm: name it with --arm", option="base")
            object.__setattr__(self, "base", base)
        # Both validate the remaining fields.
        self.sensor()
        self.stop_limits().rules(Workspace(1.0, np.zeros(3), 1.0))

    def stop_limits(self) -> StopLimits:
        """Return the limits that end an exploration early."""
        return StopLimits(
            self.until_success, self.until_coverage, self.until_uncertainty, self.max_seconds
        )

    @classmethod
    def from_facts(
        cls, given: Mapping[str, Any], recorded: Mapping[str, Any] = MappingProxyType({})
    ) -> RunConfig:
        """Return a configuration of values by name: given ones, else recorded, else the defaults.

        None and other names count as absent. Recorded plug-ins that are not among the given names
        are left out: they are not used, and perhaps not installed. Another object than the
        recorded one has another size and units.
        """
        left_out = {name for name in ("estimator", "policy") if name not in given}
        if given.get("object") not in (None, recorded.get("object")):
            left_out |= {"size", "units"}
        facts = cls().facts()
        for values in ({k: v for k, v in recorded.items() if k not in left_out}, given):
            facts |= {name: values[name] for name in facts if values.get(name) is not None}
        return cls(**facts)

    def mass_of(self, mesh: trimesh.Trimesh) -> float:
        """Return the configured mass of an object [kg], or else `default_mass` of its mesh."""
        return default_mass(mesh, self.object) if self.mass is None else self.mass

    def sensor(self) -> TactileSensor:
        """Return the tactile sensor of the hand."""
        return TactileSensor(
            force_threshold=self.force_threshold,
            position_noise=self.position_noise,
            normal_noise=self.normal_noise,
            taxel_pitch=self.taxel_pitch,
        )

    def facts(self) -> dict[str, Any]:
        """Return the configuration as plain values, for file headers and reports."""
        facts = asdict(self)
        lists = {name: facts[name] for name in ("region", "base")}
        return facts | {name: None if v is None else list(v) for name, v in lists.items()}
