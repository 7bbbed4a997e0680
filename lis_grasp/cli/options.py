"""Command line options that mean the same for every verb."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.pipeline.conditions import IDEAL_SENSOR, KNOWN, REAL_SENSOR, UNKNOWN
from lis_grasp.pipeline.plugged_in import ESTIMATOR_NAMES, POLICY_NAMES
from lis_grasp.pipeline.run_config import FINGERS, LOADS, PROBERS, SIMULATORS, RunConfig
from lis_grasp.plugins import Registry
from lis_grasp.shapes import NAMES, STABLE, UNITS

TOUCH = (
    *("hand", "estimator", "prober", "fingers", "mass", "friction", "policy"),
    *("until_success", "until_coverage", "until_uncertainty", "max_seconds"),
    *("position_noise", "normal_noise", "force_threshold", "taxel_pitch"),
    *("cloud", "touches", "seed", "arm", "base"),
)
"""Options of an exploration, beside its object."""

_DEFAULTS = RunConfig()

_OBJECT = f"built-in shape ({', '.join(NAMES)}) or mesh file (OBJ, STL, PLY, glTF, OFF)"


def _number(metavar: str, text: str, *, kind: type = float) -> dict[str, Any]:
    return {"type": kind, "metavar": metavar, "help": text}


_ESTIMATOR_HELP = {
    "blend": "smooth patches that meet in edges, or gpis where that predicts as well",
    "gpis": "a Gaussian process, which rounds edges",
    "patch": "the patches alone",
    "lis": "the paper's tangent planes",
}
_POLICY_HELP = {
    "spread": "farthest from all contacts",
    "swift": "the same, with little motion",
    "frontier": "next to the contacts, as in the paper",
    "uncertainty": "where the estimate is most uncertain",
    "random": "anywhere on the estimate",
}


def _names(meanings: Mapping[str, str], registry: Registry) -> str:
    """Return the names of a registry with their meanings, and how to plug in one of your own."""
    own = [f"{name} ({meaning})" for name, meaning in meanings.items()]
    return ", ".join([*own, *registry.names[len(registry.builtin) :], "or my.module:Class"])


# Options named as fields of RunConfig; the help gets the default of the field where it has one.
_OPTIONS: dict[str, dict[str, Any]] = {
    "size": _number("METRES", "largest extent of a built-in shape; 0.20 is the paper's"),
    "units": {"choices": list(UNITS), "help": "length unit of a mesh file"},
    "hand": {
        "metavar": "HAND",
        "help": "a hand's YAML file, or a name: allegro, wsg50, barrett; of vendors' hands"
        " allegro_right, robotiq_2f85, panda_hand and more",
    },
    "estimator": {
        "metavar": "NAME",
        "help": f"surface estimator: {_names(_ESTIMATOR_HELP, ESTIMATOR_NAMES)}",
    },
    "prober": {
        "choices": PROBERS,
        "help": "touch in Drake's dynamics, or by geometry alone, which is faster",
    },
    "fingers": {
        "choices": FINGERS,
        "help": "fingers that touch in one approach; all needs --prober kinematic",
    },
    "free": {
        "action": "store_true",
        "help": "the object is free on a table and may be pushed; needs --prober dynamic",
    },
    "pose": {
        "metavar": "POSE",
        "help": "the object is on a table: upright (as its mesh) or stable (in any stable"
        " pose), at a random place in the region; or a text file with its pose, four rows of four"
        " numbers [m]",
    },
    "region": {
        "type": float,
        "nargs": 3,
        "metavar": ("X", "Y", "Z"),
        "help": "lengths [m] of the box on the table that contains the object: position and size of"
        " the object are then unknown",
    },
    "policy": {
        "metavar": "NAME",
        "help": f"choice of the next touch: {_names(_POLICY_HELP, POLICY_NAMES)}",
    },
    "until_success": _number(
        "PROBABILITY",
        "stop when the surface allows a grasp that holds with this probability, such as 0.95",
    ),
    "until_coverage": _number(
        "FRACTION", "stop when this fraction of the estimate is within a step of a contact"
    ),
    "until_uncertainty": _number(
        "METRES", "stop when nearly all of the estimate has at most this standard deviation"
    ),
    "max_seconds": _number("S", "stop after this time of the robot"),
    "free_space": {
        "action": argparse.BooleanOptionalAction,
        "help": "remove the space that the hand passed through from the estimate",
    },
    "position_noise": _number(
        "METRES", "standard deviation of the positions of contacts that do not carry their own"
    ),
    "normal_noise": _number(
        "RADIANS", "standard deviation of the normals of contacts that do not carry their own"
    ),
    "force_threshold": _number("N", "smallest force that the sensor detects"),
    "taxel_pitch": _number("METRES", "distance of the sensor's taxels"),
    "cloud": {
        "metavar": "FILE",
        "help": "contacts known before the first touch, in the object's frame: a point cloud with"
        " normals, .ply or .csv; touches go where it lacks the surface",
    },
    "touches": _number("N", "contacts to make", kind=int),
    "grasps": _number("N", "ranked grasps to plan", kind=int),
    "attempts": _number(
        "N", "grasps to try at most; another is planned after a failed tactile check", kind=int
    ),
    "mass": _number("KG", "mass of the object"),
    "friction": _number("MU", "Coulomb friction between hand and object"),
    "load": {
        "choices": LOADS,
        "help": "prior knowledge of the object's mass and friction in planning: their values, or"
        " their distributions",
    },
    "simulator": {
        "choices": SIMULATORS,
        "help": "simulator of the lift; mujoco needs the extra mujoco",
    },
    "arm": {
        "metavar": "ARM",
        "help": "an arm that carries the hand: a name, such as iiwa14, or an arm's YAML file",
    },
    "base": {
        "type": float,
        "nargs": 3,
        "metavar": ("X", "Y", "Z"),
        "help": "place of the arm's base [m]: x and y on the table, height above it; it faces along"
        " +x",
    },
    "seed": _number("N", "random seed", kind=int),
}

# Defaults in words, where a field's own does not say it; of verbs that explore, and of others.
_IN_WORDS = {
    "size": "graspable",
    "free_space": "yes",
    "mass": "of YCB scans their own, else at most 0.2",
    "load": "unknown; known with --known",
    "arm": "none, the hand moves freely",
    "base": "chosen for its reach",
    **{name: f"{value:.3g}; 0 with --known or --ideal" for name, value in REAL_SENSOR.items()},
}
_IN_WORDS_ELSE = {
    **_IN_WORDS,
    "mass": "at most 0.2",
    "load": "known",
    **dict.fromkeys(("position_noise", "normal_noise"), "estimated from the contacts"),
}


# Titles in the help, and the options below them; others are listed before all titles.
_GROUPS = {
    "touching": (
        *("hand", "prober", "fingers", "policy", "touches", "cloud"),
        *("until_success", "until_coverage", "until_uncertainty", "max_seconds"),
    ),
    "tactile sensor": tuple(REAL_SENSOR),
    "surface": ("estimator", "free_space"),
    "grasp and lift": ("mass", "friction", "grasps", "attempts", "simulator"),
    "arm": ("arm", "base"),
}


def add_options(
    parser: argparse._ActionsContainer,
    *names: str,
    show_default: bool = True,
    recorded: bool = False,
) -> None:
    """Add options by the names of their fields in `RunConfig`; omitted ones parse as None.

    With `recorded` they are those of a verb that reads a file with recorded facts.
    """
    groups = {title: [n for n in members if n in names] for title, members in _GROUPS.items()}
    defaults = _defaults(recorded) if show_default else {}
    if sum(map(bool, groups.values())) > 1:
        for title, members in groups.items():
            if members:
                _add_to(parser.add_argument_group(title), members, defaults)
        names = tuple(name for name in names if not any(name in g for g in groups.values()))
    _add_to(parser, names, defaults)


def _defaults(recorded: bool) -> dict[str, str]:
    """Return the defaults of options in words, where there is one."""
    values = _DEFAULTS.facts().items()
    own = {name: f"{value}" for name, value in values if value is not None and value is not False}
    if not recorded:
        return own | _IN_WORDS
    return {name: f"as recorded, else {text}" for name, text in (own | _IN_WORDS_ELSE).items()}


def _add_to(
    group: argparse._ActionsContainer, names: Iterable[str], defaults: Mapping[str, str]
) -> None:
    for name in names:
        option = dict(_OPTIONS[name])
        if name in defaults:
            option["help"] += f" (default: {defaults[name]})"
        group.add_argument(f"--{name.replace('_', '-')}", default=None, **option)


def add_conditions(parser: argparse.ArgumentParser) -> None:
    """Add the options of what is known of the object, its pose, and the sensor."""
    conditions = parser.add_argument_group("conditions")
    given = conditions.add_mutually_exclusive_group()
    given.add_argument(
        "--unknown",
        action="store_true",
        default=None,
        help="nothing is known but the region, not even mass and friction: the object is free"
        " on a table in a stable pose (fixed with --prober kinematic), and the sensor is realistic:"
        " 0.5 mm, 3 deg, 0.05 N, taxels 2 mm apart (default, unless there is a --cloud)",
    )
    given.add_argument(
        "--known",
        dest="unknown",
        action="store_false",
        default=None,
        help="place, size, mass and friction of the object are known, it is fixed in the air at"
        " the pose of its mesh, and the sensor is ideal; the options below change each of these",
    )
    add_options(conditions, "pose", "region", "free", "load")
    conditions.add_argument(
        "--clamped", action="store_true", help="the object is fixed, as with --prober kinematic"
    )
    conditions.add_argument("--ideal", action="store_true", help="the sensor has no noise")


def configure_touch(options: argparse.Namespace) -> RunConfig:
    """Return the configuration of a run or an exploration, with the conditions of its options.

    Raises
    ------
    InvalidOptionError
        If two options contradict each other, or a value is out of range.
    """
    if options.clamped and options.free:
        raise InvalidOptionError("give either --clamped or --free; both are given", option="free")
    unknown = options.cloud is None if options.unknown is None else options.unknown
    conditions = dict(UNKNOWN if unknown else KNOWN)
    prober = options.prober or _DEFAULTS.prober
    if options.clamped or prober != "dynamic":  # geometry alone cannot move the object
        conditions["free"] = False
    if options.ideal:
        conditions |= IDEAL_SENSOR
    if options.region is not None:
        conditions["pose"] = conditions["pose"] or STABLE
    return RunConfig.from_facts(vars(options), conditions)


def add_object(parser: argparse.ArgumentParser, *, required_name: bool = True) -> None:
    """Add the object to touch or lift, with its size and units."""
    if required_name:
        parser.add_argument("object", metavar="OBJECT", help=_OBJECT)
    else:
        parser.add_argument("--object", metavar="OBJECT", help=f"{_OBJECT} (default: as recorded)")
    add_options(parser, "size", "units")


def add_estimator(parser: argparse.ArgumentParser) -> None:
    """Add an estimator beside those that a study compares; it may be repeated."""
    parser.add_argument(
        "--estimator",
        action="append",
        metavar="NAME",
        help="an estimator to add to those compared, such as your own as my.module:Class; may be"
        " repeated",
    )


def add_output(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the folder of results."""
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help=f"folder of results (default: {default})"
    )


def add_fresh(parser: argparse.ArgumentParser) -> None:
    """Add the option to explore from the beginning."""
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="explore from the beginning (default: an interrupted exploration is resumed, and a"
        " finished one is used again, if nothing that it depends on has changed)",
    )


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes."""
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="processes (default: the machine's cores)"
    )
