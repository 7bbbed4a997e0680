"""Stages from an object and a hand: `lis_grasp.explore`, `lis_grasp.plan` and `lis_grasp.lift`.

They make the records `Scenario` and `Known` of a configuration, and call the stages of
`lis_grasp.pipeline`, which take these records. Options are fields of `RunConfig`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import trimesh

from lis_grasp.exceptions import nearest_of
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.pipeline import lifting_stage, stages
from lis_grasp.pipeline.run_config import RunConfig
from lis_grasp.pipeline.scenario import Known, Scenario, find_object
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import Shape
from lis_grasp.typing import Seed

AnyObject: TypeAlias = str | Path | Shape | trimesh.Trimesh
"""An object: the name of a built-in shape, the path of a mesh file, a `Shape`, or a mesh [m]."""

AnyHand: TypeAlias = str | Path | Hand
"""A hand: the name of a shipped one, the path of its YAML file, or a `Hand`."""

_OPTIONS = tuple(field.name for field in fields(RunConfig))
_HAND = RunConfig().hand


def explore(
    object: AnyObject,
    hand: AnyHand = _HAND,
    *,
    rng: Seed = 0,
    **options: Any,
) -> Exploration:
    """Explore an object by touch in simulation, without files.

    The stage is `pipeline.touch`, which takes a `Scenario`; `pipeline.explore_object` writes
    files. `exploration.explore` is the loop itself, for a prober and a policy of one's own.

    Parameters
    ----------
    object
        The true object, which is touched where it is in its frame O.
    hand
        The hand.
    rng
        Seed, or a generator that draws it.
    options
        Fields of `RunConfig`, such as ``touches``; ``prober="kinematic"`` needs no simulator.

    Raises
    ------
    LisGraspError
        If an input cannot be used.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> exploration = explore("box", "wsg50", prober="kinematic", touches=3, estimator="gpis")
    >>> len(exploration.contacts)
    3
    """
    return stages.touch(_scenario(object, hand, _seeded(options, rng)))


def plan(
    mesh: AnyObject,
    hand: AnyHand = _HAND,
    *,
    support_height: float | None = None,
    rng: Seed = 0,
    **options: Any,
) -> GraspSearch:
    """Plan grasps of a hand on a mesh.

    The result is that of ``lis-grasp grasp``. The stage is `pipeline.plan`, which takes a `Known`.

    Parameters
    ----------
    mesh
        A closed mesh [m], true or estimated, or another object, in its frame O.
    hand
        The hand.
    support_height
        Height of the plane that the object is on in O [m]; None for its lowest point.
    rng
        Seed, or a generator that draws it.
    options
        Fields of `RunConfig`, such as ``friction``, ``mass``, ``grasps`` or ``load="unknown"``.

    Raises
    ------
    InvalidMeshError
        If the mesh is not closed.
    LisGraspError
        If another input cannot be used.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> search = plan("box", "wsg50", grasps=1)
    >>> search.best.hand, search.best.pose.shape
    ('wsg50', (4, 4))
    """
    config = configured(RunConfig(), _seeded(options, rng))
    if not isinstance(mesh, trimesh.Trimesh):  # of an estimate, the uncertainty must be kept
        config, shape = _find(mesh, config)
        mesh = shape.mesh
    support = float(mesh.bounds[0, 2]) if support_height is None else support_height
    return stages.plan(Known.for_mesh(config, _load(hand), mesh, support), mesh)


def lift(
    object: AnyObject,
    hand: AnyHand,
    grasp: Grasp,
    **options: Any,
) -> LiftOutcome:
    """Simulate the lift of an object with a grasp.

    The stage is `pipeline.lift`, which takes a `Scenario`.

    Parameters
    ----------
    object
        The true object, in the frame O of the grasp.
    hand
        The hand that the grasp was planned for.
    grasp
        The grasp, such as ``plan(mesh, hand).best``.
    options
        Fields of `RunConfig`, such as ``friction``, ``mass`` [kg] or ``simulator="mujoco"``.

    Raises
    ------
    LisGraspError
        If an input cannot be used, or the simulation fails.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> grasp = plan("box", "wsg50", grasps=1).best
    >>> lift("box", "wsg50", grasp, friction=0.9).held
    True
    """
    if not isinstance(grasp, Grasp):
        raise TypeError(
            f"grasp must be a Grasp, such as search.best; it is of type {type(grasp).__name__}"
        )
    return lifting_stage.lift(_scenario(object, hand, options), grasp)


def configured(config: RunConfig, options: Mapping[str, Any]) -> RunConfig:
    """Return a configuration with other values of some fields.

    Raises
    ------
    InvalidOptionError
        If a value is out of range.
    TypeError
        If there is no such field; the message names the nearest.
    """
    for name in options:
        if name not in _OPTIONS:
            raise TypeError(
                f"options are fields of RunConfig; '{name}' is none{nearest_of(name, _OPTIONS)}"
            )
    texts: dict[str, Any] = {n: str(v) if isinstance(v, Path) else v for n, v in options.items()}
    return replace(config, **texts)


def _scenario(object_: AnyObject, hand: AnyHand, options: Mapping[str, Any]) -> Scenario:
    config, shape = _find(object_, configured(RunConfig(), options))
    return Scenario.from_config(config, shape, _load(hand))


def _find(object_: AnyObject, config: RunConfig) -> tuple[RunConfig, Shape]:
    """Return an object, and the configuration with its name."""
    if isinstance(object_, trimesh.Trimesh):
        object_ = Shape.from_mesh(object_)
    if isinstance(object_, Shape):
        return replace(config, object=object_.name), object_
    if isinstance(object_, (str, Path)):
        config = replace(config, object=str(object_))
        return config, find_object(config)
    raise TypeError(
        "an object is a name, a path, a Shape or a trimesh.Trimesh; this is of type"
        f" {type(object_).__name__}. Records such as Known are for lis_grasp.pipeline, and"
        " surfaces for extract_mesh"
    )


def _load(hand: AnyHand) -> Hand:
    return hand if isinstance(hand, Hand) else Hand.load(hand)


def _seeded(options: Mapping[str, Any], rng: Seed) -> dict[str, Any]:
    seed = int(rng.integers(2**31)) if isinstance(rng, np.random.Generator) else rng
    return {"seed": seed, **options}
