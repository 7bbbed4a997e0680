"""Lifts of the true object with the grasps of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import trimesh

from lis_grasp.exceptions import InvalidOptionError
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import sole_writer, write_json
from lis_grasp.io.option import at_least, checked_value
from lis_grasp.io.surface_files import load_surface
from lis_grasp.results.notes import WARNING, say_repairs
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.report import ranked_facts
from lis_grasp.stages.lift import lift_each, require_simulator
from lis_grasp.stages.place import with_place
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.worker_pool import process_count
from lis_grasp.task.recorded_facts import read_facts, recorded_base
from lis_grasp.task.task import Task, require_options

LIFTED_WITH = ("arm", "base", "mass", "friction", "simulator", "place")
"""Options of a lift of grasps in a file, beside those of its object."""
_OBJECT = ("object", "size", "units", "up")


@dataclass(frozen=True, slots=True, eq=False)
class LiftedFile:
    """Outcomes of lifts in a file."""

    path: Path
    lifts: Sequence[Mapping[str, Any]]  #: with the best grasps in order; see `ranked_facts`
    mass: float  #: of the true object [kg]


def lift_file(
    path: Path,
    folder: Path | None = None,
    *,
    best: int = 1,
    jobs: int | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> LiftedFile:
    """Simulate the lift of the true object with the grasps in a file, and write lifts.json.

    The motion of the first lift is written as motion.npz. `folder` is by default that of the
    grasps. `best` is the number of grasps to lift with, `jobs` that of processes, by default one a
    core. The options are ``object``, ``size``, ``units``, ``up``, ``arm``, ``base``, ``mass``,
    ``friction``, ``simulator`` and ``place``, by default as recorded in the file, else as in
    `Task`. The estimate surface.ply beside the grasps is what an arm avoids, and what is placed.

    Raises `InvalidOptionError` if a value is out of range, or no object is given or recorded,
    `TypeError` for another option.

    Examples
    --------
    >>> _ = shapes.find("box").mesh.export("box.stl")
    >>> _ = pipeline.grasp_file(Path("box.stl"), hand="wsg50", grasps=1)
    >>> lifted = pipeline.lift_file(Path("grasps.json"), object="box")
    >>> lifted.lifts[0]["held"]
    True
    """
    best, jobs = checked_value("best", best, int, at_least(1)), process_count(jobs)
    work = lifting_of(path, options, progress)
    scenario, grasps = work.scenario, work.search.grasps[:best]
    folder = path.parent if folder is None else folder
    with sole_writer(folder):
        outcomes = lift_each(scenario, grasps, jobs=jobs, estimate=work.estimate)
        lifts: list[dict[str, Any]] = []
        for rank in range(1, len(grasps) + 1):
            title = f"Lifting {scenario.truth.shape.name} with grasp {rank}"
            with progress.stage(title) as stage:
                outcome = next(outcomes)
                stage.result = outcome.reason
            if not lifts:
                outcome.motion.save(folder / "motion.npz")
            lifts.append(ranked_facts(rank, scenario, outcome))
        facts = scenario.task.facts()
        facts = {n: v for n, v in facts.items() if n not in ("estimator", "policy")}
        header = provenance.merge(work.recorded, **facts)
        write_json(folder / "lifts.json", {"header": header, "lifts": lifts})
    return LiftedFile(folder / "lifts.json", lifts, scenario.truth.mass)


@dataclass(frozen=True, slots=True, eq=False)
class LiftingWork:
    """Grasps of a file, and the true object to lift with them."""

    search: GraspSearch
    scenario: Scenario
    #: that an arm avoids, bodies are kept off, and is placed [m]; None where nothing needs it
    estimate: trimesh.Trimesh | None
    recorded: Mapping[str, Any]  #: facts of the header


def lifting_of(path: Path, options: Mapping[str, Any], progress: Progress) -> LiftingWork:
    """Return the grasps in a file and what to lift, with the options of `lift_file`."""
    require_options(options, (*_OBJECT, *LIFTED_WITH))
    recorded = read_facts(path, usual="grasps.json")
    search = GraspSearch.load(path)
    if options.get("object") is None and "object" not in recorded:
        raise InvalidOptionError(f"{path} records no object: name it by `object`", option="object")
    task = Task.from_facts({"hand": None, **options}, recorded)
    poses = {**recorded, "X_EA": recorded_base(options, recorded)}
    scenario = with_place(Scenario.from_config(task, recorded=poses))
    say_repairs(scenario.truth.shape, progress)
    planned, lifted = recorded.get("object", task.world.object), task.world.object
    if Path(planned).name != Path(lifted).name:
        progress.say(
            f"{WARNING}{path.name} has grasps of {planned}, and the true object is {lifted}"
        )
    truth = scenario.truth
    require_simulator(task.world.simulator, truth.shape, truth.surroundings)
    surface, agent = path.with_name("surface.ply"), scenario.agent
    if agent.decide.place is not None and not surface.exists():
        raise InvalidOptionError(
            f"place needs the estimate of the object, surface.ply beside {path.name}; {surface}"
            " does not exist: copy it there, or leave out `place`",
            option="place",
            value=agent.decide.place,
        )
    needed = agent.station is not None or len(agent.surroundings) or agent.decide.place is not None
    avoided = needed and surface.exists()
    return LiftingWork(search, scenario, load_surface(surface) if avoided else None, recorded)
