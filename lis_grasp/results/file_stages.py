"""Single stages on files: the estimate of contacts, grasps on a mesh, lifts with grasps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh

from lis_grasp.contacts import Contacts
from lis_grasp.exceptions import InvalidContactsError, InvalidOptionError, LisGraspError
from lis_grasp.grasping.grasps import GraspSearch
from lis_grasp.io import provenance
from lis_grasp.io.atomic_writing import sole_writer, write_json
from lis_grasp.io.contact_files import read_point_file
from lis_grasp.io.option import at_least, checked_value
from lis_grasp.io.surface_files import load_surface
from lis_grasp.results.folder import LOG, require_own, result_file
from lis_grasp.results.notes import say_repairs, say_width
from lis_grasp.results.progress import SILENT, Progress
from lis_grasp.results.report import lift_facts
from lis_grasp.results.stage_files import (
    NOISE,
    PLANNED_WITH,
    planning_facts,
    write_grasps,
    write_surface,
)
from lis_grasp.robots.hand import Hand
from lis_grasp.shapes import load
from lis_grasp.stages.agent import Agent
from lis_grasp.stages.configured_arm import station_facts
from lis_grasp.stages.contact_sources import ContactSource, join_sources, read_source
from lis_grasp.stages.estimate import Perception
from lis_grasp.stages.lift import lift_each, require_simulator
from lis_grasp.stages.next_touch import NO_TABLE, ObjectPlace
from lis_grasp.stages.scenario import Scenario
from lis_grasp.stages.worker_pool import process_count
from lis_grasp.surfaces.contact_checks import doubt_of_side
from lis_grasp.surfaces.estimators import require_noise_below_size
from lis_grasp.task.recorded_facts import read_facts, recorded_base
from lis_grasp.task.task import HEIGHT, Task, require_options
from lis_grasp.typing import FloatArray

# Fields that distinguish contacts.
_COMPARED = ("points", "normals", *NOISE)
_LIFTED_WITH = ("object", "size", "units", "up", "arm", "base", "mass", "friction", "simulator")
_WARNING = "warning: "


@dataclass(frozen=True, slots=True, eq=False)
class EstimatedFile:
    """A surface in a file, and the contacts that it was estimated from."""

    path: Path
    mesh: trimesh.Trimesh  #: in O [m]
    contacts: Contacts
    has_new_contacts: bool  #: whether contacts.ply was written beside it


@dataclass(frozen=True, slots=True, eq=False)
class GraspedFile:
    """Grasps in a file, and what they were planned on."""

    path: Path
    search: GraspSearch
    mesh: trimesh.Trimesh  #: in O [m]
    agent: Agent
    task: Task
    recorded: Mapping[str, Any]  #: facts of the header


@dataclass(frozen=True, slots=True, eq=False)
class LiftedFile:
    """Outcomes of lifts in a file."""

    path: Path
    lifts: Sequence[Mapping[str, Any]]  #: of the best grasps in order, as `lift_facts`
    mass: float  #: of the true object [kg]


def estimate_file(
    sources: Sequence[ContactSource],
    folder: Path | None = None,
    *,
    support: float | Literal["none"] | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> EstimatedFile:
    """Estimate the surface from files of contacts of one object, and write surface.ply.

    Its contacts are written beside it if the folder lacks them, and files that were made from an
    earlier surface are removed. The default of `folder` is that of the first file. `support` is the
    height of the table under the object [m], which closes the estimate from below, or "none" for an
    object that is held in the air; by default what the files record of it. The options are
    ``estimator``, ``free_space`` and ``keep_all``, by default as recorded in the files, else as in
    `Task`.

    Raises `InvalidContactsError` if there are no contacts, `InvalidOptionError` if the folder has
    others that must be kept, `TypeError` for another option.

    Examples
    --------
    >>> contacts.save("contacts.ply")
    >>> source = pipeline.ContactSource("contacts.ply")
    >>> made = pipeline.estimate_file([source], Path("estimated"), estimator="gpis")
    >>> made.path.name, made.mesh.is_watertight
    ('surface.ply', True)
    """
    require_options(options, ("estimator", "free_space", "keep_all"))
    paths = [Path(source.path) for source in sources]
    contacts, recorded = _load_sources(sources)
    if not len(contacts):
        raise InvalidContactsError(f"{paths[0]} has no contacts: add at least one row")
    noise = {n: getattr(sources[0], n) for n in NOISE if len({getattr(s, n) for s in sources}) == 1}
    task = Task.from_facts({"estimator": None, **noise, **options}, recorded)
    require_noise_below_size(contacts, task.robot.position_noise)
    place, known = _table_of(support, task, recorded)
    folder = paths[0].parent if folder is None else folder
    is_kept = _require_contacts_fit(folder, contacts, paths)
    checked = "object" in recorded or any(source.normals or source.viewpoint for source in sources)
    warnings = list(recorded.get("warnings") or ())
    for line in _findings(contacts, paths, checked=checked):
        progress.say(line)
        warnings += [line.removeprefix(_WARNING)] if line.startswith(_WARNING) else []
    if doubt := place.doubt(contacts):
        warnings.append(doubt)  # for grasps
        progress.say("table: unknown; if the object is on one, `support` closes the estimate there")
    made = {**recorded, "support_height": place.table(contacts)}
    if place.held:
        del made["support_height"]
    if support is not None and task.world.prober == "dynamic":  # a kinematic one has fixed objects
        made["free"] = not place.held
    made |= {"warnings": warnings} if warnings else {}
    path = folder / "surface.ply"
    with result_file(path, progress) as temporary:
        mesh = write_surface(temporary, known, contacts, made, progress)
        if not is_kept:
            with result_file(folder / "contacts.ply", progress) as copy:
                contacts.save(copy, header=provenance.merge(recorded))
    return EstimatedFile(path, mesh, contacts, not is_kept)


def grasp_file(
    path: Path,
    folder: Path | None = None,
    *,
    support: float | None = None,
    progress: Progress = SILENT,
    **options: Any,
) -> GraspedFile:
    """Plan grasps on the mesh in a file, this package's or any, and write grasps.json.

    Files that were made from earlier grasps are removed. The default of `folder` is that of the
    mesh. `support` is the height of the plane below the object [m], by default the recorded one: of
    an estimate the table's, else the lowest contact's; else it is the mesh's lowest point. The
    options are ``hand``, ``arm``, ``base``, ``mass``, ``friction``, ``load``, ``grasps``,
    ``obstacles``, ``seed``, ``units`` and ``up``, by default as recorded in the file, else as in
    `Task`.

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
            progress.say(f"{_WARNING}{warning}")
    hand = Hand.load(task.robot.hand)
    lowest = float(mesh.bounds[0, 2])
    known_table = recorded.get("support_height") if support is None else support
    table = checked_value("support", lowest if known_table is None else known_table, float, HEIGHT)
    if known_table is None:
        progress.say(f"{_WARNING}{NO_TABLE}: `support` is {table:.4g} m, the lowest point")
    elif (below := round(1e3 * (table - lowest))) > 0:
        progress.say(f"{_WARNING}the mesh reaches {below} mm below the table, z = {table:.4g} m")
    agent = Agent.of(task, table, hand=hand, X_EA=recorded_base(options, recorded))
    facts = recorded | station_facts(agent.station) | planning_facts(task)
    path = (path.parent if folder is None else folder) / "grasps.json"
    with result_file(path, progress) as temporary:
        search = write_grasps(temporary, agent, mesh, facts, progress)
    if not search.grasps:
        say_width(mesh, hand, progress)
    return GraspedFile(path, search, mesh, agent, task, recorded)


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

    The motion of the first lift is written as motion.npz. The default of `folder` is that of the
    grasps. `best` is the number of grasps to lift with, `jobs` that of processes, by default one a
    core. The options are ``object``, ``size``, ``units``, ``up``, ``arm``, ``base``, ``mass``,
    ``friction`` and ``simulator``, by default as recorded in the file, else as in `Task`.

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
            lifts.append({"rank": rank, **lift_facts(outcome, mass=scenario.truth.mass)})
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
    estimate: trimesh.Trimesh | None  #: that an arm avoids [m]; None for a hand without one
    recorded: Mapping[str, Any]  #: facts of the header


def lifting_of(path: Path, options: Mapping[str, Any], progress: Progress) -> LiftingWork:
    """Return the grasps in a file and what to lift, with the options of `lift_file`."""
    require_options(options, _LIFTED_WITH)
    recorded = read_facts(path, usual="grasps.json")
    search = GraspSearch.load(path)
    if options.get("object") is None and "object" not in recorded:
        raise InvalidOptionError(f"{path} records no object: name it by `object`", option="object")
    task = Task.from_facts({"hand": None, **options}, recorded)
    poses = {**recorded, "X_EA": recorded_base(options, recorded)}
    scenario = Scenario.from_config(task, recorded=poses)
    say_repairs(scenario.truth.shape, progress)
    if task.known.obstacles is not None:
        progress.say("the lift is simulated without the obstacles")
    require_simulator(task.world.simulator, scenario.truth.shape)
    surface = path.with_name("surface.ply")
    avoided = scenario.agent.station is not None and surface.exists()
    return LiftingWork(search, scenario, load_surface(surface) if avoided else None, recorded)


def _table_of(
    support: float | Literal["none"] | None, task: Task, recorded: Mapping[str, Any]
) -> tuple[ObjectPlace, Perception]:
    """Return the place of an object on the table that is given, else recorded, and the settings."""
    held = support == "none"
    if support is None:
        height = recorded.get("support_height")
        closes = height if task.on_table else None
    else:
        height = None if held else checked_value("support", support, float, HEIGHT)
        closes = height
    known = Perception.of(task.robot, task.decide, closes)
    return ObjectPlace(support=height, held=held), known


def load_mesh(
    path: Path, options: Mapping[str, Any], recorded: Mapping[str, Any], progress: Progress = SILENT
) -> trimesh.Trimesh:
    """Return the mesh of a file [m]: an estimate with recorded facts, or repaired."""
    # A surface of this package has an uncertainty, and is in metres already.
    units, up = options.get("units"), options.get("up")
    if recorded and units is None and up is None:
        return load_surface(path)
    shape = load(path, units, up)
    say_repairs(shape, progress)
    return shape.mesh


def _load_sources(sources: Sequence[ContactSource]) -> tuple[Contacts, dict[str, Any]]:
    """Return the contacts of all files, and the facts that they record, of the first file first.

    Contacts of several files carry the noise of their file.
    """
    if len(sources) == 1:
        return read_source(sources[0])
    recorded: dict[str, Any] = {}
    contacts = join_sources(sources)
    for source in reversed(sources):
        recorded |= read_facts(Path(source.path))
    # The contacts carry what the files record of their sensors.
    return contacts, {k: v for k, v in recorded.items() if k not in NOISE}


def _require_contacts_fit(folder: Path, contacts: Contacts, sources: Sequence[Path]) -> bool:
    """Return whether a folder has the contacts of a new surface as its contacts.ply.

    Raises `InvalidOptionError` if it has others that must be kept: a source of the new ones, or
    those of an exploration; or if its surface.ply is a source.
    """
    path, inputs = folder / "contacts.ply", [source.resolve() for source in sources]
    if (folder / "surface.ply").resolve() in inputs:
        raise InvalidOptionError(
            f"{folder}/surface.ply would be replaced by its own estimate: estimate from contacts,"
            " or name another by `folder`",
            option="folder",
            value=str(folder),
        )
    if not path.exists():
        return False
    with suppress(LisGraspError):  # points without normals, perhaps
        present = Contacts.load(path)
        both = ([np.asarray(getattr(c, n), float) for c in (present, contacts)] for n in _COMPARED)
        if all(np.array_equal(first, second, equal_nan=True) for first, second in both):
            return True
    require_own(path)
    if (folder / LOG).exists() or path.resolve() in inputs:
        raise InvalidOptionError(
            "contacts.ply in the folder of results must have the contacts of the surface, in metres"
            f" and with outward normals; {path} has others: name another by `folder`",
            option="folder",
            value=str(folder),
        )
    return False


def _findings(contacts: Contacts, paths: Sequence[Path], *, checked: bool) -> Iterator[str]:
    """Yield the extent of contacts, the certainty of estimated normals, and warnings."""
    yield f"contacts: {len(contacts)} within {millimetres(np.ptp(contacts.bounds, axis=0))}"
    files = [file for file in map(read_point_file, paths) if file["normals"] is None]
    if files and contacts.normal_noise is not None:
        degrees = np.rad2deg(np.nanmedian(contacts.normal_noise))
        have_all = all(file["approach"] is not None for file in files)
        advice = "" if have_all else "; directions of approach in columns ax,ay,az make it smaller"
        yield f"normals: estimated, with a median standard deviation of {degrees:.0f} deg{advice}"
    doubt = "" if checked else doubt_of_side(contacts)
    if doubt:
        yield f"{_WARNING}{doubt}"


def millimetres(extents: FloatArray) -> str:
    """Return extents (3,) [m] as text."""
    return " x ".join(f"{1e3 * extent:.3g}" for extent in extents) + " mm"
