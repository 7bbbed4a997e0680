"""Grasps planned on the mesh of a file, and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import trimesh

from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io.option import checked_value
from lis_grasp.io.surface_files import load_surface
from lis_grasp.results.folder import result_file
from lis_grasp.results.notes import WARNING, say_repairs, say_width
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.stage_files import (
    PLANNED_WITH,
    planning_facts,
    write_grasps,
)
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import load
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.configured_arm import station_facts
from lis_grasp.stages.next_touch import NO_TABLE
from lis_grasp.surfaces.contact_checks import require_table_below
from lis_grasp.task.recorded_facts import read_facts, recorded_base
from lis_grasp.task.task import HEIGHT, Task, require_options

_FAR_BELOW = 2.0  # of a plane that is in no hand's way [m]


@dataclass(frozen=True, slots=True, eq=False)
class GraspedFile:
    """Grasps in a file, and the mesh that they were planned on."""

    path: Path
    search: GraspSearch
    mesh: trimesh.Trimesh  #: in O [m]
    agent: Agent
    task: Task
    recorded: Mapping[str, Any]  #: facts of the header


def grasp_file(
    path: Path,
    folder: Path | None = None,
    *,
    support: float | Literal["none"] | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> GraspedFile:
    """Plan grasps on the mesh in any file, and write grasps.json.

    Files that were made from earlier grasps are removed. `folder` is by default that of the mesh.
    `support` is the height of the plane under the object [m], or "none" for an object held in the
    air; by default the recorded one: for an estimate the table's, else the lowest contact's;
    otherwise the mesh's lowest point. The options are ``hand``, ``arm``, ``base``, ``mass``,
    ``friction``, ``load``, ``grasps``, ``world``, ``seed``, ``units`` and ``up``, by default as
    recorded in the file, else as in `Task`.

    Raises `InvalidOptionError` if a value is out of range, `InvalidFileError` or `InvalidMeshError`
    if the mesh cannot be used, `TypeError` for another option.

    Examples
    --------
    >>> _ = shapes.find("box").mesh.export("box.stl")
    >>> made = pipeline.grasp_file(Path("box.stl"), hand="wsg50", grasps=1)
    >>> made.path.name, len(made.search)
    ('grasps.json', 1)
    """
    require_options(options, (*PLANNED_WITH, "units", "up"))
    recorded = read_facts(path, usual="surface.ply")
    task = Task.from_facts({"hand": None, **options}, recorded)
    mesh = load_mesh(path, options, recorded, progress)
    for warning in recorded.get("warnings") or ():
        if support is None or not warning.startswith(NO_TABLE):
            progress.say(f"{WARNING}{warning}")
    hand = Hand.load(task.robot.hand)
    lowest = float(mesh.bounds[0, 2])
    known_table = recorded.get("support_height") if support is None else support
    if support == "none":
        known_table = lowest - _FAR_BELOW
        recorded = {name: fact for name, fact in recorded.items() if name != "support_height"}
    table = checked_value("support", lowest if known_table is None else known_table, float, HEIGHT)
    require_table_below(table, float(mesh.bounds[1, 2]), "of the mesh")
    if known_table is None:
        progress.say(f"{WARNING}{NO_TABLE}: `support` is {table:.4g} m, the lowest point")
    elif (below := round(1e3 * (table - lowest))) > 0:
        progress.say(f"{WARNING}the mesh reaches {below} mm below the table, z = {table:.4g} m")
    poses = {"X_EA": recorded_base(options, recorded), "X_WE": recorded.get("X_WE")}
    agent = Agent.of(task, table, hand=hand, poses=poses)
    facts = recorded | station_facts(agent.station) | planning_facts(task)
    facts |= {} if support == "none" else {"support_height": table}
    path = (path.parent if folder is None else folder) / "grasps.json"
    with result_file(path, progress) as temporary:
        search = write_grasps(temporary, agent, mesh, facts, progress)
    if not search.grasps:
        say_width(mesh, hand, progress)
    return GraspedFile(path, search, mesh, agent, task, recorded)


def load_mesh(
    path: Path, options: Mapping[str, Any], recorded: Mapping[str, Any], progress: Progress = SILENT
) -> trimesh.Trimesh:
    """Return the mesh of a file [m]: an estimate with recorded facts, or repaired."""
    # A surface by this package has an uncertainty, and is already in metres.
    units, up = options.get("units"), options.get("up")
    if recorded and units is None and up is None:
        return load_surface(path)
    shape = load(path, units, up)
    say_repairs(shape, progress)
    return shape.mesh
