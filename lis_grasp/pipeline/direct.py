"""Stages from an object and a hand: `lis_grasp.run`, `explore`, `plan` and `lift`.

They make the records `RunConfig`, `Scenario` and `Known`, and call the stages of
`lis_grasp.pipeline`, which take these records. Options are fields of `RunConfig`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from types import NoneType
from typing import Any, TypeAlias

import numpy as np
import trimesh

from lis_grasp.exceptions import InvalidOptionError, shown
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.results.run_results import Run
from lis_grasp.results.whole_run import run as run_with_files
from lis_grasp.robots.hand import Hand
from lis_grasp.robots.shipped_models import HAND_REGISTRY
from lis_grasp.shapes import Shape
from lis_grasp.shapes.shape import require_mesh
from lis_grasp.stages import lift as lifting_stage
from lis_grasp.stages import touch as stages
from lis_grasp.stages.agent import Known
from lis_grasp.stages.scenario import Scenario, find_object
from lis_grasp.task.run_config import LIFTING, RunConfig, require_used
from lis_grasp.typing import Seed

AnyObject: TypeAlias = str | Path | Shape | trimesh.Trimesh
"""An object: the name of a built-in shape, the path of a mesh file, a `Shape`, or a mesh [m]."""

AnyHand: TypeAlias = str | Path | Hand
"""A hand: the name of a shipped one, the path of its YAML file, or a `Hand`."""

_HAND = RunConfig().hand

# Fields of RunConfig that each stage uses, beside its hand and the name of its object.
_LOAD = ("size", "units", "up", "mass", "friction", "load", "arm", "base")
_RUN = tuple(f.name for f in fields(RunConfig) if f.name not in ("object", "hand", "obstacles"))
_EXPLORE = tuple(name for name in _RUN if name not in ("free_space", *LIFTING))


def run(
    object: str | Path | RunConfig,
    hand: str | Path | None = None,
    *,
    folder: Path | str | None = None,
    fresh: bool = False,
    **options: Any,
) -> Run:
    """Run every stage on an object, with a folder of results.

    `pipeline.run` is the same for a `RunConfig`, and reports progress. The conditions are the
    defaults of `RunConfig`, those of ``lis-grasp run --known``; the command's own are
    ``run("box", **pipeline.conditions.UNKNOWN)``.

    Parameters
    ----------
    object
        The true object, by name or path, since a run records it; or a whole configuration.
    hand
        The hand, by name or path; None for that of the configuration, else "allegro".
    folder
        Folder of results; None for one in ``results/`` that is named after the configuration.
    fresh
        Explore from the beginning in any case.
    options
        Fields of `RunConfig`, which replace those of a configuration. The usual ones are
        ``touches``, ``seed``, ``estimator``, ``prober``, ``friction``, ``mass`` [kg], ``size`` [m],
        ``units``, ``up``, ``pose``, ``region``, ``arm`` and ``simulator``.

    Raises
    ------
    LisGraspError
        If an input cannot be used, no contact was made, or a stage fails.
    TypeError
        If there is no such option, or the object or the hand has no name to record.

    Examples
    --------
    >>> result = run("box", "wsg50", folder="box_by_wsg50", prober="kinematic", touches=12)
    >>> result.lift["held"]
    True
    """
    require_used(run, options, _RUN)
    for kind, value, other in (("object", object, RunConfig), ("hand", hand, NoneType)):
        if not isinstance(value, (str, Path, other)):
            raise TypeError(
                f"a run records its {kind} by name, and this is of type {type(value).__name__}:"
                f" give the name of a built-in {kind} or the path of a file"
            )
    config = object if isinstance(object, RunConfig) else RunConfig(object=str(object))
    config = replace(config, **options)
    config = config if hand is None else replace(config, hand=str(hand))
    return run_with_files(config, folder, fresh=fresh)


def explore(
    object: AnyObject, hand: AnyHand = _HAND, *, rng: Seed = 0, **options: Any
) -> Exploration:
    """Explore an object by touch in simulation, without files.

    `pipeline.explore_object` writes files. `exploration.explore` takes a prober of one's own.

    Parameters
    ----------
    object
        The true object, which is touched where it is in its frame O unless a ``pose`` is given.
    hand
        The hand.
    rng
        Seed, or a generator that draws it.
    options
        Fields of `RunConfig`. The usual ones are ``touches``, ``prober`` ("kinematic" needs no
        simulator), ``estimator``, ``policy``, ``position_noise`` [m], ``normal_noise`` [rad],
        ``pose``, ``region``, ``free``, ``cloud``, ``size`` [m], ``units``, ``up`` and ``arm``.

    Raises
    ------
    LisGraspError
        If an input cannot be used.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> exploration = explore("box", "wsg50", prober="kinematic", touches=3, estimator="gpis")
    >>> exploration.made
    3
    """
    require_used(explore, options, _EXPLORE)
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

    The result is that of ``lis-grasp grasp``.

    Parameters
    ----------
    mesh
        A closed mesh [m], true or estimated, or another object, in its frame O.
    hand
        The hand.
    support_height
        Height of the plane that the object is on in O [m]; None for its lowest point, which an
        estimate only guesses: ``contacts.bounds[0, 2]`` is what ``lis-grasp grasp`` takes.
    rng
        Seed, or a generator that draws it.
    options
        Fields of `RunConfig`: ``grasps`` (their number), ``friction``, ``mass`` [kg] or else
        ``load="unknown"``, ``size`` [m], ``units``, ``up``, ``arm``, ``base`` [m], and
        ``obstacles``, the path of a mesh [m] in O that hand and arm must not hit.

    Raises
    ------
    InvalidMeshError
        If the mesh is not closed.
    LisGraspError
        If another input cannot be used, or the load is both unknown and given.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> search = plan("box", "wsg50", grasps=1)
    >>> search.best.hand, search.best.pose.shape
    ('wsg50', (4, 4))
    """
    require_used(plan, options, (*_LOAD, "grasps", "obstacles", "seed"))
    if options.get("load") == "unknown" and (given := {"friction", "mass"} & {*options}):
        raise InvalidOptionError(
            f"load='unknown' plans for any load: leave out {' and '.join(sorted(given))}",
            option="load",
        )
    config = _config(hand, _seeded(options, rng))
    hand = hand if isinstance(hand, Hand) else Hand.load(hand)
    if not isinstance(mesh, trimesh.Trimesh):  # of an estimate, the uncertainty must be kept
        config, shape = _find(mesh, config)
        mesh = shape.mesh
    lowest = float(require_mesh("the mesh", mesh).bounds[0, 2])
    support = lowest if support_height is None else support_height
    return stages.plan(Known.for_mesh(config, hand, mesh, support), mesh)


def lift(
    object: AnyObject,
    hand: AnyHand | Grasp | None = None,
    grasp: Grasp | None = None,
    **options: Any,
) -> LiftOutcome:
    """Simulate the lift of an object with a grasp.

    Parameters
    ----------
    object
        The true object, in the frame O of the grasp: `Run.truth` for a grasp of a run.
    hand
        The hand that the grasp was planned for; it may be left out if the grasp's name finds it.
    grasp
        The grasp, such as ``plan(mesh, hand).best``.
    options
        Fields of `RunConfig`: ``friction``, ``mass`` [kg], ``load`` (what the hand knows of both),
        ``simulator`` ("drake" or "mujoco"), ``size`` [m], ``units``, ``up``, ``arm`` and
        ``base`` [m].

    Raises
    ------
    LisGraspError
        If an input cannot be used, or the simulation fails.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> grasp = plan("box", "wsg50", grasps=1).best
    >>> lift("box", grasp, friction=0.9).held
    True
    """
    require_used(lift, options, (*_LOAD, "simulator"))
    if isinstance(hand, Grasp):
        hand, grasp = None, grasp or hand
    if not isinstance(grasp, Grasp):
        raise TypeError(
            "grasp of lift(object, hand, grasp) must be a Grasp, such as plan(...).best; it is a"
            f" {type(grasp).__name__}"
        )
    chosen = grasp.hand if hand is None else hand
    return lifting_stage.lift(_scenario(object, chosen, options), grasp)


def _scenario(object_: AnyObject, hand: AnyHand, options: Mapping[str, Any]) -> Scenario:
    config, shape = _find(object_, _config(hand, options))
    return Scenario.from_config(config, shape, hand if isinstance(hand, Hand) else None)


def _config(hand: AnyHand, options: Mapping[str, Any]) -> RunConfig:
    """Return a configuration with the name of a hand, if it is one that a name stands for."""
    name = hand.name if isinstance(hand, Hand) else str(hand)
    own = isinstance(hand, Hand) and name not in HAND_REGISTRY.names
    return RunConfig(hand=_HAND if own else name, **options)


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


def _seeded(options: Mapping[str, Any], rng: Seed) -> dict[str, Any]:
    if not isinstance(rng, (int, np.integer, np.random.Generator)):
        raise TypeError(f"rng must be a seed or a numpy.random.Generator; it is {shown(rng)}")
    if "seed" in options and rng != 0:
        raise TypeError("give either rng or seed; both are given")
    seed = int(rng.integers(2**31)) if isinstance(rng, np.random.Generator) else int(rng)
    return {"seed": seed, **options}
