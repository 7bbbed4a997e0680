"""The stages from an object and a hand: `lis_grasp.run`, `explore`, `next_touch`, `plan`, `lift`.

They make a task from options by name (see `Task.of`), and call the stages.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exploration import Exploration
from lis_grasp.grasping.grasps import Grasp, GraspSearch
from lis_grasp.lifting.outcome import LiftOutcome
from lis_grasp.pipeline._arguments import (
    USUAL_HAND,
    AnyHand,
    AnyObject,
    hand_name,
    loaded_hand,
    object_name,
    require_one_load,
    require_options_of_files,
    seed_of,
    shape_of,
)
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.run_results import Run
from lis_grasp.results.whole_run import run_task
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes.shape import require_mesh
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.lift import lift_object
from lis_grasp.stages.next_touch import NextTouch, ObjectPlace
from lis_grasp.stages.next_touch import next_touch as choose_touch
from lis_grasp.stages.plan import plan_grasps
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.touch import touch
from lis_grasp.surfaces import ImplicitSurface, load_contacts
from lis_grasp.surfaces.contact_loading import ContactSource
from lis_grasp.task.scene_file import is_scene_file, load_scene
from lis_grasp.task.task import LIFTING, Task, require_options, task_options
from lis_grasp.typing import Seed
from lis_grasp.world import Surroundings

# Options of the next touch: where the object is, and how the hand senses and decides.
_OF_RUN = ("folder", "fresh", "progress")
_OF_PLACE = ("center", "size", "held", "region")
_NOISE = ("position_noise", "normal_noise")
_OF_TOUCH = ("estimator", "policy", "slide", *_NOISE, "keep_all", "world", "at")
# Options that a plan and a lift use, beside hand and object.
_LOAD = ("size", "units", "up", "mass", "friction", "load", "arm", "base", "world", "at")


def run(
    object: str | Path | Task,
    hand: str | Path | None = None,
    *,
    folder: Path | str | None = None,
    fresh: bool = False,
    progress: Progress = SILENT,
    **options: Any,
) -> Run:
    """Run every stage on an object, with a folder of results.

    Without options it is ``lis-grasp run``, with ``known=True`` ``lis-grasp run --known``.

    Parameters
    ----------
    object
        The true object, by name or path, since a run records it; or a scene file, or a `Task`.
    hand
        The hand, by name or path; None for the task's.
    folder
        Folder of results; None for one in ``results/`` that is named after the task.
    fresh
        Explore from the beginning in any case.
    progress
        Gets a message for every stage and step: `pipeline.Bars()` shows bars.
    options
        See `Task.of`, such as ``touches``, ``seed``, ``estimator``, ``mass`` [kg], ``size`` [m],
        ``arm`` and ``world``, a path; they replace options of a scene file or a task.

    Raises
    ------
    LisGraspError
        If an input cannot be used, no contact was made, or a stage fails.
    TypeError
        If there is no such option, or the object or the hand has no name to record.

    Examples
    --------
    >>> result = run("box", "wsg50", folder="box", known=True, prober="kinematic", touches=12)
    >>> result.lift["held"]
    True
    """
    for kind, value in (("object", object), ("hand", hand)):
        if not isinstance(value, (str, Path, Task, type(None))):
            raise TypeError(
                f"a run records its {kind} by name, and this is of type {type(value).__name__}:"
                f" give the name of a built-in {kind} or the path of a file"
            )
    if hand is not None:
        options["hand"] = hand
    require_options(options, {"known", *task_options(), *_OF_RUN})
    if is_scene_file(object):
        object = load_scene(str(object))
    task = object.having(**options) if isinstance(object, Task) else Task.of(object, **options)
    if isinstance(task.known.world, Surroundings):
        raise TypeError(
            "a run records its world by the path of a file, and this one is in memory: give a path,"
            " or use explore, plan and lift"
        )
    return run_task(task, folder, progress=progress, fresh=fresh)


def explore(
    object: AnyObject, hand: AnyHand = USUAL_HAND, *, rng: Seed = 0, **options: Any
) -> Exploration:
    """Explore an object by touch in simulation, without files.

    Without options it is ``lis-grasp explore``: the object is free at a random place of a region,
    and contacts are in the frame of the table. With ``known=True`` it is touched where it is in its
    frame O. `exploration.explore` takes your own prober.

    Parameters
    ----------
    object
        The true object.
    hand
        The hand.
    rng
        Seed, or a generator that draws it.
    options
        See `Task.of`, such as ``touches`` and ``prober`` ("kinematic" needs no simulator).
        ``world`` is a path or `Surroundings`.

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
    later = {"object", "hand", "free_space", *LIFTING}
    require_options(options, {"known", *task_options()} - later)
    return touch(_scenario(object, hand, {"seed": seed_of(rng, options), **options}))


def next_touch(
    contacts: Contacts | ContactSource,
    hand: AnyHand = USUAL_HAND,
    *,
    support_height: float | None = None,
    rng: Seed = 0,
    **options: Any,
) -> NextTouch:
    """Return where a hand should touch an object next, given contacts so far.

    The touch equals that of ``lis-grasp next``.

    Parameters
    ----------
    contacts
        Contacts so far, or what `load_contacts` reads, in any frame O with z up; none if the
        object is in a ``region``.
    hand
        The hand.
    support_height
        Height of the table in O [m]; None for the lowest contact, or for an object that is held in
        the air with ``held=True``.
    rng
        Seed, or a generator that draws it.
    options
        ``center`` (3,) and ``size`` [m] of the object, ``held``, or the ``region``, lengths (3,)
        of a box on the table z = 0 [m]; and of `Task.of` ``estimator``, ``policy``, ``slide``,
        ``position_noise``, ``normal_noise``, ``keep_all`` and ``world``.

    Raises
    ------
    EstimationError
        If no probe can be approached, or the policy has none left.
    LisGraspError
        If an input cannot be used, or neither contacts nor options show where the object is.
    TypeError
        If there is no such option.

    Examples
    --------
    >>> touch = next_touch(contacts, "wsg50", support_height=-0.03)
    >>> touch.probe.target.shape, touch.approach.X_OH.shape, touch.approach.posture.finger
    ((3,), (4, 4), 'left')
    """
    require_options(options, (*_OF_PLACE, *_OF_TOUCH, "seed", "support_height"))
    if not isinstance(contacts, Contacts):
        contacts = _loaded(contacts)
    place = {name: options.pop(name) for name in _OF_PLACE if name in options}
    options["seed"] = seed_of(rng, options)
    task = Task.of(known=True, hand=hand_name(hand), **options)
    known = ObjectPlace(support=support_height, **place)
    agent = Agent.of(task, 0.0, hand=loaded_hand(hand))
    if len(contacts) and not task.decide.keep_all:
        contacts = agent.perception.judge(contacts).credible
    return choose_touch(agent.placed(known.space(contacts)), contacts)


def plan(
    mesh: AnyObject,
    hand: AnyHand = USUAL_HAND,
    *,
    support_height: float | None = None,
    rng: Seed = 0,
    **options: Any,
) -> GraspSearch:
    """Plan grasps of a hand on a mesh.

    The result equals that of ``lis-grasp grasp``.

    Parameters
    ----------
    mesh
        A closed mesh [m], true or estimated, or another object, in its frame O.
    hand
        The hand.
    support_height
        Height in O of the plane under the object [m]; None for its lowest point, which an estimate
        only guesses: ``lis-grasp grasp`` takes ``contacts.bounds[0, 2]``.
    rng
        Seed, or a generator that draws it.
    options
        See `Task.of`: ``grasps`` (their number), ``friction``, ``mass`` [kg] or else
        ``load="unknown"``, ``size`` [m], ``units``, ``up``, ``arm``, ``base`` [m], and
        ``world``, a path or `Surroundings` in O.

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
    require_options(options, (*_LOAD, "grasps", "seed", "support_height"))
    require_one_load(options)
    named, options["seed"] = object_name(mesh), seed_of(rng, options)
    require_options_of_files(mesh, options)
    task = Task.of(named, known=True, hand=hand_name(hand), **options)
    # An estimate must keep its uncertainty.
    solid = mesh if isinstance(mesh, trimesh.Trimesh) else shape_of(mesh, task.world).mesh
    lowest = float(require_mesh("the mesh", solid).bounds[0, 2])
    height = lowest if support_height is None else support_height
    return plan_grasps(Agent.of(task, height, hand=loaded_hand(hand)), solid)


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
        See `Task.of`: ``friction``, ``mass`` [kg], ``load`` (what the hand knows of both),
        ``simulator`` ("drake" or "mujoco"), ``size`` [m], ``units``, ``up``, ``arm``,
        ``base`` [m] and ``world``, a path or `Surroundings` in O.

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
    require_options(options, (*_LOAD, "simulator"))
    given = hand if grasp is None else grasp
    if isinstance(object, Grasp):
        raise TypeError("lift(object, grasp) needs the true object before the Grasp")
    if not isinstance(given, Grasp):
        is_hand = grasp is None and isinstance(given, (str, Path, Hand, type(None)))
        missing = "missing" if is_hand else ""
        raise TypeError(
            "grasp of lift(object, hand, grasp) must be a Grasp, such as"
            f" plan(...).best; it is {missing or f'of type {type(given).__name__}'}"
        )
    if isinstance(hand, Grasp):
        hand = None
    grasp = given
    chosen = grasp.hand if hand is None else hand
    return lift_object(_scenario(object, chosen, {"known": True, **options}), grasp)


def _loaded(contacts: ContactSource) -> Contacts:
    if isinstance(contacts, ImplicitSurface):
        raise TypeError(
            "next_touch(contacts, hand) estimates the surface itself; this is of type"
            f" {type(contacts).__name__}: give its contacts, and the option `estimator`"
        )
    return load_contacts(contacts)


def _scenario(object_: AnyObject, hand: AnyHand, options: dict[str, Any]) -> Scenario:
    task = Task.of(object_name(object_), hand=hand_name(hand), **options)
    require_options_of_files(object_, options)
    return Scenario.from_config(task, shape_of(object_, task.world), loaded_hand(hand))
