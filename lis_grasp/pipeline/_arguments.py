"""Objects, hands and seeds as a user gives them, and their names in a task."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidOptionError, shown
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import HAND_REGISTRY
from lis_grasp.shapes import Shape
from lis_grasp.stages.scenario import find_object
from lis_grasp.surfaces import ImplicitSurface
from lis_grasp.task.task import Task
from lis_grasp.task.world import World
from lis_grasp.typing import Seed

AnyObject: TypeAlias = str | Path | Shape | trimesh.Trimesh
"""An object: the name of a built-in shape, the path of a mesh file, a `Shape`, or a mesh [m]."""


AnyHand: TypeAlias = str | Path | Hand
"""A hand: the name of a shipped one, the path of its YAML file, or a `Hand`."""


USUAL_HAND = Task().robot.hand

_OF_FILES = {"units": "mesh files", "up": "mesh files", "size": "built-in shapes"}


def object_name(object_: AnyObject) -> str:
    """Return the name of an object that a task records."""
    if isinstance(object_, (str, Path)):
        return str(object_)
    if isinstance(object_, (Shape, trimesh.Trimesh)):
        return getattr(object_, "name", "") or "mesh"
    cure = ""
    if isinstance(object_, Contacts):
        cure = ": write extract_mesh(estimate(contacts))"
    elif isinstance(object_, ImplicitSurface):
        cure = ": write extract_mesh(surface)"
    raise TypeError(
        "an object is a name, a path, a Shape or a trimesh.Trimesh; this is of type"
        f" {type(object_).__name__}{cure}"
    )


def require_options_of_files(object_: AnyObject, options: Mapping[str, Any]) -> None:
    """Raise `InvalidOptionError` for an option of files or names, given for an object in memory."""
    if isinstance(object_, (str, Path)):
        return
    for name, use in _OF_FILES.items():
        if options.get(name) is not None:
            raise InvalidOptionError(
                f"{name} is for {use}, and this object is in memory: leave it out, and scale or"
                " turn the mesh",
                option=name,
                value=options[name],
            )


def shape_of(object_: AnyObject, world: World) -> Shape:
    if isinstance(object_, trimesh.Trimesh):
        return Shape.from_mesh(object_)
    return object_ if isinstance(object_, Shape) else find_object(world)


def hand_name(hand: AnyHand) -> str:
    """Return the name of a hand if it has one that finds it, else the default's."""
    if isinstance(hand, (str, Path)):
        return str(hand)
    if not isinstance(hand, Hand):
        raise TypeError(
            f"a hand is a name, the path of a YAML file or a Hand; this is of type"
            f" {type(hand).__name__}"
        )
    return hand.name if hand.name in HAND_REGISTRY.names else USUAL_HAND


def loaded_hand(hand: AnyHand) -> Hand | None:
    return hand if isinstance(hand, Hand) else None


def seed_of(rng: Seed, options: dict[str, Any]) -> int:
    """Return the seed of random draws, which may also be an option."""
    if not isinstance(rng, (int, np.integer, np.random.Generator)):
        raise TypeError(f"rng must be a seed or a numpy.random.Generator; it is {shown(rng)}")
    if "seed" not in options:
        return int(rng.integers(2**31)) if isinstance(rng, np.random.Generator) else int(rng)
    if rng != 0:
        raise TypeError("give either rng or seed; both are given")
    return options["seed"]  # type: ignore[no-any-return]


def require_one_load(options: Mapping[str, Any]) -> None:
    """Raise `InvalidOptionError` for a load that is both unknown and given."""
    if options.get("load") == "unknown" and (given := {"friction", "mass"} & {*options}):
        raise InvalidOptionError(
            f"load='unknown' plans for any load: leave out {' and '.join(sorted(given))}",
            option="load",
        )
