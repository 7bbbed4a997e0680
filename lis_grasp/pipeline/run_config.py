"""Run configuration: every option of a user, declared once with its default and its check."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any, TypeVar

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
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.pipeline.conditions import REAL_SENSOR
from lis_grasp.plugins import Registry
from lis_grasp.shapes import NAMES, UNITS, default_mass
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES, find_estimator

PROBERS = ("dynamic", "kinematic")
"""Probers: Drake's dynamics, or geometry alone."""

FINGERS = ("one", "all")
"""Fingers that touch in one approach."""

SIMULATORS = ("drake", "mujoco")
"""Simulators of a lift."""

LOADS = ("known", "unknown")
"""Prior knowledge of mass and friction in planning."""

ESTIMATOR_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "blend": "smooth patches that meet in edges, or gpis where that predicts as well",
        "gpis": "a Gaussian process, which rounds edges",
        "patch": "the patches alone",
        "lis": "the paper's tangent planes",
    }
)
"""The package's estimators in words."""

POLICY_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "spread": "farthest from all contacts",
        "swift": "the same, with little motion",
        "frontier": "next to the contacts, as in the paper",
        "uncertainty": "where the estimate is most uncertain",
        "random": "anywhere on the estimate",
    }
)
"""The package's policies in words."""

TOUCHING, SENSOR, SURFACE = "touching", "tactile sensor", "surface"
GRASPING, ARM = "grasp and lift", "arm"
"""Groups of options, in this order in the help; others are listed before all groups."""

# A mass [kg] or a friction beyond this is damage.
_LARGEST = 1e9

_Config = TypeVar("_Config", bound=type)


@dataclass(frozen=True, slots=True)
class Option:
    """What the command line, the documentation and the checks need of one field."""

    help: str  #: what it means
    group: str = ""  #: title in the help of a verb; empty for none
    metavar: str | tuple[str, ...] = ""  #: name of its value in the help, or of each of three
    choices: tuple[str, ...] = ()  #: the permitted values; empty for any
    words: str = ""  #: the default in words, of verbs that explore; empty for the value itself
    words_else: str = ""  #: the same of verbs that read a file; empty for `words`
    check: Callable[[str, Any], Any] = lambda name, value: value  #: returns the value to keep
    registry: Registry | None = None  #: names that it may have, plug-ins too
    meanings: Mapping[str, str] = field(default_factory=dict)  #: the package's own names in words


def options() -> dict[str, Option]:
    """Return the declaration of every field of `RunConfig` by its name."""
    return {item.name: item.metadata["option"] for item in fields(RunConfig)}


def _option(default: Any, help: str, group: str = "", **declaration: Any) -> Any:
    return field(default=default, metadata={"option": Option(help, group, **declaration)})


def _at_least(least: float) -> Callable[[str, Any], Any]:
    def check(name: str, value: Any) -> Any:
        require_at_least(least, **{name: value})
        return value

    return check


def _positive(name: str, value: float) -> float:
    if not 0 < value <= _LARGEST:
        raise InvalidOptionError.out_of_range(name, value, "positive")
    return value


def _probability(name: str, value: float) -> float:
    if not 0 < value < 1:
        raise InvalidOptionError.out_of_range(name, value, "above 0 and below 1")
    return value


def _place(name: str, value: Any) -> tuple[float, ...]:
    place = tuple(float(x) for x in value)
    if len(place) != 3 or not np.isfinite(place).all():
        raise InvalidOptionError.out_of_range(name, value, "3 finite numbers")
    return place


def _named(find: Callable[[str], object]) -> Callable[[str, str], str]:
    def check(name: str, value: str) -> str:
        find(value)
        return value

    return check


def _of_sensor(name: str, help: str, metavar: str, words_else: str = "") -> Any:
    words = f"{REAL_SENSOR[name]:.3g}; 0 with --known or --ideal"
    declared = {"metavar": metavar, "words": words, "words_else": words_else}
    return _option(0.0, help, SENSOR, check=_at_least(0), **declared)


def _documented(config: _Config) -> _Config:
    """Add the options to the docstring of a configuration."""
    lines = [f"    {item.name}\n        {item.metadata['option'].help}." for item in fields(config)]
    config.__doc__ = f"{config.__doc__}\n    Parameters\n    ----------\n" + "\n".join(lines) + "\n"
    return config


@dataclass(frozen=True, slots=True)
class StopLimits:
    """Limits that end an exploration early; None for none of a kind.

    Examples
    --------
    >>> pipeline.StopLimits(coverage=0.9).seconds is None
    True
    """

    success: float | None = None  #: probability of a grasp's success, as far as the surface decides
    coverage: float | None = None  #: fraction of the estimate within a step of a contact
    uncertainty: float | None = None  #: standard deviation of nearly all of the estimate [m]
    seconds: float | None = None  #: time of the robot [s]

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


@_documented
@dataclass(frozen=True, slots=True)
class RunConfig:
    """Configuration of a run.

    The defaults are those of the command line with `--known`; `lis_grasp.pipeline.conditions` has
    those without it. None stands for the default in words, or for nothing of the kind. A value out
    of range, and two values that contradict each other, raise `InvalidOptionError`.

    Examples
    --------
    >>> RunConfig(object="mallet", hand="wsg50").touches
    40
    """

    object: str = _option(
        "box", f"built-in shape ({', '.join(NAMES)}) or mesh file (OBJ, STL, PLY, glTF, OFF)"
    )
    size: float | None = _option(
        None,
        "largest extent of a built-in shape; 0.20 is the paper's",
        metavar="METRES",
        words="graspable",
    )
    units: str = _option("m", "length unit of a mesh file", choices=tuple(UNITS))
    hand: str = _option(
        "allegro",
        "a hand's YAML file, or a name: allegro, wsg50, barrett; of vendors' hands allegro_right,"
        " robotiq_2f85, panda_hand and more",
        TOUCHING,
        metavar="HAND",
    )
    estimator: str = _option(
        "blend",
        "surface estimator",
        SURFACE,
        metavar="NAME",
        check=_named(find_estimator),
        registry=ESTIMATOR_NAMES,
        meanings=ESTIMATOR_MEANINGS,
    )
    prober: str = _option(
        "dynamic",
        "touch in Drake's dynamics, or by geometry alone, which is faster",
        TOUCHING,
        choices=PROBERS,
    )
    fingers: str = _option(
        "one",
        "fingers that touch in one approach; all needs --prober kinematic",
        TOUCHING,
        choices=FINGERS,
    )
    pose: str | None = _option(
        None,
        "the object is on a table: upright (as its mesh) or stable (in any stable pose), at a"
        " random place in the region; or a text file with its pose, four rows of four numbers [m]",
        metavar="POSE",
    )
    region: tuple[float, ...] | None = _option(
        None,
        "lengths [m] of the box on the table that contains the object: position and size of the"
        " object are then unknown",
        metavar=("X", "Y", "Z"),
        check=lambda name, value: Region(value).lengths,
    )
    free: bool = _option(
        False, "the object is free on a table and may be pushed; needs --prober dynamic"
    )
    policy: str = _option(
        "spread",
        "choice of the next touch",
        TOUCHING,
        metavar="NAME",
        check=_named(POLICY_NAMES.find),
        registry=POLICY_NAMES,
        meanings=POLICY_MEANINGS,
    )
    until_success: float | None = _option(
        None,
        "stop when the surface allows a grasp that holds with this probability, such as 0.95",
        TOUCHING,
        metavar="PROBABILITY",
        check=_probability,
    )
    until_coverage: float | None = _option(
        None,
        "stop when this fraction of the estimate is within a step of a contact",
        TOUCHING,
        metavar="FRACTION",
    )
    until_uncertainty: float | None = _option(
        None,
        "stop when nearly all of the estimate has at most this standard deviation",
        TOUCHING,
        metavar="METRES",
    )
    max_seconds: float | None = _option(
        None, "stop after this time of the robot", TOUCHING, metavar="S"
    )
    position_noise: float = _of_sensor(
        "position_noise",
        "standard deviation of the positions of contacts that do not carry their own",
        "METRES",
        "estimated from the contacts",
    )
    normal_noise: float = _of_sensor(
        "normal_noise",
        "standard deviation of the normals of contacts that do not carry their own",
        "RADIANS",
        "estimated from the contacts",
    )
    force_threshold: float = _of_sensor(
        "force_threshold", "smallest force that the sensor detects", "N"
    )
    taxel_pitch: float = _of_sensor("taxel_pitch", "distance of the sensor's taxels", "METRES")
    free_space: bool = _option(
        True,
        "remove the space that the hand passed through from the estimate",
        SURFACE,
        words="yes",
    )
    cloud: str | None = _option(
        None,
        "contacts known before the first touch, in the object's frame: a point cloud with normals,"
        " .ply or .csv; touches go where it lacks the surface",
        TOUCHING,
        metavar="FILE",
    )
    touches: int = _option(40, "contacts to make", TOUCHING, metavar="N", check=_at_least(1))
    seed: int = _option(0, "random seed", metavar="N", check=_at_least(0))
    mass: float | None = _option(
        None,
        "mass of the object",
        GRASPING,
        metavar="KG",
        words="of YCB scans their own, else at most 0.2",
        words_else="at most 0.2",
        check=_positive,
    )
    friction: float = _option(
        0.8, "Coulomb friction between hand and object", GRASPING, metavar="MU", check=_positive
    )
    load: str = _option(
        "known",
        "prior knowledge of the object's mass and friction in planning: their values, or their"
        " distributions",
        choices=LOADS,
        words="unknown; known with --known",
        words_else="known",
    )
    grasps: int = _option(10, "ranked grasps to plan", GRASPING, metavar="N", check=_at_least(1))
    obstacles: str | None = _option(
        None,
        "mesh file [m] of what hand and arm must not hit on the approach and in the lift, such as a"
        " shelf or a bin, in the frame of the grasps; it may be open, and it is not simulated",
        GRASPING,
        metavar="FILE",
    )
    attempts: int = _option(
        3,
        "grasps to try at most; another is planned after a failed tactile check",
        GRASPING,
        metavar="N",
        check=_at_least(1),
    )
    simulator: str = _option(
        "drake",
        "simulator of the lift; mujoco needs the extra mujoco",
        GRASPING,
        choices=SIMULATORS,
    )
    arm: str | None = _option(
        None,
        "an arm that carries the hand: a name, such as iiwa14, or an arm's YAML file",
        ARM,
        metavar="ARM",
        words="none, the hand moves freely",
    )
    base: tuple[float, ...] | None = _option(
        None,
        "place of the arm's base [m]: x and y on the table, height above it; it faces along +x",
        ARM,
        metavar=("X", "Y", "Z"),
        words="chosen for its reach",
        check=_place,
    )

    def __post_init__(self) -> None:
        for name, option in options().items():
            value = getattr(self, name)
            if option.choices and value not in option.choices:
                raise InvalidOptionError.not_one_of(name, value, option.choices)
            if value is not None:
                object.__setattr__(self, name, option.check(name, value))
        for name, message in self._contradictions():
            raise InvalidOptionError(message, option=name)
        self.stop_limits().rules(Workspace(1.0, np.zeros(3), 1.0))  # checks the limits

    def _contradictions(self) -> Iterator[tuple[str, str]]:
        if self.free and self.prober != "dynamic":
            yield "free", f"a free object needs the dynamic prober; it is {self.prober}"
        if self.fingers != "one" and self.prober != "kinematic":
            needs = f"need the kinematic prober; it is {self.prober}"
            yield "fingers", f"fingers '{self.fingers}' {needs}"
        if self.region is not None and self.pose is None:
            required = "a pose there, such as 'stable'; there is none"
            yield "pose", f"an object in a region needs {required}"
        if self.arm is not None and self.simulator != "drake":
            yield "arm", f"an arm is simulated in drake; the simulator is {self.simulator}"
        if self.base is not None and self.arm is None:
            yield "base", "a base needs an arm: name it with --arm"

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

    def stop_limits(self) -> StopLimits:
        """Return the limits that end an exploration early."""
        return StopLimits(
            self.until_success, self.until_coverage, self.until_uncertainty, self.max_seconds
        )

    def facts(self) -> dict[str, Any]:
        """Return the configuration as plain values, for file headers and reports."""
        return {n: list(v) if isinstance(v, tuple) else v for n, v in asdict(self).items()}
