"""Run configuration: every option of a user, declared once with its default and its check."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import trimesh

from lis_grasp.contacts import FARTHEST
from lis_grasp.exceptions import InvalidOptionError, nearest_or_all
from lis_grasp.exploration import Region, TactileSensor
from lis_grasp.exploration.policy import POLICY_NAMES
from lis_grasp.io.option import (
    FRACTION,
    NOT_LARGE,
    POSITIVE,
    PROBABILITY,
    at_least,
    check_options,
    documented,
    named,
    option,
    options_of,
    place,
    within,
)
from lis_grasp.io.yaml_files import YAML_SUFFIXES
from lis_grasp.records import Answering
from lis_grasp.robots.shipped_models import arm_path, hand_path
from lis_grasp.shapes import NAMES, UNITS, default_mass
from lis_grasp.shapes.loading import UP_AXES
from lis_grasp.shapes.object_mass import MOST_FRICTION, USUAL_FRICTION
from lis_grasp.surfaces.estimators import ESTIMATOR_NAMES, find_estimator
from lis_grasp.task.conditions import REAL_SENSOR

FRICTION = within(f"above 0 and at most {MOST_FRICTION:g}", lambda x: 0 < x <= MOST_FRICTION)
HEIGHT = within(f"at most {FARTHEST:g} m from 0", lambda value: abs(value) <= FARTHEST)

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
        "blend": "smooth patches that meet in edges, or smooth where that predicts as well",
        "smooth": "Gaussian processes for shapes without edges",
        "gpis": "a Gaussian process, which rounds edges",
        "patch": "the patches alone",
        "lis": "the paper's tangent planes",
    }
)
"""The package's estimators in words."""

POLICY_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "spread": "farthest from all contacts",
        "frontier": "next to the contacts, as in the paper",
        "uncertainty": "where the estimate is most uncertain",
        "random": "anywhere on the estimate",
    }
)
"""The package's policies in words."""

TOUCHING, SENSOR, SURFACE = "touching", "tactile sensor", "surface"
GRASPING, ARM = "grasp and lift", "arm"
"""Groups of options, in this order in the help; others are listed before all groups."""

LIFTING = ("grasps", "attempts", "closings", "simulator")
"""Options of a run on which its exploration does not depend."""


def _noise(help: str, name: str, metavar: str, words_else: str = "") -> Any:
    words = f"{REAL_SENSOR[name]:.3g}; 0 with --known or --ideal"
    declared = {"metavar": metavar, "words": words, "words_else": words_else}
    check = NOT_LARGE if metavar == "METRES" else at_least(0)
    return option(0.0, help, SENSOR, check=check, **declared)


def _find_model(find: Callable[[str], object]) -> Callable[[str], object]:
    """Return a function that finds names alone: a recorded file may be elsewhere now."""

    def find_name(name: str) -> object:
        return None if Path(name).suffix.lower() in YAML_SUFFIXES else find(name)

    return find_name


@documented
@dataclass(frozen=True, slots=True)
class RunConfig(metaclass=Answering):
    """Configuration of a run.

    The defaults are those of the command line with `--known`; `lis_grasp.task.conditions` has
    those without it. None stands for the default in words, or for nothing of the kind. A value out
    of range, and two values that contradict each other, raise `InvalidOptionError`.

    Examples
    --------
    >>> RunConfig(object="mallet", hand="wsg50").touches
    40
    """

    object: str = option(
        "box",
        f"built-in shape ({', '.join(NAMES)}) or mesh file (STL, OBJ, PLY, 3MF, glTF, OFF, DAE)",
    )
    size: float | None = option(
        None,
        "largest extent of a built-in shape; 0.20 is the paper's",
        metavar="METRES",
        words="graspable",
        check=POSITIVE,
    )
    units: str | None = option(
        None, "length unit of a mesh file", choices=tuple(UNITS), words="what it states, else m"
    )
    up: str | None = option(
        None, "axis of a mesh file that points up", choices=UP_AXES, words="what it states, else z"
    )
    hand: str = option(
        "allegro",
        "a hand's YAML file, or a name: allegro, wsg50, barrett; of vendors' hands allegro_right,"
        " robotiq_2f85, panda_hand and more",
        TOUCHING,
        metavar="HAND",
        check=named(_find_model(hand_path)),
    )
    estimator: str = option(
        "blend",
        "surface estimator",
        SURFACE,
        metavar="NAME",
        check=named(find_estimator),
        registry=ESTIMATOR_NAMES,
        meanings=ESTIMATOR_MEANINGS,
    )
    prober: str = option(
        "dynamic",
        "touch in Drake's dynamics, or by geometry alone, which is faster",
        TOUCHING,
        choices=PROBERS,
    )
    fingers: str = option(
        "one",
        "fingers that touch in one approach; all needs `prober` kinematic",
        TOUCHING,
        choices=FINGERS,
    )
    pose: str | None = option(
        None,
        "the object is on a table: upright (as its mesh) or stable (in any stable pose), at a"
        " random place in the region; or a text file with its pose, four rows of four numbers [m]",
        metavar="POSE",
    )
    region: tuple[float, ...] | None = option(
        None,
        "lengths [m] of the box on the table that contains the object: position and size of the"
        " object are then unknown",
        metavar=("X", "Y", "Z"),
        check=lambda name, value: Region(value).lengths,
    )
    free: bool = option(
        False, "the object is free on a table and may be pushed; needs `prober` dynamic"
    )
    policy: str = option(
        "spread",
        "choice of the next touch",
        TOUCHING,
        metavar="NAME",
        check=named(POLICY_NAMES.find),
        registry=POLICY_NAMES,
        meanings=POLICY_MEANINGS,
    )
    until_success: float | None = option(
        None,
        "stop when the surface allows a grasp that holds with this probability, such as 0.95",
        TOUCHING,
        metavar="PROBABILITY",
        check=PROBABILITY,
    )
    until_coverage: float | None = option(
        None,
        "stop when this fraction of the estimate is within a step of a contact",
        TOUCHING,
        metavar="FRACTION",
        check=FRACTION,
    )
    until_uncertainty: float | None = option(
        None,
        "stop when nearly all of the estimate has at most this standard deviation",
        TOUCHING,
        metavar="METRES",
        check=POSITIVE,
    )
    slide: float = option(
        0.0,
        "slide so far along a fixed object after a touch, for a second contact",
        TOUCHING,
        metavar="METRES",
        check=NOT_LARGE,
    )
    max_seconds: float | None = option(
        None,
        "stop after this time of the robot, in a region only when its object's ends are found",
        TOUCHING,
        metavar="S",
        check=POSITIVE,
    )
    position_noise: float = _noise(
        "standard deviation of the positions of contacts that do not carry their own",
        "position_noise",
        "METRES",
        "estimated from the contacts",
    )
    normal_noise: float = _noise(
        "standard deviation of the normals of contacts that do not carry their own",
        "normal_noise",
        "RADIANS",
        "estimated from the contacts",
    )
    force_threshold: float = _noise(
        "smallest force that the sensor detects, with `prober` dynamic", "force_threshold", "N"
    )
    taxel_pitch: float = _noise("distance of the sensor's taxels", "taxel_pitch", "METRES")
    free_space: bool = option(
        True,
        "remove the space that the hand passed through from the estimate",
        SURFACE,
        words="yes",
    )
    keep_all: bool = option(
        False,
        "believe every contact: do not turn or leave out those that the others contradict",
        SURFACE,
    )
    cloud: str | None = option(
        None,
        "contacts known before the first touch, in the frame of the touches, the mesh's unless a"
        " `pose` file places it on the table: a point cloud with normals, of any format that"
        " estimate reads; touches go where it lacks the surface",
        TOUCHING,
        metavar="FILE",
    )
    touches: int = option(40, "touches to make", TOUCHING, metavar="N", check=at_least(1))
    seed: int = option(0, "random seed", metavar="N", check=at_least(0))
    mass: float | None = option(
        None,
        "mass of the object",
        GRASPING,
        metavar="KG",
        words="of YCB scans their own, else at most 0.2",
        words_else="at most 0.2",
        check=POSITIVE,
    )
    friction: float = option(
        USUAL_FRICTION,
        "Coulomb friction between hand and object",
        GRASPING,
        metavar="MU",
        check=FRICTION,
    )
    load: str = option(
        "known",
        "prior knowledge of the object's mass and friction in planning: their values, or their"
        " distributions",
        choices=LOADS,
        words="unknown; known with --known",
        words_else="known",
    )
    grasps: int = option(
        10, "ranked grasps to plan, 20 after one failed", GRASPING, metavar="N", check=at_least(1)
    )
    obstacles: str | None = option(
        None,
        "mesh file [m] of what hand and arm must not hit on the approach and in the lift, such as a"
        " shelf or a bin, in the frame of contacts and grasps; it may be open, and is not"
        " simulated",
        GRASPING,
        metavar="FILE",
    )
    attempts: int = option(
        3,
        "grasps to lift at most; another is planned after each that fails",
        GRASPING,
        metavar="N",
        check=at_least(1),
    )
    closings: int = option(
        5,
        "grasps to test at most before each lift: the hand closes gently, and lifts if the measured"
        " contacts are in firm force closure; 0 lifts the first",
        GRASPING,
        metavar="N",
        check=at_least(0),
    )
    simulator: str = option(
        "drake",
        "simulator of the lift; mujoco needs the extra mujoco",
        GRASPING,
        choices=SIMULATORS,
    )
    arm: str | None = option(
        None,
        "an arm that carries the hand: a name, such as iiwa14, or an arm's YAML file",
        ARM,
        metavar="ARM",
        words="none, the hand moves freely",
        check=named(_find_model(arm_path)),
    )
    base: tuple[float, ...] | None = option(
        None,
        "place of the arm's base [m]: x and y on the table, height above it; it faces along +x",
        ARM,
        metavar=("X", "Y", "Z"),
        words="chosen for its reach",
        check=place,
    )

    def __post_init__(self) -> None:
        check_options(self)
        for name, message in self._contradictions():
            raise InvalidOptionError(message, option=name)

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
            yield "base", "a base needs an `arm`"

    @classmethod
    def from_facts(
        cls, given: Mapping[str, Any], recorded: Mapping[str, Any] = MappingProxyType({})
    ) -> RunConfig:
        """Return a configuration of values by name: given ones, else recorded, else the defaults.

        None and other names count as absent. A recorded estimator, policy or hand that is not among
        the given names is left out: it is not used, and perhaps not installed. Another object than
        the recorded one has another size and units.
        """
        left_out = {name for name in ("estimator", "policy", "hand") if name not in given}
        if given.get("object") not in (None, recorded.get("object")):
            left_out |= {"size", "units", "up"}
        facts = cls().facts()
        for values in ({k: v for k, v in recorded.items() if k not in left_out}, given):
            facts |= {name: values[name] for name in facts if values.get(name) is not None}
        return cls(**facts)

    @property
    def may_slide(self) -> bool:
        """Whether a fingertip may slide: on a fixed object, alone, and without an arm."""
        return not self.free and self.arm is None and self.fingers == "one"

    def require_slides(self) -> None:
        """Raise `InvalidOptionError` if touches are to slide and may not."""
        if self.slide and not self.may_slide:
            needed = "a fixed object (not `free`: --clamped or --known), one finger and no arm"
            raise InvalidOptionError(f"slide needs {needed}", option="slide", value=self.slide)

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
        return {n: list(v) if isinstance(v, tuple) else v for n, v in asdict(self).items()}


# What other libraries and the command line call options.
_GUESSES = {
    **dict.fromkeys(("directory", "output", "save_dir"), "folder"),
    **dict.fromkeys(("count", "n", "num"), "grasps"),
    "mu": "friction",
    "noise": "position_noise",
    "rng": "seed",
    "table": "support_height",
}


def require_used(stage: Callable[..., Any], given: Iterable[str], used: Sequence[str]) -> None:
    """Raise `TypeError` for the first given option that a function does not use.

    It uses its own keywords and the fields `used` of a configuration.
    """
    accepted = (*used, *(stage.__kwdefaults__ or ()))
    for name in given:
        if name in accepted:
            continue
        if name in options_of(RunConfig):
            listed = ", ".join(accepted)
            raise TypeError(f"{stage.__name__} does not use the option '{name}', but {listed}")
        meant = _GUESSES.get(name)
        nearest = nearest_or_all(meant if meant in accepted else name, accepted)
        raise TypeError(f"{stage.__name__} has no option '{name}'{nearest}")
