"""Options that mean the same for every verb."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from lis_grasp.exploration import POLICIES
from lis_grasp.pipeline.run_config import FINGERS, PROBERS, RunConfig
from lis_grasp.shapes import NAMES, UNITS, Shape, find
from lis_grasp.surfaces import ESTIMATORS

_DEFAULTS = RunConfig()


def add_object(parser: argparse.ArgumentParser, *, required_name: bool = True) -> None:
    """Add the object to touch or lift, with its size and units."""
    text = f"built-in shape ({', '.join(NAMES)}) or mesh file (OBJ, STL, PLY, glTF, OFF)"
    if required_name:
        parser.add_argument("object", metavar="OBJECT", help=text)
    else:
        parser.add_argument("--object", metavar="OBJECT", help=f"{text}; default: as recorded")
    parser.add_argument(
        "--size",
        type=float,
        metavar="METRES",
        help="largest extent of a built-in shape; 0.20 is the paper's (default: graspable)",
    )
    parser.add_argument(
        "--units", choices=list(UNITS), default=None, help="length unit of a mesh file (default: m)"
    )


def add_hand(parser: argparse.ArgumentParser) -> None:
    """Add the choice of hand."""
    parser.add_argument(
        "--hand",
        metavar="HAND",
        help=f"allegro, wsg50, barrett, or a hand's YAML file (default: {_DEFAULTS.hand})",
    )


def add_estimator(parser: argparse.ArgumentParser) -> None:
    """Add the choice of surface estimator."""
    parser.add_argument(
        "--estimator",
        choices=list(ESTIMATORS),
        help=f"surface estimator (default: {_DEFAULTS.estimator})",
    )


def add_free_space(parser: argparse.ArgumentParser) -> None:
    """Add whether the estimate may reach into space that the hand passed through."""
    parser.add_argument(
        "--free-space",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="whether space that the hand passed through is carved off the estimate (default: it"
        " is)",
    )


def add_prober(parser: argparse.ArgumentParser) -> None:
    """Add the choice of what carries out touches."""
    parser.add_argument(
        "--prober",
        choices=PROBERS,
        help="touch in Drake's dynamics, or by geometry alone, some times faster (default:"
        f" {_DEFAULTS.prober})",
    )


def add_fingers(parser: argparse.ArgumentParser) -> None:
    """Add which fingers touch in one approach."""
    parser.add_argument(
        "--fingers",
        choices=FINGERS,
        help="whether the other fingers stretch out too once one has touched, with --prober"
        f" kinematic (default: {_DEFAULTS.fingers})",
    )


def add_free(parser: argparse.ArgumentParser) -> None:
    """Add the choice of an object that may move."""
    parser.add_argument(
        "--free",
        action="store_true",
        default=None,
        help="the object stands on a table and may be pushed (default: it is held)",
    )


def add_policy(parser: argparse.ArgumentParser) -> None:
    """Add what chooses the next touch, and when there are enough."""
    parser.add_argument(
        "--policy",
        choices=list(POLICIES),
        help=f"what chooses the next touch (default: {_DEFAULTS.policy})",
    )
    parser.add_argument(
        "--until-coverage",
        type=float,
        metavar="SHARE",
        help="stop when this share of the estimate is within a step of a contact",
    )
    parser.add_argument(
        "--until-uncertainty",
        type=float,
        metavar="METRES",
        help="stop when nearly all of the estimate is known to this standard deviation",
    )
    parser.add_argument(
        "--max-seconds", type=float, metavar="S", help="stop after this time of the robot"
    )


def add_noise(parser: argparse.ArgumentParser) -> None:
    """Add the noise of the tactile sensor, which estimators are told of."""
    parser.add_argument(
        "--position-noise",
        type=float,
        metavar="METRES",
        help="standard deviation of contacts' positions (default: none)",
    )
    parser.add_argument(
        "--normal-noise",
        type=float,
        metavar="RADIANS",
        help="standard deviation of contacts' normals (default: none)",
    )


def add_touches(parser: argparse.ArgumentParser) -> None:
    """Add the number of touches."""
    parser.add_argument(
        "--touches",
        type=int,
        metavar="N",
        help=f"contacts to make (default: {_DEFAULTS.touches})",
    )


def add_physics(parser: argparse.ArgumentParser) -> None:
    """Add what the lift assumes of the object."""
    parser.add_argument(
        "--mass", type=float, metavar="KG", help=f"mass of the object (default: {_DEFAULTS.mass})"
    )


def add_friction(parser: argparse.ArgumentParser) -> None:
    """Add the friction between hand and object."""
    parser.add_argument(
        "--friction",
        type=float,
        metavar="MU",
        help=f"Coulomb friction of hand on object (default: {_DEFAULTS.friction})",
    )


def add_grasps(parser: argparse.ArgumentParser) -> None:
    """Add the number of grasps to plan."""
    parser.add_argument(
        "--grasps",
        type=int,
        metavar="N",
        help=f"ranked grasps to plan (default: {_DEFAULTS.grasps})",
    )


def add_attempts(parser: argparse.ArgumentParser) -> None:
    """Add how often to try."""
    parser.add_argument(
        "--attempts",
        type=int,
        metavar="N",
        help="grasps to try at the most; where fingers feel that one would not hold, another is"
        f" planned (default: {_DEFAULTS.attempts})",
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the seed."""
    parser.add_argument(
        "--seed", type=int, metavar="N", help=f"random seed (default: {_DEFAULTS.seed})"
    )


def add_output(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the folder of results."""
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help=f"folder of results (default: {default})"
    )


def configure(options: argparse.Namespace, recorded: dict[str, Any] | None = None) -> RunConfig:
    """Return the configuration: what was asked, else what the input file records, else defaults."""
    facts = _DEFAULTS.facts()
    recorded = dict(recorded or {})
    if getattr(options, "object", None) not in (None, recorded.get("object")):
        # Another object than the recorded one: its size and units say nothing of this one.
        recorded.pop("size", None)
        recorded.pop("units", None)
    for name in facts:
        asked = getattr(options, name, None)
        known = recorded.get(name)
        facts[name] = asked if asked is not None else known if known is not None else facts[name]
    return RunConfig(**facts)


def load_object(config: RunConfig) -> Shape:
    """Return the true object of a configuration."""
    return find(config.object, size=config.size, units=config.units)


def default_output(config: RunConfig) -> Path:
    """Return the folder that a run writes to when none is named."""
    name = (
        f"{Path(config.object).stem}-{Path(config.hand).stem}-{config.estimator}-seed{config.seed}"
    )
    return Path("results") / name
